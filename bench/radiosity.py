"""Error against seconds of each radiosity solver, and how hierarchical radiosity grows with the number of elements.

    python bench/radiosity.py SCENE.xml REFERENCE.exr [--etendue target/release/etendue] [--plot FILE.svg] [--grow]

SCENE has to be diffuse and REFERENCE a picture of it by another method, of a multiple of the width that is rendered. The error is the root
mean square of the relative differences of 15×15-pixel tiles. `--grow` solves rooms of 10k, 100k and 1M elements and prints seconds,
links and memory. Needs the package `etendue` for EXR files; plots are written as SVG without further packages.
"""

from __future__ import annotations

import argparse
import math
import re
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import etendue

TILE = 15
WIDTH = 200
RUNS = {
    "hierarchical": [("error", e) for e in ("1e-2", "3e-3", "1e-3", "3e-4", "1e-4")],
    "progressive": [("elements", n) for n in ("500", "1500", "4000")],
    "matrix": [("elements", n) for n in ("300", "800", "2000")],
}
COLORS = {"hierarchical": "#1f77b4", "progressive": "#2ca02c", "matrix": "#d62728"}


def pixels(path: Path) -> np.ndarray:
    """Return the color planes of an EXR file as (height, width, 3)."""
    image = etendue.read_image(path)
    return np.asarray(image, dtype=float)[..., :3]


def tiles(picture: np.ndarray) -> np.ndarray:
    """Return the means of whole tiles."""
    h, w = (n // TILE * TILE for n in picture.shape[:2])
    means: np.ndarray = picture[:h, :w].reshape(h // TILE, TILE, w // TILE, TILE, 3).mean((1, 3))
    return means


def solve(program: str, scene: Path, arguments: list[str], output: Path) -> tuple[float, list[str]]:
    """Run a solver; return the seconds and what it printed."""
    command = [program, "render", str(scene), "--integrator", "radiosity", *arguments, "-o", str(output)]
    start = time.perf_counter()
    result = subprocess.run(command, check=True, capture_output=True, text=True)
    return time.perf_counter() - start, result.stderr.splitlines()


def compare(program: str, scene: Path, reference_file: Path, plot: Path | None) -> None:
    """Print a table of error and time, and draw it."""
    reference = pixels(reference_file)
    factor = reference.shape[1] // WIDTH
    h, w = reference.shape[0] // factor, reference.shape[1] // factor
    reference = reference[: h * factor, : w * factor].reshape(h, factor, w, factor, 3).mean((1, 3))
    # Visible lights are right by definition and would hide everything else.
    lit = reference.max(-1, keepdims=True) < 5
    points: dict[str, list[tuple[float, float]]] = {}
    print("| method | setting | seconds | mean | error |\n|---|---|---|---|---|")
    for method, runs in RUNS.items():
        for name, value in runs:
            with tempfile.TemporaryDirectory() as folder:
                output = Path(folder) / "out.exr"
                arguments = ["--radiosity-method", method, f"--radiosity-{name}", value, "--width", str(WIDTH), "--spp", "4"]
                seconds, _ = solve(program, scene, arguments, output)
                picture = pixels(output)
            mean = (picture * lit).mean() / (reference * lit).mean() - 1
            a, b = tiles(picture * lit), tiles(reference * lit)
            error = math.sqrt(np.mean(((a - b) / np.maximum(b, 1e-3 * b.max())) ** 2))
            points.setdefault(method, []).append((seconds, error))
            print(f"| {method} | {name} {value} | {seconds:.2f} | {mean:+.2%} | {error:.2%} |", flush=True)
    if plot:
        plot.write_text(chart(points), encoding="utf-8")


def chart(points: dict[str, list[tuple[float, float]]]) -> str:
    """Return a log-log chart as SVG."""
    width, height, margin = 560, 360, 56
    every = [p for line in points.values() for p in line]
    low = [math.floor(math.log10(min(p[i] for p in every))) for i in (0, 1)]
    high = [math.ceil(math.log10(max(p[i] for p in every))) for i in (0, 1)]

    def at(p: tuple[float, float]) -> tuple[float, float]:
        x = (math.log10(p[0]) - low[0]) / max(high[0] - low[0], 1)
        y = (math.log10(p[1]) - low[1]) / max(high[1] - low[1], 1)
        return margin + x * (width - 2 * margin), height - margin - y * (height - 2 * margin)

    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for k in range(low[0], high[0] + 1):
        x, y = at((10.0**k, 10.0 ** low[1]))
        out.append(f'<path d="M{x:.1f} {margin}V{y:.1f}" stroke="#ddd"/>')
        out.append(f'<text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle">{10.0**k:g} s</text>')
    for k in range(low[1], high[1] + 1):
        x, y = at((10.0 ** low[0], 10.0**k))
        out.append(f'<path d="M{x:.1f} {y:.1f}H{width - margin}" stroke="#ddd"/>')
        out.append(f'<text x="{x - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{100 * 10.0**k:g} %</text>')
    for i, (method, line) in enumerate(points.items()):
        color = COLORS[method]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, line))
        out.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{color}"/>' for x, y in map(at, line)]
        out.append(f'<text x="{width - margin}" y="{margin + 16 * i:.1f}" text-anchor="end" fill="{color}">{method}</text>')
    out.append("</svg>")
    return "\n".join(out) + "\n"


def room(cells: int) -> str:
    """Return an OBJ file: a floor of `cells`² pairs of triangles in slight relief."""
    rng = np.random.default_rng(1)
    n = cells
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    z = 0.03 * np.sin(9 * x) * np.cos(7 * y) + 0.2 / n * rng.random(x.shape) - 0.9
    vertices = np.stack([x, z, -y], -1).reshape(-1, 3)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)[None]).reshape(-1)
    faces = np.concatenate([np.stack([a, a + 1, a + n + 2], -1), np.stack([a, a + n + 2, a + n + 1], -1)])
    lines = [f"v {p[0]:.6f} {p[1]:.6f} {p[2]:.6f}" for p in vertices] + [f"f {f[0] + 1} {f[1] + 1} {f[2] + 1}" for f in faces]
    return "\n".join(lines) + "\n"


GROW_SCENE = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="60"/>
<transform name="to_world"><lookat origin="0,0,0.9" target="0,-0.3,-1" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film></sensor>
<shape type="cube"><boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
<shape type="obj"><string name="filename" value="floor.obj"/><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate y="0.95"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
<emitter type="area"><rgb name="radiance" value="10"/></emitter></shape></scene>
"""


def grow(program: str) -> None:
    """Print how time, links and memory grow with the polygons of a room."""
    print("| polygons | elements | links | seconds | microseconds per element | peak memory |\n|---|---|---|---|---|---|")
    for polygons in (10_000, 100_000, 1_000_000):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "floor.obj").write_text(room(round(math.sqrt(polygons / 2))), encoding="utf-8")
            scene = Path(folder) / "scene.xml"
            scene.write_text(GROW_SCENE, encoding="utf-8")
            seconds, lines = solve(program, scene, ["--spp", "1"], Path(folder) / "out.exr")
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        note = next(line for line in lines if line.startswith("hierarchical:"))
        elements, links = (int(n) for n in re.findall(r"(\d+) (?:elements|links)", note))
        print(f"| {polygons} | {elements} | {links} | {seconds:.1f} | {1e6 * seconds / elements:.0f} | {peak:.0f} MiB |", flush=True)


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, nargs="?")
    parser.add_argument("reference", type=Path, nargs="?")
    parser.add_argument("--etendue", default="target/release/etendue")
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--grow", action="store_true")
    arguments = parser.parse_args()
    if arguments.scene and arguments.reference:
        compare(arguments.etendue, arguments.scene, arguments.reference, arguments.plot)
    if arguments.grow:
        grow(arguments.etendue)


if __name__ == "__main__":
    main()
