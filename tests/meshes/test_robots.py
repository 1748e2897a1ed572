"""The robots have the sizes they are asked for; parts and wholes fit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.outlines import check_twins, edges_on, volume
from mpi4py import MPI
from shapely.geometry import Polygon
from stability_scenes import fan_tube

from toros_fem.errors import OutlineError, ParameterError, PatternError
from toros_fem.meshes import GRIPPER, WALKER, Star, finger, gripper, mirrored, walker
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheet import one_panel

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


def check_mirrored(part: Pattern, axes: tuple[int, ...], panels: int) -> Pattern:
    whole = mirrored(part, axes)
    count = 2 ** len(axes)
    assert len(whole.pattern.panel_names) == panels
    assert whole.pattern.areas == pytest.approx(part.areas[whole.cell], rel=1e-12)
    assert len(whole.pattern.panel) == count * len(part.panel)
    assert whole.at_vertices(part.points) == pytest.approx(whole.pattern.points, abs=1e-18)
    assert volume(whole.pattern) == pytest.approx(count * volume(part), rel=1e-12)
    values = np.arange(len(part.panel), dtype=float)
    assert np.bincount(whole.at_cells(values).astype(int)) == pytest.approx(count)
    return whole.pattern


def test_mirrored_walker_is_whole(comm: MPI.Comm) -> None:
    quarter = walker(comm, 6e-3, planes=(0, 1))
    whole = check_mirrored(quarter, (0, 1), 2)
    whole.require_closed()
    # The cuts are no seams: only the outline is.
    seam = 4 * len(quarter.seams)
    assert len(whole.seams) == seam
    half = check_mirrored(quarter, (1,), 2)
    assert (half.points[np.unique(half.free_edges), 0] == 0).all()
    assert mirrored(quarter, ()).pattern is quarter


def test_mirrored_sheet_and_panels_off_the_plane(comm: MPI.Comm) -> None:
    """A quarter of a box without a lid: one wall is cut nowhere."""
    side = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    part = Pattern(
        flat_points=np.concatenate([side, side]),
        flat_triangles=np.concatenate([triangles, triangles + 4]),
        panel=np.array([0, 0, 1, 1]),
        sewn=np.array([0, 1, 2, 3, 1, 4, 5, 2]),
        points=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1.0]]),
        panel_names=("floor", "wall"),
    )
    whole = check_mirrored(part, (0,), 3)
    assert whole.panel_names == ("floor", "wall", "wall, mirrored in x = 0")
    assert len(whole.seams) == 2


def test_mirrored_half_tube_closes_at_a_second_cut(comm: MPI.Comm) -> None:
    half = fan_tube(np.linspace(0, np.pi, 9), np.linspace(0, 0.05, 8))
    tube = check_mirrored(half, (1,), 3)
    tube.require_closed()
    # Sewn along one generator and around both caps, which go on across the cut.
    assert len(tube.seams) == 7 + 2 * 16


def test_part_that_reaches_across_its_plane_is_refused() -> None:
    """An L-shaped sheet from x = −1 to 1, whose inner side lies in the plane x = 0."""
    corners = np.array([[-1, 0], [0, 0], [1, 0], [1, 1], [0, 1], [0, 2], [-1, 2], [-1, 1]])
    triangles = np.array([[0, 1, 7], [1, 4, 7], [1, 2, 4], [2, 3, 4], [7, 4, 6], [4, 5, 6]])
    ell = one_panel(corners.astype(float), triangles)
    with pytest.raises(PatternError, match=r"across the plane x = 0 .* vertex 0 lies at x = -1 m"):
        mirrored(ell, (0,))
    half = one_panel(corners[[0, 1, 4, 5, 6, 7]].astype(float), np.array(
        [[0, 1, 5], [1, 2, 5], [5, 2, 4], [2, 3, 4]]))  # fmt: skip
    assert mirrored(half, (0,)).pattern.areas.sum() == pytest.approx(2 * half.areas.sum())


def test_nothing_to_mirror(comm: MPI.Comm) -> None:
    with pytest.raises(ParameterError, match="no free edge lies in the plane x = 0"):
        mirrored(finger(comm, 5e-3, planes=(1,)), (0,))
    with pytest.raises(ParameterError, match="axes holds 3"):
        mirrored(finger(comm, 5e-3, planes=(1,)), (3,))
