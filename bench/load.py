"""How long does it take to load a scene, beside Mitsuba 3?

Runs both in turns and prints the wall and CPU seconds of each: reading, pictures, hierarchy. Ours counts a whole process that
renders one sample of a tiny picture; Mitsuba's counts `load_file` alone.

    python bench/load.py SCENE.xml [--etendue target/release/etendue] [--rounds 5]

Needs the package `mitsuba` for the comparison; without it, prints ours alone.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time

MITSUBA = """
import sys, time, mitsuba as mi
mi.set_variant("scalar_rgb")
wall, cpu = time.time(), time.process_time()
mi.load_file(sys.argv[1])
print(time.time() - wall, time.process_time() - cpu)
"""


def ours(command: str, scene: str) -> tuple[float, float]:
    """Return the wall and CPU seconds of our process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall = time.time()
    with tempfile.TemporaryDirectory() as folder:
        size = ["--width", "16", "--height", "16", "--spp", "1"]
        subprocess.run([command, "render", scene, *size, "-q", "-o", f"{folder}/picture.exr"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.time() - wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def theirs(scene: str) -> tuple[float, float] | None:
    """Return the wall and CPU seconds of Mitsuba, or None where it is not installed."""
    done = subprocess.run([sys.executable, "-c", MITSUBA, scene], capture_output=True, text=True, check=False)
    if done.returncode:
        return None
    wall, cpu = done.stdout.split()[-2:]
    return float(wall), float(cpu)


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--etendue", default="target/release/etendue")
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = {"etendue": [], "mitsuba": []}
    for _ in range(args.rounds):
        rows["etendue"].append(ours(args.etendue, args.scene))
        other = theirs(args.scene)
        if other:
            rows["mitsuba"].append(other)
    for name, figures in rows.items():
        if figures:
            wall, cpu = (statistics.median(f[i] for f in figures) for i in (0, 1))
            print(f"{name}: {wall:.2f} s wall, {cpu:.2f} s CPU (median of {len(figures)})")


if __name__ == "__main__":
    main()
