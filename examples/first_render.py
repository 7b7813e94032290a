# %% [markdown]
# # A first picture
#
# This file runs as a script and, cell by cell, in editors that know `# %%` (VS Code, Spyder, Jupyter by jupytext).
# It needs the package: `pip install .` in the root of the repository.

# %%
import os
from pathlib import Path

import numpy as np

import etendue

# The tests run this file with few samples.
SPP = int(os.environ.get("ETENDUE_EXAMPLE_SPP", "64"))
WIDTH = int(os.environ.get("ETENDUE_EXAMPLE_WIDTH", "640"))
OUT = Path("out")
OUT.mkdir(exist_ok=True)

# %% [markdown]
# ## A scene from a dictionary
#
# The terms are those of Mitsuba's `load_dict`. Files are read by `etendue.load("scene.xml")` or `etendue.load("model.glb")`.

# %%
T = etendue.Transform


def gray(value: float) -> dict[str, object]:
    """A color without color."""
    return {"type": "rgb", "value": value}


description = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 8},
    "camera": {
        "type": "perspective",
        "fov": 35,
        "to_world": T().look_at(origin=[0, 1.2, 5], target=[0, 0.5, 0], up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 640, "height": 360},
    },
    "floor": {
        "type": "rectangle",
        "to_world": T().rotate([1, 0, 0], -90).scale(10),
        "bsdf": {"type": "diffuse", "reflectance": gray(0.6)},
    },
    "red": {
        "type": "sphere",
        "center": [-1.1, 0.5, 0],
        "radius": 0.5,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.7, 0.15, 0.1]}},
    },
    "glass": {"type": "sphere", "center": [0, 0.5, 0.3], "radius": 0.5, "bsdf": {"type": "dielectric"}},
    "gold": {
        "type": "sphere",
        "center": [1.1, 0.5, 0],
        "radius": 0.5,
        "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.2},
    },
    "lamp": {
        "type": "rectangle",
        "to_world": T().translate([0, 4, 1]).rotate([1, 0, 0], 90),
        "emitter": {"type": "area", "radiance": gray(8.0)},
    },
    "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.2, 0.25, 0.35]}},
}
scene = etendue.load_dict(description)
scene.info()

# %% [markdown]
# ## Rendering
#
# `render` returns linear values, `float32` of shape (height, width, 3). The callback may return False to stop.


# %%
def progress(status: etendue.Status) -> None:
    """Show how far it is."""
    print(f"\r{status.fraction:4.0%}  {status.spp_done} spp", end="", flush=True)


picture = scene.render(spp=SPP, width=WIDTH, seed=1, progress=progress)
print(f"\n{picture.shape} {picture.dtype}, mean {picture.mean():.3f}")
etendue.write_image(OUT / "first_render.png", picture, tonemap="agx")

# %% [markdown]
# ## Auxiliary outputs
#
# With `aovs` a dictionary of arrays comes back. EXR files take all of them.

# %%
layers = scene.render(spp=SPP, width=WIDTH, aovs=["albedo", "normal", "depth", "variance"])
etendue.write_image(OUT / "first_render.exr", layers)
print({name: layer.shape for name, layer in layers.items()})

# %% [markdown]
# ## How much noise is left?
#
# Two pictures with different seeds differ by their noise alone. The stated variance says the same without a second picture.

# %%
other = scene.render(spp=SPP, width=WIDTH, seed=2)
figures = etendue.compare(picture, other)
print(f"relMSE {figures['relmse']:.4f}, FLIP {figures['flip']:.4f}")
print(f"standard deviation of a pixel: {np.sqrt(layers['variance'].mean()):.4f} (as estimated)")
print(f"                               {np.sqrt(np.mean((picture - other) ** 2) / 2):.4f} (as measured)")
