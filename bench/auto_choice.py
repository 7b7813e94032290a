"""Is `--integrator auto` near the best of the methods that it chooses from? All of them at equal CPU time.

Renders scenes by `auto` and by each method that it may choose, with so many samples that a picture takes about the given CPU seconds, and
prints a Markdown table of relMSE = mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels, scaled to exactly those seconds
(error ∝ 1 / time; the pilot of `auto` counts), means of two seeds, and of what `auto` chose. The reference is refs/NAME.exr beside the
scene, twice as wide and high, or a long run of `bdpt`; pixels that show the balls of scenes of bench/caustics.py are left out, as there.
Loading is not counted.

    python bench/auto_choice.py [SCENES ...] [--etendue target/release/etendue] [--seconds 4] [--reference 30]

Without SCENES: a glass ball under a point light, under a small lamp, a lamp in a bulb of glass, and scenes/. Needs numpy and OpenEXR.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from caustics import SCENES, Runner, cpu_seconds, relmse

METHODS = ["path", "sppm", "pathmap", "vcm", "auto"]
OWN = ["scenes/particles/room.xml", "scenes/gallery/atrium.xml"]
SIZE = (200, 150)


def to_seconds(runner: Runner, method: str, seconds: float, seed: int) -> tuple[np.ndarray, float]:
    """Return a picture that takes about so many CPU seconds, and what it took."""
    spp = 2
    while True:
        picture, used = runner.render(method, spp, seed)
        if used * 1.4 > seconds or spp > 1 << 16:
            return picture, used
        spp = max(spp + 1, int(spp * min(8.0, seconds / used)))


def reference_of(path: Path) -> np.ndarray | None:
    """Return the reference picture beside a scene, in the size of the others, if there is one."""
    file = path.parent / "refs" / f"{path.stem}.exr"
    if not file.exists():
        return None
    picture = OpenEXR.File(str(file)).channels()["RGB"].pixels.astype(np.float64)
    small: np.ndarray = picture.reshape(SIZE[1], 2, SIZE[0], 2, 3).mean((1, 3))
    return small


def chosen(command: str, scene: Path, out: Path) -> str:
    """Return what `auto` says that it chose."""
    size = ["--width", str(SIZE[0]), "--height", str(SIZE[1])]
    run = [command, "render", str(scene), "--integrator", "auto", "--spp", "1", "--seed", "1", *size, "-o", str(out)]
    text = subprocess.run(run, check=True, capture_output=True, text=True)
    found = re.search(r"auto: ([^;,]*)", text.stderr + text.stdout)
    name = found.group(1) if found else "?"
    inner = re.search(r"\((\w+)\)", name)
    return inner.group(1) if inner else "path" if name == "path tracing" else name


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path, nargs="*", help="scene files")
    parser.add_argument("--etendue", default="target/release/etendue", help="the command")
    parser.add_argument("--seconds", type=float, default=4.0, help="CPU seconds of a picture")
    parser.add_argument("--reference", type=float, default=30.0, help="reference: so many times the CPU seconds")
    args = parser.parse_args()
    head = [*(f"`{m}`" for m in METHODS), "`auto` took", "`auto` / best"]
    sys.stdout.write("| scene | " + " | ".join(head) + " |\n" + "|---" * (len(head) + 1) + "|\n")
    with tempfile.TemporaryDirectory() as folder:
        scenes: list[tuple[str, Path, Path | None]] = [(p.stem, p, None) for p in args.scenes]
        if not scenes:
            for i, (name, scene) in enumerate(SCENES.items()):
                path, without = Path(folder) / f"{i}.xml", Path(folder) / f"{i}-without.xml"
                path.write_text(scene.text, encoding="utf-8")
                without.write_text(scene.without or scene.text, encoding="utf-8")
                scenes.append((name, path, without))
            scenes += [(Path(p).stem, Path(p), None) for p in OWN]
        for name, path, other in scenes:
            out = Path(folder) / "out.pfm"
            runner = Runner(args.etendue, path, [], SIZE, out)
            reference = reference_of(path)
            if reference is None:
                reference, _ = to_seconds(runner, "bdpt", args.seconds * args.reference, 99)
            mask = np.ones(reference.shape[:2], bool)
            if other:
                seen, _ = runner.render("normals", 16, 0)
                mask = (seen == Runner(args.etendue, other, [], SIZE, out).render("normals", 16, 0)[0]).all(-1)
            errors = []
            for method in METHODS:
                found = [to_seconds(runner, method, args.seconds, seed) for seed in (1, 2)]
                errors.append(float(np.mean([relmse(p[mask], reference[mask]) * used / args.seconds for p, used in found])))
            cells = [f"{e:.3g}" for e in errors] + [chosen(args.etendue, path, out), f"{errors[-1] / min(errors[:-1]):.2f}"]
            sys.stdout.write(f"| {name} | " + " | ".join(cells) + " |\n")
            sys.stdout.flush()
    sys.stderr.write(f"{cpu_seconds():.0f} CPU seconds\n")


if __name__ == "__main__":
    main()
