"""The robots have the requested sizes; parts and wholes fit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.outlines import check_twins, edges_on, volume
from mpi4py import MPI
from shapely.geometry import Polygon

from toros_fem.base.errors import OutlineError, ParameterError
from toros_fem.meshes import GRIPPER, WALKER, Star, finger, gripper, walker

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


def test_star_that_is_none() -> None:
    with pytest.raises(OutlineError, match=r"arm_length = 0.01 m must exceed"):
        replace(WALKER, arm_length=0.01)
    with pytest.raises(OutlineError, match=r"at most the body's diameter of 0.04 m"):
        replace(WALKER, arm_width=0.05)
    with pytest.raises(ParameterError, match="arms = 1"):
        replace(WALKER, arms=1)


@pytest.mark.parametrize("planes", [(), (0,), (1,), (0, 1)])
def test_walker(comm: MPI.Comm, planes: tuple[int, ...]) -> None:
    pattern = walker(comm, 6e-3, planes=planes)
    check_twins(pattern)
    exact = 2 * Polygon(WALKER.outline).area / 2 ** len(planes)
    assert pattern.areas.sum() == pytest.approx(exact, rel=0.02)
    root = np.array(WALKER.roots[0])
    for panel in ("top", "bottom"):
        edges = edges_on(pattern, panel, *root)
        assert edges[:, 0] == pytest.approx(np.linspace(0, 1, len(edges) + 1)[:-1], abs=1e-9)
        assert len(edges) == 4


def test_finger_and_gripper(comm: MPI.Comm) -> None:
    for whole, half in (
        (finger(comm, 5e-3), finger(comm, 5e-3, planes=(1,))),
        (gripper(comm, 6e-3), gripper(comm, 6e-3, planes=(1,))),
    ):
        check_twins(whole)
        check_twins(half)
        whole.require_closed()
        assert half.areas.sum() == pytest.approx(whole.areas.sum() / 2, rel=0.01)
        assert volume(half) == pytest.approx(volume(whole) / 2, rel=0.1)
    assert np.ptp(finger(comm, 5e-3).points[:, 0]) == pytest.approx(0.09, rel=0.01)
    with pytest.raises(OutlineError, match="root = 0.08 m must lie between"):
        finger(comm, 5e-3, root=0.08)
    with pytest.raises(OutlineError, match="mirror image in x = 0"):
        gripper(comm, 6e-3, planes=(0,))
