"""Writes `smoke.vol`, the column of smoke of media.xml: a sum of turning noise, in Mitsuba's volume format.

    python make_smoke.py
"""

import pathlib
import struct

import numpy as np

SIZE = (28, 44, 28)


def noise(p: np.ndarray, rng: np.random.Generator, octaves: int) -> np.ndarray:
    """A sum of sines of random directions: smooth, and the same everywhere."""
    total = np.zeros(p.shape[:-1])
    amplitude, frequency = 1.0, 3.0
    for _ in range(octaves):
        for _ in range(6):
            direction = rng.normal(size=3)
            direction *= frequency / np.linalg.norm(direction)
            total += amplitude / 6 * np.sin(p @ direction * 2 + rng.uniform(0, 6.28))
        amplitude, frequency = amplitude * 0.6, frequency * 1.9
    return total


def main() -> None:
    """Writes the file beside this script."""
    rng = np.random.default_rng(3)
    axes = [(np.arange(n) + 0.5) / n for n in SIZE]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    swirl = np.stack([x, y * 1.6, z], axis=-1)
    bend = np.stack([noise(swirl, rng, 2) for _ in range(2)], axis=-1) * 0.12 * (0.3 + y[..., None])
    dx = x - 0.5 - bend[..., 0] - 0.07 * np.sin(5 * y)
    dz = z - 0.5 - bend[..., 1] - 0.07 * np.cos(4 * y)
    width = 0.06 + 0.22 * y
    column = np.exp(-(dx**2 + dz**2) / width**2)
    lumps = np.clip(0.55 + 0.9 * noise(swirl * 2.2, rng, 4), 0, None)
    edge = np.clip(np.minimum.reduce([x, 1 - x, z, 1 - z]) * 10, 0, 1) * np.clip((1 - y) * 3, 0, 1) * np.clip(y * 20, 0, 1)
    density = np.clip(column * lumps * edge - 0.02, 0, None).astype("<f4")
    density /= density.max()
    head = b"VOL\x03" + struct.pack("<5i6f", 1, *SIZE, 1, 0, 0, 0, 1, 1, 1)
    (pathlib.Path(__file__).parent / "smoke.vol").write_bytes(head + density.tobytes())


if __name__ == "__main__":
    main()
