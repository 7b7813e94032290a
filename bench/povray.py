"""How much CPU time does a POV-Ray scene take, beside POV-Ray itself?

Runs both in turns on scenes of POV-Ray's examples: one thread, the same size and the same antialiasing, whole processes from
start to picture. Prints a Markdown table of CPU seconds (the least of all rounds), their ratio, its geometric mean, and the worst.

    python bench/povray.py [GLOB ...] [--etendue target/release/etendue] [--rounds 3] [--width 320 --height 240]

`--matching rows.json` takes the scenes that match POV-Ray's pictures, from what the corpus' scorer writes with `--json`.

The scenes are found with --examples or POVRAY_EXAMPLES, the include files with --include or POVRAY_INCLUDE. Without POV-Ray or
its scenes nothing is measured, and that is said.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Of each folder a few that take POV-Ray long enough to be measured.
SCENES = [
    "advanced/abyss.pov",
    "advanced/biscuit.pov",
    "advanced/chess2.pov",
    "advanced/fish13/fish13.pov",
    "advanced/gaussian_blob.pov",
    "advanced/landscape.pov",
    "advanced/mediasky.pov",
    "advanced/newdiffract.pov",
    "advanced/quilt1.pov",
    "advanced/skyvase.pov",
    "advanced/teapot/teapot.pov",
    "advanced/wineglass.pov",
    "advanced/woodbox.pov",
    "camera/focal_blur.pov",
    "csg/*.pov",
    "interior/*.pov",
    "lights/*.pov",
    "objects/*.pov",
    "textures/finishes/*.pov",
    "textures/normals/*.pov",
    "textures/patterns/*.pov",
    "textures/pigments/*.pov",
    "textures/surfaces/*.pov",
]


def cpu(command: list[str], folder: Path, timeout: float) -> float | None:
    """Return the CPU seconds of a process, or None where it fails or takes too long."""
    with subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end = time.time() + timeout
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            if time.time() > end:
                process.kill()
                os.wait4(process.pid, 0)
                process.returncode = -9
                return None
            time.sleep(0.005)
        process.returncode = os.waitstatus_to_exitcode(status)
        return usage.ru_utime + usage.ru_stime if process.returncode == 0 else None


def commands(args: argparse.Namespace, scene: Path, out: Path) -> dict[str, list[str]]:
    """Return the command lines of both programs."""
    size = (str(args.width), str(args.height))
    etendue = [args.etendue, "render", str(scene), "--width", size[0], "--height", size[1], "--threads", "1", "-q"]
    etendue += ["-o", str(out / "etendue.png"), "--antialias", str(args.antialias)]
    povray = [args.povray, f"+I{scene.name}", f"+O{out / 'povray.png'}", f"+W{size[0]}", f"+H{size[1]}", "-D", "-P", "+WT1"]
    povray += ["+FN8", f"+L{args.include}", f"+A{args.antialias}" if args.antialias > 0 else "-A"]
    return {"etendue": etendue, "povray": povray}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="GLOB")
    parser.add_argument("--examples", default=os.environ.get("POVRAY_EXAMPLES", "/usr/share/doc/povray/examples"))
    parser.add_argument("--include", default=os.environ.get("POVRAY_INCLUDE", "/usr/share/povray-3.7/include"))
    parser.add_argument("--etendue", default="target/release/etendue")
    parser.add_argument("--povray", default="povray")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--height", type=int, default=240)
    parser.add_argument("--antialias", type=float, default=0.3)
    parser.add_argument("--timeout", type=float, default=120.0, help="wall-clock seconds of one run")
    parser.add_argument("--matching", type=Path, metavar="JSON", help="the scenes that the scorer found to match, in place of GLOBs")
    parser.add_argument("--limit", type=int, help="at most so many scenes, spread evenly")
    args = parser.parse_args()
    if not shutil.which(args.povray):
        print(f"SKIPPED: there is no `{args.povray}` to compare with", file=sys.stderr)
        return 0
    if not Path(args.examples).is_dir():
        print(f"SKIPPED: POV-Ray's examples are not at {args.examples} (set POVRAY_EXAMPLES)", file=sys.stderr)
        return 0
    args.etendue = str(Path(args.etendue).resolve())
    with tempfile.TemporaryDirectory() as folder:
        # Scenes may write files beside themselves.
        tree = Path(folder) / "examples"
        shutil.copytree(args.examples, tree)
        paths = sorted(str(p.relative_to(tree)) for p in tree.rglob("*.pov"))
        globs = args.scenes
        if args.matching:
            rows = json.loads(args.matching.read_text())["rows"]
            globs = [row["path"] for row in rows if row["class"] == "match" and not row["trivial"]]
        chosen = [p for p in paths if any(fnmatch.fnmatch(p, g) for g in globs)]
        if args.limit and args.limit < len(chosen):
            chosen = [chosen[i * len(chosen) // args.limit] for i in range(args.limit)]
        print(f"{args.width}×{args.height}, antialiasing {args.antialias}, one thread, least CPU seconds of {args.rounds}\n")
        print("| scene | etendue | POV-Ray | ratio |\n|---|--:|--:|--:|")
        ratios: list[tuple[float, str]] = []
        totals = [0.0, 0.0]
        for path in chosen:
            times: dict[str, list[float | None]] = {"etendue": [], "povray": []}
            for _ in range(args.rounds):
                for name, command in commands(args, tree / path, Path(folder)).items():
                    times[name].append(cpu(command, (tree / path).parent, args.timeout))
                if None in times["etendue"] or None in times["povray"]:
                    break
            least = {n: min((t for t in v if t is not None), default=None) if None not in v else None for n, v in times.items()}
            ours, theirs = least["etendue"], least["povray"]
            shown = ["failed" if t is None else f"{t:.2f}" for t in (ours, theirs)]
            if ours is None or theirs is None:
                print(f"| {path} | {shown[0]} | {shown[1]} | |", flush=True)
                continue
            ratios.append((ours / max(theirs, 1e-3), path))
            totals = [totals[0] + ours, totals[1] + theirs]
            print(f"| {path} | {shown[0]} | {shown[1]} | {ratios[-1][0]:.2f} |", flush=True)
    if ratios:
        mean = math.exp(sum(math.log(max(r, 1e-6)) for r, _ in ratios) / len(ratios))
        sums = totals[0] / max(totals[1], 1e-3)
        print(f"\n{len(ratios)} scenes, geometric mean of the ratios **{mean:.2f}**, of the sums {sums:.2f}. Worst:")
        for ratio, path in sorted(ratios, reverse=True)[:10]:
            print(f"- {ratio:.2f} {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
