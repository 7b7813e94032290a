#!/usr/bin/env python3
"""Writes meshes/knot.ply: a torus knot with smooth normals. Standard library only; the same bytes on every run.

    python scenes/gallery/make_meshes.py
"""

import math
import pathlib
import struct

AROUND, ALONG = 20, 360
P, Q = 2, 3


def center(t: float) -> list[float]:
    r = 0.62 + 0.28 * math.cos(Q * t)
    return [r * math.cos(P * t), r * math.sin(P * t), 0.34 * math.sin(Q * t)]


def normalize(v: list[float]) -> list[float]:
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def main() -> None:
    vertices, faces = [], []
    for i in range(ALONG):
        t = 2 * math.pi * i / ALONG
        p, ahead, back = center(t), center(t + 1e-4), center(t - 1e-4)
        tangent = normalize([a - b for a, b in zip(ahead, back)])
        side = normalize(cross(tangent, normalize(p)))
        up = cross(side, tangent)
        for j in range(AROUND):
            a = 2 * math.pi * j / AROUND
            n = [math.cos(a) * s + math.sin(a) * u for s, u in zip(side, up)]
            vertices.append([x + 0.135 * y for x, y in zip(p, n)] + n)
            k, l = (i + 1) % ALONG, (j + 1) % AROUND
            quad = [i * AROUND + j, k * AROUND + j, k * AROUND + l, i * AROUND + l]
            faces += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
    names = "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz"))
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment made by scenes/gallery/make_meshes.py\nelement vertex {len(vertices)}\n{names}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = b"".join(struct.pack("<6f", *v) for v in vertices) + b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    (pathlib.Path(__file__).parent / "meshes" / "knot.ply").write_bytes(header.encode() + data)


if __name__ == "__main__":
    main()
