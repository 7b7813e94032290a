"""Renders with LuxCore. Run by an interpreter that has the package pyluxcore; see serve.py.

Option: `engine`, PATHCPU or BIDIRCPU. The scene comes as glTF without pictures (gltf.py) and is rebuilt through LuxCore's API: lamps
shine to the side of their normals, transmission is glass, metals are `metal2`, or `mirror` where they are smooth, what has gloss else is
`disney`, and the rest `matte`. No denoiser, no adaptive sampling, no filter.
"""

from __future__ import annotations

import math
import time
from pathlib import Path

import gltf
import numpy as np
import pyluxcore as lux
from serve import serve, threads

# LuxCore's maps have z up and turn the other way round.
GLTF_FROM_MAP = np.array([[0, 1, 0], [0, 0, 1], [-1, 0, 0]])


def check(options: dict) -> str:
    """Return the version."""
    return lux.Version()


def properties(values: dict) -> lux.Properties:
    """Return LuxCore's properties of these names and values; arrays become lists of numbers."""
    out = lux.Properties()
    for name, value in values.items():
        if isinstance(value, (tuple, list, np.ndarray)):
            value = [float(x) for x in value]
        out.Set(lux.Property(name, value))
    return out


def material(number: int, m: gltf.Material) -> dict:
    """Return the nearest material of LuxCore. Its roughness is the α of GGX, but for `disney`."""
    # What is as smooth as this is meant to be a mirror or clear.
    smooth, alpha = m.roughness < 0.03, m.roughness**2
    out: dict[str, object]
    if m.transmission > 0:
        out = {"type": "glass" if smooth else "roughglass", "kr": m.color, "kt": m.color, "interiorior": m.ior, "exteriorior": 1.0}
        out |= {} if smooth else {"uroughness": alpha, "vroughness": alpha}
    elif m.metallic == 1 and smooth:
        out = {"type": "mirror", "kr": m.color}
    elif m.metallic == 1:
        out = {"type": "metal2", "fresnel": f"f{number}", "uroughness": alpha, "vroughness": alpha}
    elif m.specular > 0 or m.metallic > 0:
        out = {"type": "disney", "basecolor": m.color, "metallic": m.metallic, "roughness": m.roughness, "specular": 0.5 * m.specular}
    else:
        out = {"type": "matte", "kd": m.color}
    if max(m.emission) > 0:
        # By itself, LuxCore samples the light of small meshes only, and leaves balls to chance.
        out |= {"emission": m.emission, "emission.directlightsampling.type": "ENABLED"}
    return out


def build(job: dict) -> lux.Scene:
    """Return LuxCore's scene."""
    given = gltf.read(Path(job["gltf"]))
    scene = lux.Scene()
    aspect = job["width"] / job["height"]
    eye, ahead, up = (given.world_from_camera[:3, i] for i in (3, 2, 1))
    # The field of view is that of the longer side, which goes from -1 to 1; LuxCore's rows lie one pixel lower.
    x, y = min(1.0, aspect), min(1.0, 1 / aspect)
    row = 2 * y / job["height"]
    values: dict = {
        "scene.camera.type": "perspective",
        "scene.camera.lookat.orig": eye,
        "scene.camera.lookat.target": eye - ahead,
        "scene.camera.up": up,
        "scene.camera.fieldofview": math.degrees(2 * math.atan(math.tan(given.yfov / 2) / y)),
        "scene.camera.screenwindow": (-x, x, -y - row, y - row),
        "scene.camera.lensradius": 0.0,
        "scene.camera.autofocus.enable": False,
    }
    sky = job["environment"]
    if sky and "radiance" in sky:
        values |= {"scene.lights.sky.type": "constantinfinite", "scene.lights.sky.color": sky["radiance"]}
    elif sky:
        world_from_map = np.eye(4)
        world_from_map[:3, :3] = np.array(sky["world_from_map"])[:3, :3] @ GLTF_FROM_MAP
        values |= {
            "scene.lights.sky.type": "infinite",
            "scene.lights.sky.file": sky["file"],
            "scene.lights.sky.gamma": 1.0,
            "scene.lights.sky.gain": [sky["scale"]] * 3,
            "scene.lights.sky.transformation": world_from_map.T.ravel(),
        }
    for i, m in enumerate(given.materials):
        values |= {f"scene.textures.f{i}.type": "fresnelcolor", f"scene.textures.f{i}.kr": m.color}
        values |= {f"scene.materials.m{i}.{key}": value for key, value in material(i, m).items()}
    for i, mesh in enumerate(given.meshes):
        normals = None if mesh.normals is None else [tuple(n) for n in mesh.normals.tolist()]
        points, triangles = ([tuple(row) for row in rows.tolist()] for rows in (mesh.points, mesh.triangles))
        scene.DefineMesh(f"mesh{i}", points, triangles, normals, None, None, None)
        values |= {f"scene.objects.o{i}.shape": f"mesh{i}", f"scene.objects.o{i}.material": f"m{mesh.material}"}
    scene.Parse(properties(values))
    return scene


def load(job: dict):
    """Return what renders the scene."""
    lux.Init(lambda text: None)
    scene = build(job)
    width, height = job["width"], job["height"]
    # Mitsuba counts camera rays and shadow rays as well.
    depth = job["max_depth"] - 1
    values = {
        "renderengine.type": job["engine"],
        "native.threads.count": threads(),
        "sampler.type": "SOBOL",
        "sampler.sobol.adaptive.strength": 0.0,
        "path.pathdepth.total": depth,
        "path.pathdepth.diffuse": depth,
        "path.pathdepth.glossy": depth,
        "path.pathdepth.specular": depth,
        "path.maxdepth": depth,
        "light.maxdepth": depth,
        "film.width": width,
        "film.height": height,
        "film.filter.type": "NONE",
        "film.imagepipelines.0.0.type": "NOP",
        "film.outputs.1.type": "RGB",
        "film.outputs.1.filename": "picture.exr",
    }

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        config = lux.RenderConfig(properties({**values, "renderengine.seed": seed, "batch.haltspp": spp}), scene)
        session = lux.RenderSession(config)
        # Builds, and starts the threads at its end.
        session.Start()
        start = time.process_time()
        while not session.HasDone():
            time.sleep(0.01)
            session.UpdateStats()
        seconds = time.process_time() - start
        picture = np.zeros(width * height * 3, np.float32)
        session.GetFilm().GetOutputFloat(lux.FilmOutputType.RGB, picture, 0)
        session.Stop()
        return picture.reshape(height, width, 3)[::-1], seconds

    return render


if __name__ == "__main__":
    serve(check, load)
