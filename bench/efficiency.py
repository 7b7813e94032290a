"""Which renderer makes the best picture of the CPU time that it gets?

Renders scenes that have a reference picture by Etendue and by every peer that is installed, in turns, at growing numbers of samples, and
writes a table of efficiencies, one of what lies behind them, and a plot of the errors over time for each scene:

    python bench/efficiency.py SCENES_FOLDER [--mitsuba PYTHON] [--cycles PYTHON] [--luxcore PYTHON] [--seconds 12] [--rounds 2]
        [--methods path,auto] [-o out/efficiency] [NAME ...]

SCENES_FOLDER holds NAME.xml, NAME.glb or NAME/scene.xml, and refs/NAME.exr. Efficiency = 1 / (error × CPU seconds): higher is better.
CPU seconds of all threads; loading, compiling and building are left out, which peers do before and of which a small picture tells for
ours; what a method prepares counts. No denoiser. A ratio is good to 1.3 at best, and on a machine that does nothing else.

Peers: Mitsuba 3, in its scalar and its LLVM mode (package mitsuba; LLVM wants libLLVM 16 or later, which DRJIT_LIBLLVM_PATH names),
Cycles (package bpy) and LuxCore's PATHCPU and BIDIRCPU (package pyluxcore), each in the interpreter that the option names, or this one.
What does not run, or cannot have a scene, is named on stderr. POV-Ray has no physical path tracer and is measured on its own scenes, by
povray.py.

The error is relMSE = mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels, for programs that read the scene's file. Cycles
and LuxCore are given what `etendue convert` makes of XML files, with the environment map, the depth and lamps that shine to one side handed
on (peers/): balls are triangles there, and materials are the nearest ones. What their seeds have in common, mean((x₁ − ref)(x₂ − ref) /
(ref² + 0.01)), is taken from their relMSE, so that only noise counts for them (marked *); bias, blur and the reference's noise count for
all others.
The second table has both figures and the mean's deviation for all, and the CPU seconds to a matching error: the geometric mean of what all
have in their largest pictures.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from agreement import scene_file
from caustics import relmse
from peers import Peer, RefusedError, Running, present, scene_job

import etendue

SCENES = ["cornell", "veach-mis", "caustic", "env-materials", "many-lights", "kitchen", "helmet", "golf"]
COLORS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#e377c2", "#17becf", "#7f7f7f"]

# Samples per pixel and seed in, picture and CPU seconds out.
Render = Callable[[int, int], "tuple[np.ndarray, float]"]


@dataclass
class Point:
    """Pictures of a number of samples: CPU seconds, relMSE, its part that all seeds share, the mean's deviation, and what counts."""

    spp: int
    seconds: float
    relmse: float
    shared: float
    mean: float
    error: float


def cpu_seconds() -> float:
    """Return the CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def ours(command: str, scene: Path, width: int, height: int, methods: list[str]) -> dict[str, Render]:
    """Return functions that render by methods of ours."""

    def render(method: str, width: int, height: int, spp: int, seed: int) -> tuple[np.ndarray, float]:
        with tempfile.TemporaryDirectory() as folder:
            out = f"{folder}/picture.exr"
            before = cpu_seconds()
            options = ["--spp", str(spp), "--seed", str(seed), "--filter", "box", "--integrator", method]
            options += ["--width", str(width), "--height", str(height)]
            subprocess.run([command, "render", str(scene), *options, "-q", "-o", out], check=True)
            return np.asarray(etendue.read_image(out))[..., :3].astype(np.float64), cpu_seconds() - before

    # A run that does next to nothing after loading.
    loading = render("normals", 16, 16, 1, 0)[1]

    def of(method: str) -> Render:
        def run(spp: int, seed: int) -> tuple[np.ndarray, float]:
            picture, used = render(method, width, height, spp, seed)
            return picture, used - loading

        return run

    return {f"etendue {m}": of(m) for m in methods}


def shared(pictures: list[np.ndarray], reference: np.ndarray) -> float:
    """Return the part of relMSE that more samples would not take away: the products of different seeds' errors."""
    n = len(pictures)
    if n < 2:
        return math.nan
    off = np.stack([(p - reference) / np.sqrt(reference**2 + 0.01) for p in pictures])
    squares = (off**2).sum(0)
    products = ((off.sum(0) ** 2 - squares) / (n * (n - 1))).mean(-1).ravel()
    keep = np.argsort(squares.mean(-1).ravel())[: int(len(products) * 0.999)]
    return float(products[keep].mean())


def point(spp: int, got: list[tuple[np.ndarray, float]], reference: np.ndarray) -> Point:
    """Return the figures of the seeds' pictures."""
    pictures = [picture for picture, _ in got]
    seconds = float(np.mean([max(used, 1e-3) for _, used in got]))
    error = float(np.mean([relmse(p, reference) for p in pictures]))
    return Point(spp, seconds, error, shared(pictures, reference), float(np.mean(pictures) / reference.mean() - 1), error)


def measure(renderers: dict[str, Render], reference: np.ndarray, seconds: float, rounds: int) -> dict[str, list[Point]]:
    """Render in turns, with twice the samples each time, until a program's picture takes the seconds."""
    curves: dict[str, list[Point]] = {who: [] for who in renderers}
    active, spp = list(renderers), 1
    while active:
        got: dict[str, list[tuple[np.ndarray, float]]] = {who: [] for who in active}
        for seed in range(1, rounds + 1):
            for who in active:
                got[who].append(renderers[who](spp, seed))
        for who in active:
            curves[who].append(point(spp, got[who], reference))
        spp *= 2
        active = [who for who in active if curves[who][-1].seconds * 1.5 <= seconds and spp <= 1 << 20]
    return curves


def noise_alone(points: list[Point]) -> None:
    """Let what the seeds of the largest pictures share not count."""
    for p in points:
        p.error = max(p.relmse - max(points[-1].shared, 0.0), 0.01 * p.relmse)


def seconds_to(points: list[Point], error: float) -> str:
    """Return the CPU seconds to an error: between the points, or with ~ beyond them, as noise falls with the samples."""
    for a, b in reversed(list(pairwise(points))):
        if a.error >= error >= b.error:
            share = math.log(a.error / error) / max(math.log(a.error / b.error), 1e-12)
            return f"{a.seconds * (b.seconds / a.seconds) ** share:.2f}"
    end = points[0] if points[0].error < error else points[-1]
    return f"~{end.seconds * end.error / error:.2f}"


def efficiency(points: list[Point]) -> float:
    """Return 1 / (relMSE × CPU seconds) of the largest picture."""
    return 1.0 / max(points[-1].error * points[-1].seconds, 1e-300)


def plot(title: str, curves: dict[str, list[Point]]) -> str:
    """Return an SVG picture of errors over seconds, both logarithmic."""
    width, height, left, right, bottom = 740, 380, 60, 200, 40
    every = [p for points in curves.values() for p in points if p.error > 0]
    x0, x1 = (math.log10(f(p.seconds for p in every)) for f in (min, max))
    y0, y1 = (math.log10(f(p.error for p in every)) for f in (min, max))
    x1, y1 = max(x1, x0 + 0.1), max(y1, y0 + 0.1)

    def at(seconds: float, error: float) -> tuple[float, float]:
        x = left + (math.log10(seconds) - x0) / (x1 - x0) * (width - left - right)
        y = 30 + (y1 - math.log10(max(error, 1e-300))) / (y1 - y0) * (height - bottom - 30)
        return round(x, 1), round(y, 1)

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">']
    out += ['<rect width="100%" height="100%" fill="white"/>', f'<text x="{left}" y="18" font-size="14">{title}</text>']
    for k in range(math.ceil(x0), math.floor(x1) + 1):
        x, _ = at(10.0**k, 10.0**y0)
        out.append(
            f'<path d="M{x} 30V{height - bottom}" stroke="#ddd"/><text x="{x}" y="{height - 22}" text-anchor="middle">{10.0**k:g}</text>'
        )
    for k in range(math.ceil(y0), math.floor(y1) + 1):
        _, y = at(10.0**x0, 10.0**k)
        out.append(
            f'<path d="M{left} {y}H{width - right}" stroke="#ddd"/><text x="{left - 6}" y="{y + 4}" text-anchor="end">{10.0**k:g}</text>'
        )
    for i, (name, points) in enumerate(curves.items()):
        color = COLORS[i % len(COLORS)]
        line = " ".join(f"{x},{y}" for x, y in (at(p.seconds, p.error) for p in points))
        out += [f'<circle cx="{x}" cy="{y}" r="3" fill="{color}"/>' for x, y in (at(p.seconds, p.error) for p in points)]
        out.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
        out.append(f'<text x="{width - right + 12}" y="{40 + 16 * i}" fill="{color}">{name}</text>')
    out += [f'<text x="{(left + width - right) / 2}" y="{height - 6}" text-anchor="middle">CPU seconds</text>']
    out += [f'<text x="14" y="{height / 2}" transform="rotate(-90 14 {height / 2})" text-anchor="middle">error</text>', "</svg>"]
    return "\n".join(out)


def details(name: str, curves: dict[str, list[Point]]) -> list[str]:
    """Return the rows of what lies behind the efficiencies, of the largest pictures."""
    match = math.exp(np.mean([math.log(points[-1].error) for points in curves.values()]))
    rows = []
    for who, points in curves.items():
        p = points[-1]
        figures = f"{p.spp} | {p.seconds:.1f} | {p.relmse:.4f} | {p.shared:.4f} | {p.mean:+.2%} | {efficiency(points):.3g}"
        rows.append(f"| {name} | {who} | {figures} | {seconds_to(points, match)} to {match:.2g} |")
    return rows


def open_peers(found: list[Peer], job: dict, name: str) -> dict[Peer, Running]:
    """Return the peers that have loaded the scene; says which have not, and why."""
    out = {}
    for peer in found:
        try:
            out[peer] = peer.open(job)
        except RefusedError as why:
            print(f"not measured: {peer.name}: {name}: {why}", file=sys.stderr)
    return out


def scene_curves(args: argparse.Namespace, found: list[Peer], name: str) -> dict[str, list[Point]]:
    """Return what all programs make of a scene, with a * where a peer is given a converted one."""
    scene = scene_file(args.folder, name)
    reference = np.asarray(etendue.read_image(args.folder / "refs" / f"{name}.exr"))[..., :3].astype(np.float64)
    height, width = reference.shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        job = scene_job(args.etendue, scene, width, height, Path(folder), any(p.reads_gltf for p in found))
        opened = open_peers(found, job, name)
        try:
            renderers = ours(args.etendue, scene, width, height, args.methods.split(","))
            renderers |= {peer.name: running.render for peer, running in opened.items()}
            curves = measure(renderers, reference, args.seconds, args.rounds)
        finally:
            for running in opened.values():
                running.close()
    for peer in opened:
        if peer.given(job):
            noise_alone(curves[peer.name])
            curves[f"{peer.name} *"] = curves.pop(peer.name)
    return curves


def main() -> None:
    """Write the tables and the plots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--etendue", default="target/release/etendue")
    for option, package in (("mitsuba", "mitsuba"), ("cycles", "bpy"), ("luxcore", "pyluxcore")):
        parser.add_argument(f"--{option}", metavar="PYTHON", default=sys.executable, help=f"the Python that has the package {package}")
    parser.add_argument("--methods", default="path,auto", help="integrators of ours")
    parser.add_argument("--seconds", type=float, default=12.0, help="CPU seconds of the largest picture, about")
    parser.add_argument("--rounds", type=int, default=2, help="seeds for each point")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/efficiency"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    found = present(
        [
            Peer("Mitsuba scalar_rgb", args.mitsuba, "mitsuba", variant="scalar_rgb"),
            Peer("Mitsuba llvm_ad_rgb", args.mitsuba, "mitsuba", variant="llvm_ad_rgb"),
            Peer("Cycles", args.cycles, "cycles"),
            Peer("LuxCore PATHCPU", args.luxcore, "luxcore", engine="PATHCPU"),
            Peer("LuxCore BIDIRCPU", args.luxcore, "luxcore", engine="BIDIRCPU"),
        ]
    )
    if args.rounds < 2 and any(p.reads_gltf for p in found):
        parser.error("Cycles and LuxCore need two rounds: their noise shows between seeds")
    columns = [f"etendue {m}" for m in args.methods.split(",")] + [p.name for p in found]
    rows = [f"| scene | {' | '.join(columns)} | best of ours / best peer |", "|---" * (len(columns) + 2) + "|"]
    more = ["| scene | program | samples | CPU s | relMSE | shared | mean | efficiency | CPU s to an error |", "|---" * 9 + "|"]
    ratios = []
    for name in args.names or SCENES:
        curves = scene_curves(args, found, name)
        (args.output / f"{name}.svg").write_text(plot(name, curves))
        got = {who: efficiency(points) for who, points in curves.items()}
        best = [max((v for who, v in got.items() if who.startswith("etendue") == own), default=math.nan) for own in (True, False)]
        ratios.append(best[0] / best[1])
        cells = [next((f"{got[w]:.3g}{w[len(c) :]}" for w in (c, f"{c} *") if w in got), "–") for c in columns]
        rows.append(f"| {name} | {' | '.join(cells)} | {ratios[-1]:.2f} |")
        more += details(name, curves)
        print("\n".join([rows[-1], *more[-len(curves) :]]), flush=True)
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    rows.append(f"| geometric mean |{' |' * len(columns)} {mean:.2f} |")
    text = "\n".join([*rows, "", *more]) + "\n"
    (args.output / "efficiency.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
