"""Means of the quadrants of the scenes here as Mitsuba 3 renders them, with standard errors; and the volume that one of them shows.

    python mitsuba_means.py [SAMPLES PER PIXEL AND RUN] [RUNS]

The numbers are in crates/render/tests/media_mitsuba.rs.
"""

import pathlib
import struct
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
HERE = pathlib.Path(__file__).parent


def write_volume() -> None:
    """6 × 5 × 4 lumps between 0 and 1, with values of 0."""
    size = (6, 5, 4)
    values = [((x * 37 + y * 11 + z * 23) % 17) / 16 for z in range(size[2]) for y in range(size[1]) for x in range(size[0])]
    head = b"VOL\x03" + struct.pack("<5i6f", 1, *size, 1, 0, 0, 0, 1, 1, 1)
    (HERE / "smoke.vol").write_bytes(head + struct.pack(f"<{len(values)}f", *values))


def quadrants(name: str, spp: int, runs: int) -> None:
    scene = mi.load_file(str(HERE / f"{name}.xml"))
    means = []
    for seed in range(runs):
        picture = np.array(mi.render(scene, spp=spp, seed=seed))[..., :3]
        means.append(picture.reshape(2, 4, 2, 4, 3).mean(axis=(1, 3)).reshape(4, 3))
    means = np.array(means)
    mean, error = means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(runs)
    print(name)
    for m, e in zip(mean, error):
        print("    ([" + ", ".join(f"{v:.5f}" for v in m) + "], [" + ", ".join(f"{v:.5f}" for v in e) + "]),")


if __name__ == "__main__":
    spp, runs = (int(a) for a in (sys.argv[1:] + ["1024", "16"][len(sys.argv) - 1 :]))
    write_volume()
    for name in ("fog", "smoke", "glass"):
        quadrants(name, spp, runs)
