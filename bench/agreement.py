"""How well do our pictures agree with those of other programs?

Renders scenes that have a reference picture with several seeds and prints a Markdown table: the difference of the mean, the share of
16×16 tiles that differ by more than 3% and 6 standard errors, the relMSE at the given samples, and the time.

    python bench/agreement.py SCENES_FOLDER [--etendue target/release/etendue] [--spp 64] [--seeds 4] [--mitsuba PYTHON] [NAME ...]

With `--mitsuba`, a Python that has the package mitsuba, its pictures of .xml scenes with the same samples and seeds follow: the same
figures of its own, and between its tiles and ours the difference of the mean, the root mean square of the differences in standard errors
(1.2 for four seeds, if nothing differs), and the largest of them. What a noisy scene does to these figures shows there. Its time is
that without loading.

SCENES_FOLDER holds NAME.xml, NAME.glb or NAME/scene.xml, and refs/NAME.exr.
Needs the package `etendue` (`make develop`) for reading EXR files.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from caustics import relmse
from peers import Peer, scene_job

import etendue

TILE = 16


def tiles(picture: np.ndarray) -> np.ndarray:
    """Return the means of the whole tiles of a picture (height, width, 3)."""
    h, w = (n // TILE * TILE for n in picture.shape[:2])
    means: np.ndarray = picture[:h, :w].reshape(h // TILE, TILE, w // TILE, TILE, 3).mean((1, 3))
    return means


def scene_file(folder: Path, name: str) -> Path:
    """Return the scene file of that name."""
    for candidate in (folder / f"{name}.xml", folder / f"{name}.glb", folder / name / "scene.xml"):
        if candidate.exists():
            return candidate
    raise SystemExit(f"no scene {name} in {folder}")


def measure(args: argparse.Namespace, name: str) -> list[str]:
    """Render a scene with all seeds and return its rows of the table."""
    scene = scene_file(args.folder, name)
    reference = np.asarray(etendue.read_image(args.folder / "refs" / f"{name}.exr"))[..., :3].astype(np.float64)
    height, width = reference.shape[:2]
    pictures = []
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, args.seeds + 1):
            out = Path(folder) / f"{seed}.exr"
            size = ["--width", str(width), "--height", str(height), "--filter", "box"]
            command = [args.etendue, "render", str(scene), *size, "--spp", str(args.spp), "--seed", str(seed), "-q", "-o", str(out)]
            subprocess.run(command, check=True)
            pictures.append(np.asarray(etendue.read_image(out))[..., :3].astype(np.float64))
        seconds = (resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before) / args.seeds
        rows = [row(args, name, pictures, reference, seconds)]
        if args.mitsuba is not None and scene.suffix == ".xml":
            variant = "llvm_ad_rgb" if "DRJIT_LIBLLVM_PATH" in os.environ else "scalar_rgb"
            running = Peer("Mitsuba", args.mitsuba, "mitsuba", variant=variant).open(
                scene_job(args.etendue, scene, width, height, Path(folder), convert=False)
            )
            theirs, times = zip(*(running.render(args.spp, seed) for seed in range(1, args.seeds + 1)), strict=True)
            running.close()
            seconds = sum(times) / args.seeds
            rows.append(row(args, f"{name}, by Mitsuba", theirs, reference, seconds))
            rows.append(between(name, pictures, theirs, reference))
    return rows


def row(args: argparse.Namespace, name: str, pictures: Sequence[np.ndarray], reference: np.ndarray, seconds: float) -> str:
    """Return the row of some pictures of one number of samples against the reference."""
    error = float(np.mean([relmse(p, reference) for p in pictures]))
    stack, reference = np.minimum(np.stack(pictures), cap(reference)), np.minimum(reference, cap(reference))
    mean = stack.mean() / reference.mean() - 1
    means = np.stack([tiles(p) for p in stack])
    expected = tiles(reference)
    spread = means.std(0, ddof=1) / np.sqrt(len(pictures))
    allowed = np.maximum(0.03 * np.maximum(expected, 0.05 * expected.mean()), 6 * spread + 1e-4 * expected.mean())
    off = (np.abs(means.mean(0) - expected) > allowed).mean()
    return f"| {name} | {args.spp} × {len(pictures)} | {mean:+.2%} | {off:.1%} | {error:.4f} | {seconds:.1f} s |"


def cap(reference: np.ndarray) -> float:
    """Return where pictures are cut: one firefly must not decide."""
    return float(np.quantile(reference, 0.999) * 4)


def between(name: str, ours: Sequence[np.ndarray], theirs: Sequence[np.ndarray], reference: np.ndarray) -> str:
    """Return how pictures of two programs with the same samples differ, tile by tile."""
    a, b = (np.stack([tiles(np.minimum(p, cap(reference))) for p in pictures]) for pictures in (ours, theirs))
    error = np.sqrt(a.var(0, ddof=1) / len(a) + b.var(0, ddof=1) / len(b))
    z = (a.mean(0) - b.mean(0)) / np.maximum(error, 2e-5 * b.mean())
    mean = a.mean() / b.mean() - 1
    return (
        f"| {name}, ours against theirs | | {mean:+.2%} | {np.sqrt((z**2).mean()):.2f} standard errors, at most {np.abs(z).max():.1f} | | |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", help="scenes; default: all that have a reference")
    parser.add_argument("--etendue", default="target/release/etendue")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--mitsuba", metavar="PYTHON", help="a Python with the package mitsuba")
    args = parser.parse_args()
    names = args.names or sorted(p.stem for p in (args.folder / "refs").glob("*.exr"))
    print("| scene | samples × seeds | mean | tiles off | relMSE of one picture | CPU time of one picture |\n|---|---|---|---|---|---|")
    for name in names:
        print("\n".join(measure(args, name)), flush=True)


if __name__ == "__main__":
    main()
