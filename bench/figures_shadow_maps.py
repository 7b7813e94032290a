"""Make the figures and the table of docs/theory/shadow-maps.md with the `etendue` command.

Usage: python bench/figures_shadow_maps.py [--etendue PATH] [--spp N] [--width N]
Needs NumPy, OpenEXR and Pillow. Prints the table; writes docs/theory/figures/shadow-*.jpg.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw

ROOT = Path(__file__).parent.parent
SCENES = ROOT / "docs" / "theory" / "scenes"
FIGURES = ROOT / "docs" / "theory" / "figures"

RASTER = ["--integrator", "raster"]
SHADOWS = {
    "hard, no bias": [*RASTER, "--shadow-filter", "hard", "--shadow-resolution", "256", "--shadow-bias", "0"],
    "hard, 256": [*RASTER, "--shadow-filter", "hard", "--shadow-resolution", "256"],
    "hard, bias x8": [*RASTER, "--shadow-filter", "hard", "--shadow-resolution", "256", "--shadow-bias", "8"],
    "pcf, 256": [*RASTER, "--shadow-filter", "pcf", "--shadow-resolution", "256"],
    "pcss, 1024": [*RASTER],
    "many places": [*RASTER, "--shadow-maps", "sampled"],
    "rays": ["--integrator", "direct"],
    "rays, all light": ["--integrator", "path", "--max-depth", "8"],
}
# Lights without a size, in the place of the area light: their depth maps against shadow rays.
LIGHTS = {
    "spot, one map": """<emitter type="spot"><transform name="to_world">
        <lookat origin="2.2, 2.0, 4.5" target="0, 0, 0.5" up="0, 1, 0"/></transform>
        <rgb name="intensity" value="40"/><float name="cutoff_angle" value="35"/></emitter>""",
    "sun, cascades": """<emitter type="directional"><vector name="direction" x="-2.2" y="-2.0" z="-4"/>
        <rgb name="irradiance" value="2"/></emitter>""",
    "point, cube": """<emitter type="point"><point name="position" x="0.4" y="-0.2" z="3"/><rgb name="intensity" value="15"/></emitter>""",
}
MIRRORS = {
    "one point": [*RASTER, "--envmap-correction", "none"],
    "box": [*RASTER],
    "rays": ["--integrator", "path", "--max-depth", "2"],
}


def render(etendue: str, scene: str, flags: list[str], args: argparse.Namespace, folder: Path) -> tuple[np.ndarray, Image.Image]:
    """Linear pixels and the picture for the page."""
    exr, png = folder / "a.exr", folder / "a.png"
    size = ["--width", str(args.width), "--spp", str(args.spp), "--quiet", "--exposure", "0.7"]
    subprocess.run([etendue, "render", str(SCENES / scene), *flags, *size, "-o", str(exr), "-o", str(png)], check=True)
    with OpenEXR.File(str(exr), separate_channels=True) as f:
        channels = f.channels()
        pixels = np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float64)
    return pixels, Image.open(png).convert("RGB")


def lights(args: argparse.Namespace) -> None:
    """Print how far depth maps are from shadow rays for each kind of light."""
    text = (SCENES / "shadows.xml").read_text(encoding="utf-8")
    start = text.rindex('<shape type="rectangle">')
    for name, light in LIGHTS.items():
        with tempfile.TemporaryDirectory() as folder:
            scene = Path(folder) / "scene.xml"
            scene.write_text(text[:start] + light + "</scene>", encoding="utf-8")
            truth = render(args.etendue, str(scene), ["--integrator", "path", "--max-depth", "1"], args, Path(folder))[0]
            for kind in ("hard", "pcf", "pcss"):
                pixels = render(args.etendue, str(scene), [*RASTER, "--shadow-filter", kind], args, Path(folder))[0]
                difference = np.abs(pixels - truth).mean(-1) / truth.mean()
                share = (difference > 0.1).mean()
                print(f"| {name} | {kind} | {pixels.mean() / truth.mean():.4f} | {difference.mean():.4f} | {share:.2%} |")


def montage(pictures: dict[str, Image.Image], columns: int) -> Image.Image:
    """Pictures in rows, each with its name."""
    width, height = next(iter(pictures.values())).size
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * width, rows * height))
    draw = ImageDraw.Draw(sheet)
    for i, (name, picture) in enumerate(pictures.items()):
        x, y = i % columns * width, i // columns * height
        sheet.paste(picture, (x, y))
        draw.text((x + 6, y + 5), name, fill="black")
        draw.text((x + 5, y + 4), name, fill="white")
    return sheet


def main() -> None:
    """Render, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--etendue", default="etendue")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--lights", action="store_true", help="only the table of lights without a size")
    args = parser.parse_args()
    FIGURES.mkdir(parents=True, exist_ok=True)
    jobs = [("shadows.xml", SHADOWS, 4, "shadow-maps.jpg"), ("mirror-room.xml", MIRRORS, 3, "environment-maps.jpg")]
    lights(args)
    for scene, variants, columns, name in jobs if not args.lights else []:
        with tempfile.TemporaryDirectory() as folder:
            made = {key: render(args.etendue, scene, flags, args, Path(folder)) for key, flags in variants.items()}
        truth = made["rays"][0]
        print(f"{scene}: mean of the picture, mean absolute difference from rays (both relative to the mean by rays)")
        for key, (pixels, _) in made.items():
            print(f"  {key:16} {pixels.mean() / truth.mean():.4f}  {np.abs(pixels - truth).mean() / truth.mean():.4f}")
        montage({key: picture for key, (_, picture) in made.items()}, columns).save(FIGURES / name, quality=85)


if __name__ == "__main__":
    main()
