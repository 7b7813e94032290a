"""How well does `--integrator auto` find caustics, against other programs at equal CPU time?

Renders caustic.xml of a folder with scenes by `auto` and by those peers that are given: Mitsuba's `path` and `ptracer`, any variant of it,
and LuxCore's `BIDIRCPU` (with what `etendue convert` makes of the scene: balls as triangles, the mirror without Fresnel's change with the
angle; peers/). Each picture takes about the given CPU seconds of all threads, and two seeds are averaged. Prints a Markdown table of
relMSE = mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels, against the folder's reference picture (whose own noise
counts as everyone's error), of 1 / (relMSE × CPU seconds), and of *noise*: the same error as the two seeds show it, which knows nothing of
the reference, of blur and of differences between the scenes.

    python bench/caustic_peers.py SCENES_FOLDER [--etendue target/release/etendue] [--seconds 12] [--mitsuba PYTHON] [--luxcore PYTHON]

PYTHON is an interpreter with the packages mitsuba (and numpy), or pyluxcore (and numpy). For variants of Mitsuba that need LLVM set
DRJIT_LIBLLVM_PATH. What loads, compiles or warms up does not count for peers; for `auto` all but loading counts, its pilot included. Needs
the package `etendue` (`make develop`) for reading EXR files.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from caustics import relmse
from methods import read_pfm
from peers import Peer, present, scene_job

import etendue

# Samples (or passes) and seed in, picture and CPU seconds out.
Render = Callable[[int, int], "tuple[np.ndarray, float]"]


def own(command: str, scene: Path, out: Path) -> Render:
    """Return `auto`."""

    def run(method: str, spp: int, seed: int) -> float:
        before = cpu_seconds()
        options = ["--integrator", method, "--spp", str(spp), "--seed", str(seed), "--filter", "box", "-q", "-o", str(out)]
        subprocess.run([command, "render", str(scene), "--width", "400", "--height", "300", *options], check=True, stderr=subprocess.PIPE)
        return cpu_seconds() - before

    load = min(run("normals", 1, 0) for _ in range(2))

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        used = run("auto", spp, seed) - load
        return read_pfm(out), used

    return render


def cpu_seconds() -> float:
    """Return the CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(name: str, render: Render, reference: np.ndarray, seconds: float) -> str:
    """Return a row: samples for about so many CPU seconds, and the mean error of two pictures."""
    spp = 2
    while (used := render(spp, 1)[1]) < seconds / 3:
        spp *= 2
    spp = max(1, round(spp * seconds / used))
    pictures, times = zip(*(render(spp, seed) for seed in (2, 3)), strict=True)
    used, error = float(np.mean(times)), float(np.mean([relmse(p, reference) for p in pictures]))
    # Half of the squared difference of two pictures is the variance of one.
    noise = relmse(reference + (pictures[0] - pictures[1]) / np.sqrt(2), reference)
    mean = float(np.mean(pictures) / reference.mean() - 1)
    return f"| {name} | {spp} | {used:.1f} | {error:.4f} | {noise:.4f} | {mean:+.2%} | {1 / (used * error):.3g} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds caustic.xml and refs/caustic.exr")
    parser.add_argument("--etendue", default="target/release/etendue", help="the command")
    parser.add_argument("--seconds", type=float, default=12.0, help="CPU seconds of a picture")
    parser.add_argument("--mitsuba", metavar="PYTHON", help="a Python with the package mitsuba")
    parser.add_argument("--variant", action="append", default=[], help="variants of Mitsuba; default: scalar_rgb and llvm_ad_rgb")
    parser.add_argument("--luxcore", metavar="PYTHON", help="a Python with the package pyluxcore")
    args = parser.parse_args()
    reference = np.asarray(etendue.read_image(args.folder / "refs/caustic.exr"))[..., :3].astype(np.float64)
    print("| program | samples | CPU s | relMSE | noise | mean | efficiency |\n" + "|---" * 7 + "|")
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary)
        scene = args.folder / "caustic.xml"
        wanted = []
        if args.mitsuba:
            for variant in args.variant or ["scalar_rgb", "llvm_ad_rgb"]:
                for m in ("path", "ptracer"):
                    wanted.append(Peer(f"Mitsuba `{m}`, {variant}", args.mitsuba, "mitsuba", variant=variant, method=m))
        if args.luxcore:
            wanted.append(Peer("LuxCore `BIDIRCPU`", args.luxcore, "luxcore", engine="BIDIRCPU"))
        job = scene_job(args.etendue, scene, 400, 300, out, args.luxcore is not None)
        print(measure("`auto`", own(args.etendue, scene, out / "o.pfm"), reference, args.seconds), flush=True)
        for peer in present(wanted):
            running = peer.open(job)
            print(measure(peer.name, running.render, reference, args.seconds), flush=True)
            running.close()


if __name__ == "__main__":
    main()
