"""Transforms for scenes in dictionaries."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Transform:
    """An affine transform of a scene in a dictionary. Steps are chained; the last one acts on the object first.

    ```python
    Transform().translate([0, 0, 1]).rotate([0, 1, 0], 45).scale(2)  # scales, then rotates, then moves
    ```
    """

    __slots__ = ("matrix",)

    matrix: NDArray[np.float64]
    """The transform of column vectors, of shape (4, 4)."""

    def __init__(self, matrix: ArrayLike | None = None) -> None:
        """Start from a matrix of shape (4, 4), or from the identity."""
        self.matrix = np.eye(4) if matrix is None else np.array(matrix, dtype=np.float64)
        if self.matrix.shape != (4, 4):
            raise ValueError(f"a transform has shape (4, 4), not {self.matrix.shape}")

    def __repr__(self) -> str:
        return f"Transform({self.matrix.tolist()})"

    def __matmul__(self, other: Transform) -> Transform:
        """Return the transform that does `other` first, then this one."""
        return Transform(self.matrix @ other.matrix)

    def translate(self, offset: ArrayLike) -> Transform:
        """Move by an offset of shape (3,)."""
        step = np.eye(4)
        step[:3, 3] = np.asarray(offset, dtype=np.float64)
        return Transform(self.matrix @ step)

    def scale(self, factor: ArrayLike) -> Transform:
        """Scale by one factor or by one for each axis."""
        return Transform(self.matrix @ np.diag([*np.broadcast_to(np.asarray(factor, dtype=np.float64), 3), 1.0]))

    def rotate(self, axis: ArrayLike, angle: float) -> Transform:
        """Rotate about an axis through the origin by an angle in degrees, counterclockwise when seen against the axis."""
        direction = np.asarray(axis, dtype=np.float64)
        length = float(np.linalg.norm(direction))
        if direction.shape != (3,) or not length > 0.0:
            raise ValueError(f"an axis has three numbers, not all 0, unlike {direction.tolist()}")
        x, y, z = (float(v) for v in direction / length)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = math.radians(angle)
        step = np.eye(4)
        # Rodrigues' formula.
        step[:3, :3] += math.sin(turn) * cross + (1.0 - math.cos(turn)) * (cross @ cross)
        return Transform(self.matrix @ step)

    def look_at(self, origin: ArrayLike, target: ArrayLike, up: ArrayLike) -> Transform:
        """Place a camera as Mitsuba does: at `origin`, looking along its +z to `target`, with `up` in its yz plane."""
        eye = np.asarray(origin, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - eye
        left = np.cross(np.asarray(up, dtype=np.float64), forward)
        lengths = float(np.linalg.norm(forward)), float(np.linalg.norm(left))
        if not min(lengths) > 0.0:
            raise ValueError("look_at needs a target away from its origin and an up vector across the line to it")
        forward, left = forward / lengths[0], left / lengths[1]
        step = np.eye(4)
        step[:3, :] = np.column_stack([left, np.cross(forward, left), forward, eye])
        return Transform(self.matrix @ step)
