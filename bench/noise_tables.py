"""Measures the tables of the noise functions from POV-Ray's output (docs/decisions/0004-noise-tables.md).

Prints the coefficients as `crates/procedural/src/noise_tables.rs` lists them, in hundred-millionths, and compares the formulas with the
installed `povray` at random points.

    python bench/noise_tables.py [--include /usr/share/povray-3.7/include] [--points 5000]
"""

from __future__ import annotations

import argparse
import math
import random
import subprocess
import tempfile
from pathlib import Path

SCENE = """#version 3.7;
#include "functions.inc"
global_settings {{ assumed_gamma 1 }}
#fopen F "values.txt" write
#macro W(a, b, c)
  #local V = vturbulence(2, 0.5, 1, <a, b, c>);
  #write(F, str(f_noise_generator(a, b, c, 1), 0, 16), " ", str(f_noise_generator(a, b, c, 2), 0, 16), " ", str(f_noise_generator(a, b, c, 3), 0, 16),
    " ", str(V.x, 0, 16), " ", str(V.y, 0, 16), " ", str(V.z, 0, 16), "\\n")
#end
{points}
#fclose F
"""

Point = tuple[float, float, float]


def measure(points: list[Point], include: str) -> list[list[float]]:
    """Noise of generators 1, 2, 3 and the three components of vector noise at each point."""
    with tempfile.TemporaryDirectory() as folder:
        scene = SCENE.format(points="\n".join(f"W({x!r}, {y!r}, {z!r})" for x, y, z in points))
        Path(folder, "noise.pov").write_text(scene)
        command = ["povray", "+Inoise.pov", "+Onoise.png", "+W8", "+H8", "-D", "-P", f"+L{include}"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        return [[float(v) for v in line.split()] for line in Path(folder, "values.txt").read_text().splitlines()]


def draws(state: int):
    """Upper halves of the states of the generator of `rand()`."""
    while True:
        state = (state * 1812433253 + 12345) % 2**32
        yield state >> 16


def hash_table() -> list[int]:
    table, numbers = list(range(4096)), draws(0)
    for i in reversed(range(4096)):
        j = next(numbers) % 4096
        table[i], table[j] = table[j], table[i]
    return table


def perlin_tables() -> tuple[list[int], list[list[float]]]:
    numbers, gradients = draws(1), []
    while len(gradients) < 2048:
        v = [next(numbers) % 4096 - 2048 for _ in range(3)]
        square = sum(c * c for c in v)
        if 0 < square <= 2048**2:
            gradients.append([c / math.sqrt(square) for c in v])
    table = [*range(2048), 0]
    for i in range(2048, 0, -2):
        j = next(numbers) % 2048
        table[i], table[j] = table[j], table[i]
    return table[:2048], gradients


HASH = hash_table()
PERLIN = perlin_tables()


def lattice(x: int, y: int, z: int) -> int:
    x, y, z = ((c + 10000) % 4096 for c in (x, y, z))
    return HASH[HASH[HASH[x] ^ y] ^ z] % 256


def coefficients(include: str) -> list[int]:
    """Values at one lattice point per hash, and the gradient of the last component at the last one, in hundred-millionths."""
    where = {}
    for x in range(4096):
        where.setdefault(lattice(x, 0, 0), x)
    table = [0.0] * 267
    for h, row in enumerate(measure([(where[h], 0, 0) for h in range(256)], include)):
        for k in range(3):
            table[h + 4 * k] = 2 * row[3 + k]
    for axis in range(3):
        # Between two lattice points: a value and a slope of each; two points between them give the slopes.
        points = []
        for t in (0.0, 0.25, 0.5, 1.0):
            p = [float(where[255]), 0.0, 0.0]
            p[axis] += t
            points.append((p[0], p[1], p[2]))
        v0, v1, v2, v3 = (row[5] for row in measure(points, include))
        (s1, s2) = (0.15625, 0.5)
        r1, r2 = v1 - v0 * (1 - s1) - v3 * s1, v2 - v0 * (1 - s2) - v3 * s2
        # r = (1 - s) t a + s (t - 1) b
        a1, b1, a2, b2 = (1 - s1) * 0.25, -s1 * 0.75, 0.25, -0.25
        table[264 + axis] = (r1 * b2 - r2 * b1) / (a1 * b2 - a2 * b1)
    return [round(c * 1e8) for c in table]


def model(p: Point, table: list[float]) -> list[float]:
    """The formulas of crates/procedural/src/README.md."""
    base = [math.floor(c) for c in p]
    d = [c - b for c, b in zip(p, base, strict=True)]
    shifted = [c + 10000000.023157213 for c in p]
    base3 = [math.floor(c) for c in shifted]
    d3 = [c - b for c, b in zip(shifted, base3, strict=True)]
    vector, gradient = [0.0] * 3, 0.0
    permutation, directions = PERLIN
    for corner in range(8):
        o = [corner & 1, corner >> 1 & 1, corner >> 2]

        def weight(d: list[float], o: list[int] = o) -> float:
            s = [t * t * (3 - 2 * t) for t in d]
            return math.prod(si if oi else 1 - si for si, oi in zip(s, o, strict=True))

        h = lattice(*(b + oi for b, oi in zip(base, o, strict=True)))
        for k in range(3):
            slopes = sum(table[h + 4 * k + 1 + a] * (d[a] - o[a]) for a in range(3))
            vector[k] += weight(d) * (0.5 * table[h + 4 * k] + slopes)
        x, y, z = ((b + oi) % 2048 for b, oi in zip(base3, o, strict=True))
        g = directions[(permutation[(permutation[x] + y) % 2048] + z) % 2048]
        gradient += weight(d3) * sum(g[a] * (d3[a] - o[a]) for a in range(3))
    noise = [vector[0] + 0.5, (vector[0] + 1.05242) * 0.48985582, 0.4925 + 0.795 * gradient]
    return [min(max(n, 0.0), 1.0) for n in noise] + vector


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--include", default="/usr/share/povray-3.7/include", help="folder of functions.inc")
    parser.add_argument("--points", type=int, default=5000, help="points to compare, per range of coordinates")
    args = parser.parse_args()
    table = coefficients(args.include)
    for i in range(0, len(table), 12):
        print("    " + " ".join(f"{c}," for c in table[i : i + 12]))
    decimals, rng = [c / 1e8 for c in table], random.Random(1)
    for size in (3.0, 1e4, 1e7):
        points = [tuple(rng.uniform(-size, size) for _ in range(3)) for _ in range(args.points)]
        worst = [0.0] * 6
        for p, row in zip(points, measure(points, args.include), strict=True):
            worst = [max(w, abs(a - b)) for w, a, b in zip(worst, model(p, decimals), row, strict=True)]
        print(f"coordinates up to {size:g}: largest differences", *(f"{w:.1e}" for w in worst))


if __name__ == "__main__":
    main()
