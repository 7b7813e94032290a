"""Measure the radiosity solvers: agreement with the path tracer, error against seconds, growth with the number of elements.

    python bench/radiosity.py [agree] [speed] [grow] [bake] [--etendue target/release/etendue]
        [--folder docs/theory/radiosity] [--keep FOLDER]

`agree`: the Cornell box and the furnished room of this repository by each solver, beside the path tracer. A region is a tile of 8 × 8
pixels that shows one smooth surface and has no geometric edge within two pixels; printed are the error of the mean over all regions and
those of single regions. `speed`: the same over settings, with a chart of error against seconds of processor time (speed.svg). `grow`:
rooms of 10k, 100k and 1M polygons: seconds, links, peak memory (grow.svg). Without a word: all three. Times are processor time of
all threads, so that other work on the machine does not matter. Needs NumPy and OpenEXR.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import struct
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).parent.parent
SCENES = {"Cornell box": ROOT / "scenes/radiosity/cornell.xml", "furnished room": ROOT / "scenes/baking/room.xml"}
WIDTH = 192
# Regions of a reference with a larger relative standard error get more samples.
NOISE = 0.005
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
        self.etendue = etendue
        self.folder = folder
        base = ["--width", str(WIDTH), "--sampler", "sobol"]
        picture = self.render(f"{scene.stem}-{spp}", [*base, "--spp", str(spp)])
        # Where the edges are, and how uncertain a sample is.
        guide = self.render(f"{scene.stem}-guide", ["--width", str(WIDTH), "--spp", "64", "--aov", "object,normal,variance"])
        self.picture = rgb(picture)
        self.tiles = self.regions(guide["id.object"], np.stack([guide[f"N.{c}"] for c in "XYZ"], -1))
        # Variances of the mean of colors by one sample; their standard deviations are added as if the noise of colors were the same.
        variance = np.mean([np.sqrt(guide[f"variance.{c}"]) for c in "RGB"], 0) ** 2 * 64
        self.means = np.zeros(len(self.tiles))
        self.noise = np.zeros(len(self.tiles))
        for k, tile in enumerate(self.tiles):
            mean, samples = self.picture[tile].mean(), spp
            one = math.sqrt(variance[tile].mean()) / TILE / mean
            needed = (one / NOISE) ** 2
            if needed > spp:
                more = min(256 * math.ceil((needed - spp) / 256), 1 << 17)
                crop = f"{tile[1].start},{tile[0].start},{tile[1].stop},{tile[0].stop}"
                flags = [*base, "--spp", str(more), "--seed", "1", "--crop", crop]
                part = rgb(self.render(f"{scene.stem}-{spp}-{tile[1].start}-{tile[0].start}-{more}", flags))
                part = part if part.shape[0] == TILE else part[tile]
                mean = (mean * spp + part.mean() * more) / (spp + more)
                samples = spp + more
            self.means[k], self.noise[k] = mean, one / math.sqrt(samples)

    def render(self, name: str, flags: list[str]) -> dict[str, np.ndarray]:
        """Return the channels of a picture of the scene, rendered where there is none yet."""
        file = self.folder / f"{name}.exr"
        if not file.exists():
            run(self.etendue, self.scene, [*flags, "--quiet"], file)
        return channels(file)

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
        return float(ours.mean() / self.means.mean() - 1), ours / self.means - 1


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


class Atlas:
    """The layout of a baked GLB file: blocks of texels that are of one chart, away from its border, and in the open."""

    def __init__(self, path: Path, size: int) -> None:
        """Read the file; draw its triangles into a square of `size` texels."""
        data = path.read_bytes()
        length = struct.unpack_from("<I", data, 12)[0]
        self.doc = json.loads(data[20 : 20 + length])
        self.binary = data[28 + length :]
        uv_set = self.doc["scenes"][0]["extras"]["etendue"]["lightmap"]["texCoord"]
        corners, places, charts = [], [], []
        for node in self.doc["nodes"]:
            # Baked meshes are in world space.
            for part in self.doc["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
                if f"TEXCOORD_{uv_set}" not in part["attributes"]:
                    continue
                positions = self.numbers(part["attributes"]["POSITION"])
                uv = self.numbers(part["attributes"][f"TEXCOORD_{uv_set}"])
                triangles = self.numbers(part["indices"]).reshape(-1, 3).astype(int)
                corners.append(positions[triangles])
                places.append(uv[triangles] * size)
                charts.append(connected(triangles) + (charts[-1].max() + 1 if charts else 0))
        self.corners, self.charts = np.concatenate(corners), np.concatenate(charts)
        self.chart = np.full((size, size), -1)
        self.point = np.zeros((size, size, 3))
        for corners_of, place, chart in zip(self.corners, np.concatenate(places), self.charts, strict=True):
            self.draw(corners_of, place, int(chart))
        self.blocks = self.open_blocks(size)

    def numbers(self, accessor: int) -> np.ndarray:
        """Return the numbers of an accessor, one row for each element."""
        a = self.doc["accessors"][accessor]
        view = self.doc["bufferViews"][a["bufferView"]]
        kind = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}[a["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[a["type"]]
        start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
        values = np.frombuffer(self.binary, kind, a["count"] * width, start)
        return values.reshape(-1, width).astype(np.float64)

    def draw(self, corners: np.ndarray, place: np.ndarray, chart: int) -> None:
        """Mark the texels whose middles a triangle holds."""
        low, high = np.floor(place.min(0)).astype(int), np.ceil(place.max(0)).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        (ax, ay), (bx, by), (cx, cy) = place
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0 or x.size == 0:
            return
        b = ((x + 0.5 - ax) * (cy - ay) - (cx - ax) * (y + 0.5 - ay)) / area
        c = ((bx - ax) * (y + 0.5 - ay) - (x + 0.5 - ax) * (by - ay)) / area
        inside = (b >= 0) & (c >= 0) & (b + c <= 1)
        weights = np.stack([1 - b - c, b, c], -1)[inside]
        self.chart[y[inside], x[inside]] = chart
        self.point[y[inside], x[inside]] = weights @ corners

    def open_blocks(self, size: int) -> list[tuple[slice, slice]]:
        """Return the blocks of one chart, with a margin, at whose corners and middle no other surface is near."""
        found = []
        for y in range(MARGIN, size - TILE - MARGIN + 1, TILE):
            for x in range(MARGIN, size - TILE - MARGIN + 1, TILE):
                around = self.chart[y - MARGIN : y + TILE + MARGIN, x - MARGIN : x + TILE + MARGIN]
                if around.min() >= 0 and np.ptp(around) == 0 and self.is_open(self.point[y : y + TILE, x : x + TILE]):
                    found.append((slice(y, y + TILE), slice(x, x + TILE)))
        return found

    def is_open(self, points: np.ndarray) -> bool:
        """Whether a block is flat and neither in another body nor cut by one: up and down along its normal, the same surfaces are met."""
        p = points[:: TILE - 1, :: TILE - 1].reshape(-1, 3)
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        length = np.linalg.norm(normal)
        if length == 0 or abs((p[3] - p[0]) @ normal) > 1e-4 * length * np.linalg.norm(p[3] - p[0]):
            return False
        normal /= length
        lines = [self.meet(q, normal) for q in [*p, points[TILE // 2, TILE // 2]]]
        met = {tuple(np.unique(self.charts[np.abs(t) < NEAR])) for t in lines}
        # Where two surfaces touch no one sees either.
        return len(met) == 1 and all((np.abs(t) < 1e-4).sum() == 1 for t in lines)

    def meet(self, p: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Return where the line p + t d meets each triangle; infinity where it does not (Möller and Trumbore 1997)."""
        a, e1, e2 = self.corners[:, 0], self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        h = np.cross(d, e2)
        det = np.einsum("ij,ij->i", e1, h)
        det[np.abs(det) < 1e-12] = np.inf
        s = p - a
        u = np.einsum("ij,ij->i", s, h) / det
        q = np.cross(s, e1)
        v = q @ d / det
        t = np.einsum("ij,ij->i", e2, q) / det
        return np.where(np.isfinite(det) & (u >= 0) & (v >= 0) & (u + v <= 1), t, np.inf)


def connected(triangles: np.ndarray) -> np.ndarray:
    """Return for each triangle the number of the part that it is connected with by common vertices."""
    label = np.arange(triangles.max() + 1)
    while True:
        least = label[triangles].min(1)
        following = label.copy()
        np.minimum.at(following, triangles.ravel(), np.repeat(least, 3))
        if (following == label).all():
            return np.unique(label[triangles[:, 0]], return_inverse=True)[1]
        label = following


# Seeds and settings of each way to bake.
BAKES: dict[str, tuple[int, list[str]]] = {
    "path": (4, ["--spp", "256"]),
    "radiosity": (2, []),
    "radiosity, gathered": (2, ["--final-gather", "--spp", "64"]),
    "particles": (2, ["--photons", "4000000"]),
    "particles, gathered": (2, ["--final-gather", "--spp", "64"]),
}
BAKE_SIZE = 256
# Blocks of texels are left out where something stands within this distance (scene units) above or below a part of them.
NEAR = 0.1
# What is darker than this share of the mean is left out.
DARKEST = 0.01


def bake(etendue: str, folder: Path) -> None:
    """Print how far the methods of baking are from each other, block by block and chart by chart of a lightmap."""
    glb = folder / "room.glb"
    subprocess.run([etendue, "convert", str(SCENES["furnished room"]), str(glb), "--quiet"], check=True)
    maps: dict[str, list[np.ndarray]] = {}
    atlas = None
    for method, (seeds, flags) in BAKES.items():
        maps[method] = []
        for seed in range(seeds):
            out = folder / f"baked-{method.replace(', ', '-')}-{seed}.glb"
            if not out.exists():
                command = [etendue, "bake", str(glb), "-o", str(out), "--method", method.split(",")[0], "--exr", "--quiet"]
                subprocess.run([*command, "--resolution", str(BAKE_SIZE), "--seed", str(seed), *flags], check=True)
            maps[method].append(rgb(channels(out.with_suffix(".0.exr"))))
            atlas = atlas or Atlas(out, BAKE_SIZE)
    assert atlas is not None
    print("| regions | method | mean of all | standard error, path's, its own | rms difference | that without noise | beyond 2% and 3 σ |")
    print("|---|---|---|---|---|---|---|")
    of_block = [int(atlas.chart[block][0, 0]) for block in atlas.blocks]
    every = np.unique(of_block)
    for what in ("blocks", "charts"):
        # Means of blocks, or of all blocks of a chart; rows are seeds.
        means = {method: np.array([[p[block].mean() for block in atlas.blocks] for p in pictures]) for method, pictures in maps.items()}
        if what == "charts":
            means = {k: np.stack([v[:, [c == chart for c in of_block]].mean(1) for chart in every], 1) for k, v in means.items()}
        reference = means["path"].mean(0)
        lit = reference > DARKEST * reference.mean()
        for method, values in means.items():
            if method == "path":
                continue
            differences = values[:, lit].mean(0) / reference[lit] - 1
            noise = [standard_error(v[:, lit]) for v in (means["path"], values)]
            rms = math.sqrt(np.mean(differences**2))
            sure = np.abs(differences) > 0.02 + 3 * math.hypot(*noise)
            without = math.sqrt(max(rms**2 - noise[0] ** 2 - noise[1] ** 2, 0))
            mean = values[:, lit].mean() / reference[lit].mean() - 1
            errors = f"{noise[0]:.2%}, {noise[1]:.2%}"
            row = [f"{lit.sum()} {what}", method, f"{mean:+.2%}", errors, f"{rms:.2%}", f"{without:.2%}", sure.sum()]
            print("|", " | ".join(map(str, row)), "|", flush=True)


def standard_error(values: np.ndarray) -> float:
    """Return the relative standard error of the mean over seeds (rows), in the root mean square over regions (columns)."""
    relative = values / values.mean(0)
    return float(np.sqrt(relative.var(0, ddof=1).mean() / len(values)))


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", help="agree, speed, grow, bake; all where nothing is given")
    parser.add_argument("--etendue", default=str(ROOT / "target/release/etendue"))
    parser.add_argument("--folder", type=Path, default=ROOT / "docs/theory/radiosity", help="where charts go")
    parser.add_argument("--spp", type=int, default=1024, help="of the path-traced references")
    parser.add_argument("--keep", type=Path, help="where pictures stay; references that are there are used again")
    arguments = parser.parse_args()
    known = ["agree", "speed", "grow", "bake"]
    what = arguments.what or known
    if not set(what) <= set(known):
        parser.error(f"there are {', '.join(known)}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        arguments.folder.mkdir(parents=True, exist_ok=True)
        if "agree" in what or "speed" in what:
            references = {name: Reference(arguments.etendue, scene, arguments.spp, folder) for name, scene in SCENES.items()}
            if "agree" in what:
                agree(arguments.etendue, references, folder)
            if "speed" in what:
                speed(arguments.etendue, references, folder, arguments.folder)
        if "grow" in what:
            grow(arguments.etendue, arguments.folder)
        if "bake" in what:
            bake(arguments.etendue, folder)


if __name__ == "__main__":
    main()
