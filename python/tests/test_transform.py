import numpy as np
import pytest

import etendue

X, Y, Z = np.eye(3)


def apply(transform: etendue.Transform, point: np.ndarray) -> np.ndarray:
    return (transform.matrix @ [*point, 1.0])[:3]


def test_the_last_step_acts_first() -> None:
    moved = etendue.Transform().translate([1, 0, 0]).rotate([0, 0, 1], 90).scale(2)
    assert apply(moved, X) == pytest.approx([1, 2, 0])
    other = etendue.Transform().translate(X) @ etendue.Transform().rotate(Z, 90) @ etendue.Transform().scale([2, 2, 2])
    assert other.matrix == pytest.approx(moved.matrix)


def test_rotations_are_counterclockwise_and_rigid() -> None:
    assert apply(etendue.Transform().rotate(X, 90), Y) == pytest.approx(Z)
    matrix = etendue.Transform().rotate([1, 2, -3], 77).matrix[:3, :3]
    assert matrix @ matrix.T == pytest.approx(np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_look_at_is_mitsubas_camera_frame() -> None:
    camera = etendue.Transform().look_at(origin=[0, 1, 4], target=[0, 1, 0], up=[0, 2, 0])
    assert apply(camera, np.zeros(3)) == pytest.approx([0, 1, 4])
    assert apply(camera, Z) == pytest.approx([0, 1, 3])
    # +x is to the left of who looks along −z.
    assert apply(camera, X) == pytest.approx([-1, 1, 4])


@pytest.mark.parametrize("bad", [lambda t: t.rotate([0, 0, 0], 1), lambda t: t.look_at(X, X, Y), lambda t: t.look_at(X, Y, Y - X)])
def test_degenerate_steps_are_refused(bad: object) -> None:
    with pytest.raises(ValueError, match=r"axis|look_at"):
        bad(etendue.Transform())


def test_a_transform_is_four_by_four() -> None:
    with pytest.raises(ValueError, match="shape"):
        etendue.Transform(np.eye(3))
