"""How well do methods find caustics? Efficiency of `path`, `mnee`, `pathmap`, `bdpt` and `sppm` on four scenes.

Renders glass under a point light, under a small lamp, a lamp in a bulb of glass, and `caustic.xml` of a folder, by each method with twice
the samples until a picture takes the given CPU seconds, and prints a Markdown table of 1 / (relMSE × CPU seconds): higher is better.
relMSE = mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels; means over two seeds; the reference is a long run of `bdpt`
with a seed of its own. Pixels that show the first two scenes' ball are left out: no light that `path` or `bdpt` can find comes through it
from a point. Loading is not counted.

    python bench/caustics.py [SCENES_FOLDER] [--etendue target/release/etendue] [--seconds 8] [--reference 2048] [--scene NAME]
        [--pictures F]

Needs numpy only. Compare within a row: a machine that does other things is slower, for all of them.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from methods import END, HEAD, ROOM, ball, read_pfm, wall

METHODS = ["path", "mnee", "pathmap", "bdpt", "sppm"]
FLOOR = HEAD.format(fov=35, eye="0, 1.2, 3.6", target="0, -0.6, 0") + wall(
    "white", '<scale value="2"/><rotate x="1" angle="-90"/>', "0, -1, 0"
)
HIGH_BALL = ball("0, -0.35, 0", 0.4, "glass")
POINT = '<emitter type="point"><point name="position" value="-0.9, 0.9, 0.5"/><rgb name="intensity" value="4, 4, 4"/></emitter>\n'
LAMP = ball("-0.9, 0.9, 0.5", 0.04, "black", "800, 800, 800")
BULB = ball("0, 0.3, 0", 0.3, "glass") + ball("0, 0.3, 0", 0.05, "black", "150, 130, 100")


@dataclass
class Scene:
    """A scene, and what is left of it without what is not measured."""

    text: str
    without: str | None = None


SCENES = {
    "ball under a point light": Scene(FLOOR + HIGH_BALL + POINT + END, FLOOR + POINT + END),
    "ball under a small lamp": Scene(FLOOR + HIGH_BALL + LAMP + END, FLOOR + LAMP + END),
    "lamp in a bulb": Scene(ROOM + BULB + ball("-0.5, -0.7, 0.2", 0.3, "red") + END),
}


def relmse(picture: np.ndarray, reference: np.ndarray) -> float:
    """Return mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels."""
    error = ((picture - reference) ** 2 / (reference**2 + 0.01)).mean(-1).ravel()
    error.sort()
    return float(error[: max(1, round(0.999 * error.size))].mean())


class Runner:
    """Renders one scene."""

    def __init__(self, command: str, scene: Path, search: list[str], size: tuple[int, int], out: Path | None = None) -> None:
        """Measure how long loading takes; pictures are written to `out`, or beside the scene."""
        self.command, self.scene, self.search, self.size = command, scene, search, size
        self.out = out or scene.with_suffix(".pfm")
        self.load = 0.0
        _, self.load = self.render("normals", 1, 0, size=(16, 16))

    def render(self, method: str, spp: int, seed: int, size: tuple[int, int] | None = None) -> tuple[np.ndarray, float]:
        """Return a picture and its CPU seconds."""
        width, height = size or self.size
        options = ["--width", str(width), "--height", str(height), "--filter", "box", "--spp", str(spp), "--seed", str(seed)]
        run = [self.command, "render", str(self.scene), "--integrator", method, *options, *self.search, "-q", "-o", str(self.out)]
        before = cpu_seconds()
        subprocess.run(run, check=True, stderr=subprocess.PIPE)
        return read_pfm(self.out), max(cpu_seconds() - before - self.load, 1e-3)


def cpu_seconds() -> float:
    """Return the CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def efficiency(runner: Runner, method: str, mask: np.ndarray, reference: np.ndarray, seconds: float) -> str:
    """Return a cell: the efficiency of the largest picture, and its samples."""
    spp = 4
    while True:
        figures = []
        for seed in (1, 2):
            picture, used = runner.render(method, spp, seed)
            figures.append((used, relmse(picture[mask], reference[mask])))
        used, error = (float(np.mean([f[i] for f in figures])) for i in (0, 1))
        if used * 1.5 > seconds or spp >= 1 << 16:
            return f"{1 / max(used * error, 1e-300):.3g} ({spp})"
        spp *= 2


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="holds caustic.xml")
    parser.add_argument("--etendue", default="target/release/etendue", help="the command")
    parser.add_argument("--seconds", type=float, default=8.0, help="CPU seconds of the largest picture")
    parser.add_argument("--reference", type=int, default=2048, help="samples of the reference")
    parser.add_argument("--scene", action="append", default=[], help="only this scene")
    parser.add_argument("--pictures", type=Path, help="keep the references and the scenes here")
    args = parser.parse_args()
    sys.stdout.write("| scene | " + " | ".join(f"`{m}`" for m in METHODS) + " |\n" + "|---" * (len(METHODS) + 1) + "|\n")
    with tempfile.TemporaryDirectory() as folder:
        jobs: list[tuple[str, Path, Path | None, list[str], tuple[int, int]]] = []
        for i, (name, scene) in enumerate(SCENES.items()):
            path, without = Path(folder) / f"{i}.xml", Path(folder) / f"{i}-without.xml"
            path.write_text(scene.text, encoding="utf-8")
            if scene.without:
                without.write_text(scene.without, encoding="utf-8")
            jobs.append((name, path, without if scene.without else None, [], (128, 96)))
        if args.folder:
            path = Path(folder) / "caustic.xml"
            shutil.copy(args.folder / "caustic.xml", path)
            jobs.append(("caustic", path, None, ["-L", str(args.folder)], (100, 75)))
        for name, path, other, search, size in jobs:
            if args.scene and name not in args.scene:
                continue
            runner = Runner(args.etendue, path, search, size)
            reference, _ = runner.render("bdpt", args.reference, 99)
            mask = np.ones(reference.shape[:2], bool)
            if other:
                seen, _ = runner.render("normals", 16, 0)
                mask = (seen == Runner(args.etendue, other, search, size).render("normals", 16, 0)[0]).all(-1)
            if args.pictures:
                args.pictures.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, args.pictures / f"{path.stem}.xml")
                np.save(args.pictures / f"{path.stem}.npy", reference)
            cells = [efficiency(runner, m, mask, reference, args.seconds) for m in METHODS]
            sys.stdout.write(f"| {name} | " + " | ".join(cells) + " |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
