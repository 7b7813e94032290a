"""Measure the radiosity solvers: agreement with the path tracer, error against seconds, growth with the number of elements.

    python bench/radiosity.py [agree] [speed] [grow] [--etendue target/release/etendue] [--folder docs/theory/radiosity] [--keep FOLDER]

`agree`: the Cornell box and the furnished room of this repository by each solver, beside the path tracer. A region is a tile of 8 × 8
pixels that shows one smooth surface and has no geometric edge within two pixels; printed are the error of the mean over all regions and
those of single regions. `speed`: the same over settings, with a chart of error against seconds of processor time (speed.svg). `grow`:
rooms of 10k, 100k and 1M polygons: seconds, links, peak memory (grow.svg). Without a word: all three. Times are processor time of
all threads, so that other work on the machine does not matter. Needs NumPy and OpenEXR.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).parent.parent
SCENES = {"Cornell box": ROOT / "scenes/radiosity/cornell.xml", "furnished room": ROOT / "scenes/baking/room.xml"}
WIDTH = 192
TILE = 8
MARGIN = 2
SETTINGS: dict[str, list[str]] = {
    "hierarchical": [],
    "progressive": [],
    "matrix": [],
}
RUNS: dict[str, list[list[str]]] = {
    "hierarchical": [["--radiosity-rays", n] for n in ("4", "16", "64", "256")],
    "hierarchical alone": [["--radiosity-rays", "0", "--radiosity-error", e] for e in ("1e-2", "2e-3", "4e-4")],
    "progressive": [["--radiosity-elements", n] for n in ("300", "1000", "3000")],
    "matrix": [["--radiosity-elements", n] for n in ("300", "1000", "3000")],
}
COLORS = {"hierarchical": "#1f77b4", "hierarchical alone": "#9ecae1", "progressive": "#2ca02c", "matrix": "#d62728"}
Point = tuple[float, float]


def run(etendue: str, scene: Path, arguments: list[str], output: Path) -> tuple[float, float, list[str]]:
    """Render; return seconds of processor time, peak memory in MiB and what was printed."""
    command = [etendue, "render", str(scene), *arguments, "-o", str(output)]
    with tempfile.TemporaryFile("w+", encoding="utf-8") as log:
        child = subprocess.Popen(command, stdout=log, stderr=log)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        log.seek(0)
        text = log.read()
    if child.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {text}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, text.splitlines()


def channels(path: Path) -> dict[str, np.ndarray]:
    """Return the channels of an EXR file as float64 planes."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.asarray(channel.pixels, dtype=np.float64) for name, channel in file.channels().items()}


class Reference:
    """A scene by the path tracer, with the tiles that show one smooth surface away from edges."""

    def __init__(self, etendue: str, scene: Path, spp: int, folder: Path) -> None:
        """Render it, or take what an earlier run left."""
        self.scene = scene
        file = folder / f"{scene.stem}-{spp}.exr"
        if not file.exists():
            run(etendue, scene, ["--width", str(WIDTH), "--spp", str(spp), "--sampler", "sobol", "--quiet"], file)
        # One sample at the pixels' middles: where the edges are.
        guide = folder / f"{scene.stem}-guide.exr"
        if not guide.exists():
            run(etendue, scene, ["--width", str(WIDTH), "--spp", "16", "--aov", "object,normal", "--quiet"], guide)
        planes = channels(guide)
        self.picture = rgb(channels(file))
        self.tiles = self.regions(planes["id.object"], np.stack([planes[f"N.{c}"] for c in "XYZ"], -1))

    def regions(self, objects: np.ndarray, normals: np.ndarray) -> list[tuple[slice, slice]]:
        """Return the tiles whose pixels, and those of a margin, are of one object whose normals turn slowly; no lights."""
        found = []
        height, width = objects.shape
        lengths = np.linalg.norm(normals, axis=-1)
        for y in range(MARGIN, height - TILE - MARGIN + 1, TILE):
            for x in range(MARGIN, width - TILE - MARGIN + 1, TILE):
                around = (slice(y - MARGIN, y + TILE + MARGIN), slice(x - MARGIN, x + TILE + MARGIN))
                n = normals[around]
                turn = max(np.abs(np.diff(n, axis=k)).max() for k in (0, 1))
                tile = (slice(y, y + TILE), slice(x, x + TILE))
                is_one = np.ptp(objects[around]) == 0 and turn < 0.12 and lengths[around].min() > 0.99
                if is_one and 0.0 < self.picture[tile].mean((0, 1)).max() < LIGHT:
                    found.append(tile)
        return found

    def errors(self, picture: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the relative error of the mean over all regions, and that of each region (of its mean over colors)."""
        ours = np.array([picture[t].mean() for t in self.tiles])
        theirs = np.array([self.picture[t].mean() for t in self.tiles])
        return float(ours.mean() / theirs.mean() - 1), ours / theirs - 1


# What is brighter than this in a reference is a light.
LIGHT = 3.0


def rgb(planes: dict[str, np.ndarray]) -> np.ndarray:
    """Return (height, width, 3)."""
    return np.stack([planes[c] for c in "RGB"], -1)


def solve(
    etendue: str, reference: Reference, method: str, arguments: list[str], folder: Path
) -> tuple[float, float, np.ndarray, list[str]]:
    """Solve and draw; return seconds, the error of the mean, those of regions, and the notes."""
    output = folder / f"{reference.scene.stem}-{method.replace(' ', '-')}.exr"
    flags = ["--integrator", "radiosity", "--radiosity-method", method.split()[0], *arguments, "--width", str(WIDTH), "--spp", "16"]
    seconds, _, lines = run(etendue, reference.scene, flags, output)
    mean, errors = reference.errors(rgb(channels(output)))
    return seconds, mean, errors, lines


def agree(etendue: str, references: dict[str, Reference], folder: Path) -> None:
    """Print how far each solver is from the path tracer."""
    print("| scene | method | mean of all regions | worst region | 95% of regions within | regions beyond 3% | seconds |")
    print("|---|---|---|---|---|---|---|")
    for name, reference in references.items():
        for method, arguments in SETTINGS.items():
            seconds, mean, errors, _ = solve(etendue, reference, method, arguments, folder)
            size = np.abs(errors)
            worst = errors[size.argmax()]
            beyond = f"{(size > 0.03).sum()} of {size.size}"
            print(
                f"| {name} | {method} | {mean:+.2%} | {worst:+.1%} | {np.quantile(size, 0.95):.1%} | {beyond} | {seconds:.1f} |", flush=True
            )
            for k in np.argsort(-size)[:4]:
                y, x = reference.tiles[k]
                print(f"    region at {x.start}, {y.start}: {errors[k]:+.2%}", flush=True)


def speed(etendue: str, references: dict[str, Reference], folder: Path, charts: Path) -> None:
    """Print a table of error and time of the first scene, and draw it."""
    name, reference = next(iter(references.items()))
    points: dict[str, list[Point]] = {}
    print(f"| {name}: method | setting | seconds | mean | error (root mean square of regions) |\n|---|---|---|---|---|")
    for method, runs in RUNS.items():
        for arguments in runs:
            seconds, mean, errors, _ = solve(etendue, reference, method, arguments, folder)
            error = math.sqrt(np.mean(errors**2))
            points.setdefault(method, []).append((seconds, error))
            setting = " ".join(arguments).replace("--radiosity-", "")
            print(f"| {method} | {setting} | {seconds:.2f} | {mean:+.2%} | {error:.2%} |", flush=True)
    (charts / "speed.svg").write_text(chart(points, "s", "%", 100), encoding="utf-8")


def chart(points: dict[str, list[Point]], x_unit: str, y_unit: str, y_factor: float) -> str:
    """Return a log-log chart as SVG."""
    width, height, margin = 560, 360, 56
    every = [p for line in points.values() for p in line]
    low = [math.floor(math.log10(min(p[i] for p in every))) for i in (0, 1)]
    high = [math.ceil(math.log10(max(p[i] for p in every))) for i in (0, 1)]

    def at(p: Point) -> Point:
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
        out.append(f'<text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle">{10.0**k:g} {x_unit}</text>')
    for k in range(low[1], high[1] + 1):
        x, y = at((10.0 ** low[0], 10.0**k))
        out.append(f'<path d="M{x:.1f} {y:.1f}H{width - margin}" stroke="#ddd"/>')
        out.append(f'<text x="{x - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{y_factor * 10.0**k:g} {y_unit}</text>')
    for i, (name, line) in enumerate(points.items()):
        color = COLORS.get(name, "#888")
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, line))
        out.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{color}"/>' for x, y in map(at, line)]
        out.append(f'<text x="{width - margin}" y="{margin + 16 * i:.1f}" text-anchor="end" fill="{color}">{name}</text>')
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


def grow(etendue: str, charts: Path) -> None:
    """Print how time, links and memory grow with the polygons of a room, and draw it."""
    points: list[Point] = []
    print("| polygons | elements | links | seconds | microseconds per element | peak memory |\n|---|---|---|---|---|---|")
    for polygons in (10_000, 100_000, 1_000_000):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "floor.obj").write_text(room(round(math.sqrt(polygons / 2))), encoding="utf-8")
            scene = Path(folder) / "scene.xml"
            scene.write_text(GROW_SCENE, encoding="utf-8")
            seconds, peak, lines = run(etendue, scene, ["--integrator", "radiosity", "--spp", "1"], Path(folder) / "out.exr")
        note = next(line for line in lines if line.startswith("hierarchical:"))
        elements, links = (int(n) for n in re.findall(r"(\d+) (?:elements|links)", note))
        points.append((elements, seconds))
        print(f"| {polygons} | {elements} | {links} | {seconds:.1f} | {1e6 * seconds / elements:.0f} | {peak:.0f} MiB |", flush=True)
    line = {"hierarchical": points, "proportional": [(n, points[0][1] * n / points[0][0]) for n, _ in points]}
    (charts / "grow.svg").write_text(chart(line, "elements", "s", 1), encoding="utf-8")


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", help="agree, speed, grow; all where nothing is given")
    parser.add_argument("--etendue", default=str(ROOT / "target/release/etendue"))
    parser.add_argument("--folder", type=Path, default=ROOT / "docs/theory/radiosity", help="where charts go")
    parser.add_argument("--spp", type=int, default=1024, help="of the path-traced references")
    parser.add_argument("--keep", type=Path, help="where pictures stay; references that are there are used again")
    arguments = parser.parse_args()
    known = ["agree", "speed", "grow"]
    what = arguments.what or known
    if not set(what) <= set(known):
        parser.error(f"there are {', '.join(known)}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        if "agree" in what or "speed" in what:
            references = {name: Reference(arguments.etendue, scene, arguments.spp, folder) for name, scene in SCENES.items()}
            if "agree" in what:
                agree(arguments.etendue, references, folder)
            if "speed" in what:
                speed(arguments.etendue, references, folder, arguments.folder)
        if "grow" in what:
            grow(arguments.etendue, arguments.folder)


if __name__ == "__main__":
    main()
