"""Which renderer makes the best picture of the CPU time that it gets?

Renders scenes that have a reference picture by Etendue and by every peer that is installed, in turns, at growing numbers of samples,
and writes a table of efficiencies and a plot of the errors over time:

    python bench/efficiency.py SCENES_FOLDER [--seconds 12] [--rounds 2] [--methods path,auto] [-o out/efficiency] [NAME ...]

SCENES_FOLDER holds NAME.xml or NAME/scene.xml, and refs/NAME.exr. Efficiency = 1 / (relMSE × CPU seconds): higher is better. relMSE =
mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels. CPU seconds of all threads; loading and compiling are left
out, which are measured by a picture of one sample; what a method prepares counts. No denoiser.

Peers: Mitsuba 3 from PyPI, in its scalar and its LLVM mode (libLLVM 16 or later; DRJIT_LIBLLVM_PATH names it). Cycles, LuxCore and
POV-Ray do not read these scenes and are not measured. Run it on a machine that does nothing else: a ratio is good to 1.3 at best.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from agreement import relmse, scene_file

import etendue

SCENES = ["cornell", "veach-mis", "caustic", "env-materials", "many-lights", "kitchen"]
COLORS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b"]
# Reads a job in JSON, loads, and tells the CPU seconds of each picture.
MITSUBA = """
import json, sys, time
import numpy as np
job = json.loads(sys.argv[1])
import mitsuba as mi
mi.set_variant(job["variant"])
scene = mi.load_file(job["scene"])
def render(spp, seed):
    start = time.process_time()
    picture = np.array(mi.render(scene, spp=spp, seed=seed))[..., :3]
    return picture, time.process_time() - start
render(1, 0)
picture, seconds = render(job["spp"], job["seed"])
np.save(job["out"], picture)
print(seconds)
"""

Render = Callable[[Path, int, int], tuple[np.ndarray, float]]


@dataclass
class Point:
    """A picture: samples per pixel, CPU seconds, relMSE."""

    spp: int
    seconds: float
    error: float


def cpu_seconds() -> float:
    """Return the CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def ours(command: str, method: str) -> Render:
    """Return a function that renders by a method of ours."""

    def run(scene: Path, spp: int, seed: int) -> tuple[np.ndarray, float]:
        with tempfile.TemporaryDirectory() as folder:
            out = f"{folder}/picture.exr"
            before = cpu_seconds()
            options = ["--spp", str(spp), "--seed", str(seed), "--filter", "box", "--integrator", method]
            subprocess.run([command, "render", str(scene), *options, "-q", "-o", out], check=True)
            used = cpu_seconds() - before
            return np.asarray(etendue.read_image(out))[..., :3], used - load_seconds(command, scene)

    return run


LOADED: dict[Path, float] = {}


def load_seconds(command: str, scene: Path) -> float:
    """Return the CPU seconds of a run that does next to nothing after loading."""
    if scene not in LOADED:
        with tempfile.TemporaryDirectory() as folder:
            before = cpu_seconds()
            size = ["--width", "16", "--height", "16", "--spp", "1", "--integrator", "normals"]
            subprocess.run([command, "render", str(scene), *size, "-q", "-o", f"{folder}/picture.exr"], check=True)
            LOADED[scene] = cpu_seconds() - before
    return LOADED[scene]


def mitsuba(python: str, variant: str) -> Render:
    """Return a function that renders by Mitsuba."""

    def run(scene: Path, spp: int, seed: int) -> tuple[np.ndarray, float]:
        with tempfile.TemporaryDirectory() as folder:
            job = {"variant": variant, "scene": str(scene), "spp": spp, "seed": seed, "out": f"{folder}/picture.npy"}
            done = subprocess.run([python, "-c", MITSUBA, json.dumps(job)], check=True, capture_output=True, text=True)
            return np.load(job["out"]), float(done.stdout.split()[-1])

    return run


def peers(args: argparse.Namespace) -> dict[str, Render]:
    """Return what can render here, ours first; says what cannot, and why."""
    found: dict[str, Render] = {f"etendue {m}": ours(args.etendue, m) for m in args.methods.split(",")}
    for variant in ("scalar_rgb", "llvm_ad_rgb"):
        probe = f"import mitsuba as mi; mi.set_variant('{variant}'); print(mi.render(mi.load_dict(mi.cornell_box()), spp=1))"
        tried = subprocess.run([args.python, "-c", probe], capture_output=True, text=True, check=False)
        if tried.returncode == 0:
            found[f"Mitsuba {variant}"] = mitsuba(args.python, variant)
        else:
            why = tried.stderr.strip().splitlines()[-1:] or [f"exit status {tried.returncode}"]
            print(f"not measured: Mitsuba {variant}: {why[0]}", file=sys.stderr)
    return found


def curve(render: Render, scene: Path, reference: np.ndarray, seconds: float, rounds: int) -> list[Point]:
    """Render with twice the samples each time until a picture takes the seconds; errors and times are means over seeds."""
    points: list[Point] = []
    spp = 2
    while True:
        figures = []
        for seed in range(1, rounds + 1):
            picture, used = render(scene, spp, seed)
            figures.append((max(used, 1e-3), relmse(picture.astype(np.float64), reference)))
        points.append(Point(spp, *(float(np.mean([f[i] for f in figures])) for i in (0, 1))))
        if points[-1].seconds * 1.5 > seconds or spp >= 1 << 20:
            return points
        spp *= 2


def efficiency(points: list[Point]) -> float:
    """Return 1 / (relMSE × CPU seconds) of the largest picture."""
    return 1.0 / max(points[-1].error * points[-1].seconds, 1e-300)


def plot(title: str, curves: dict[str, list[Point]]) -> str:
    """Return an SVG picture of errors over seconds, both logarithmic."""
    width, height, left, bottom = 560, 380, 60, 40
    every = [p for points in curves.values() for p in points if p.error > 0]
    x0, x1 = (math.log10(f(p.seconds for p in every)) for f in (min, max))
    y0, y1 = (math.log10(f(p.error for p in every)) for f in (min, max))
    x1, y1 = max(x1, x0 + 0.1), max(y1, y0 + 0.1)

    def at(p: Point) -> tuple[float, float]:
        x = left + (math.log10(p.seconds) - x0) / (x1 - x0) * (width - left - 20)
        y = 30 + (y1 - math.log10(max(p.error, 1e-300))) / (y1 - y0) * (height - bottom - 30)
        return round(x, 1), round(y, 1)

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">']
    out += ['<rect width="100%" height="100%" fill="white"/>', f'<text x="{left}" y="18" font-size="14">{title}</text>']
    for k in range(math.ceil(x0), math.floor(x1) + 1):
        x, _ = at(Point(0, 10.0**k, 10.0**y0))
        out.append(
            f'<path d="M{x} 30V{height - bottom}" stroke="#ddd"/><text x="{x}" y="{height - 22}" text-anchor="middle">{10.0**k:g}</text>'
        )
    for k in range(math.ceil(y0), math.floor(y1) + 1):
        _, y = at(Point(0, 10.0**x0, 10.0**k))
        out.append(
            f'<path d="M{left} {y}H{width - 20}" stroke="#ddd"/><text x="{left - 6}" y="{y + 4}" text-anchor="end">{10.0**k:g}</text>'
        )
    for i, (name, points) in enumerate(curves.items()):
        color = COLORS[i % len(COLORS)]
        line = " ".join(f"{x},{y}" for x, y in map(at, points))
        out.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
        out.append(f'<text x="{width - 180}" y="{48 + 16 * i}" fill="{color}">{name}</text>')
    out += [f'<text x="{width / 2}" y="{height - 6}" text-anchor="middle">CPU seconds</text>']
    out += [f'<text x="14" y="{height / 2}" transform="rotate(-90 14 {height / 2})" text-anchor="middle">relMSE</text>', "</svg>"]
    return "\n".join(out)


def main() -> None:
    """Write the table and the plots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--etendue", default="target/release/etendue")
    parser.add_argument("--python", default=sys.executable, help="the Python that has the package mitsuba")
    parser.add_argument("--methods", default="path,auto", help="integrators of ours")
    parser.add_argument("--seconds", type=float, default=12.0, help="CPU seconds of the largest picture, about")
    parser.add_argument("--rounds", type=int, default=2, help="seeds for each point")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/efficiency"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    renderers = peers(args)
    rows = [f"| scene | {' | '.join(renderers)} | best of ours / best peer |", "|---" * (len(renderers) + 2) + "|"]
    ratios = []
    for name in args.names or SCENES:
        scene = scene_file(args.folder, name)
        reference = np.asarray(etendue.read_image(args.folder / "refs" / f"{name}.exr"))[..., :3].astype(np.float64)
        curves = {who: curve(render, scene, reference, args.seconds, args.rounds) for who, render in renderers.items()}
        (args.output / f"{name}.svg").write_text(plot(name, curves))
        found = {who: efficiency(points) for who, points in curves.items()}
        best = [max((v for who, v in found.items() if who.startswith("etendue") == own), default=math.nan) for own in (True, False)]
        ratios.append(best[0] / best[1])
        figures = " | ".join(f"{v:.3g}" for v in found.values())
        rows.append(f"| {name} | {figures} | {ratios[-1]:.2f} |")
        print(rows[-1], flush=True)
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    rows.append(f"| geometric mean |{' |' * len(renderers)} {mean:.2f} |")
    (args.output / "efficiency.md").write_text("\n".join(rows) + "\n")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
