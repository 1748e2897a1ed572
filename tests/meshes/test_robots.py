"""The robots have the requested sizes; parts and wholes fit."""

import numpy as np
import pytest
from shapely.geometry import Polygon

from toros_fem.meshes import GRIPPER, WALKER, Star

TWO_ARMS = Star(2, 0.05, 0.01, 0.02, 3e-3, 0.3)
ARMS_THAT_MEET_OUTSIDE_THE_BODY = Star(6, 0.04, 0.02, 0.01, 2e-3)


@pytest.mark.parametrize("star", [WALKER, GRIPPER, TWO_ARMS, ARMS_THAT_MEET_OUTSIDE_THE_BODY])
def test_star(star: Star) -> None:
    shape = Polygon(star.outline)
    assert shape.is_valid
    assert shape.exterior.is_ccw
    x, y = star.outline.T
    assert np.hypot(x, y).max() == pytest.approx(star.reach, rel=1e-12)
    for turn in (2 * np.pi / star.arms, -2 * star.angle):  # a turn, a mirror image in the axis
        c, s = np.cos(turn), np.sin(turn)
        image = star.outline @ np.array([[c, s], [-s, c]])
        if turn == -2 * star.angle:
            image = star.outline * [1, -1] @ np.array([[c, -s], [s, c]])
        assert shape.symmetric_difference(Polygon(image)).area < 1e-12 * shape.area
    for begin, end in np.array(star.roots):
        assert np.linalg.norm(end - begin) == pytest.approx(star.arm_width)
        # Tangent to the fillets: a point on the border, which turns there by next to nothing.
        gap = np.linalg.norm(star.outline - begin, axis=1)
        assert gap.min() < 1e-15
    edge = np.roll(star.outline, -1, axis=0) - star.outline
    turns = np.angle((edge[:, 0] + 1j * edge[:, 1]) / np.roll(edge[:, 0] + 1j * edge[:, 1], 1))
    assert np.abs(turns).max() < np.radians(5.001)
    assert turns.sum() == pytest.approx(2 * np.pi)
