"""Skins of two panels, and outlines."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.outlines import check_twins, edges_on, volume
from mpi4py import MPI
from shapely.geometry import Polygon

from toros_fem.mechanics.skin.supports import Planes, symmetry_plane
from toros_fem.meshes import GRIPPER, WALKER, Star, rounded, two_panels
from toros_fem.meshes.outlines import arc

SQUARE = np.array([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])
ELL = np.array([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0, 0.05]])
ANGLE = 2 * np.pi * np.arange(120) / 120
CIRCLE = 0.02 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])


@pytest.mark.parametrize(
    ("outline", "area"),
    [(SQUARE, 16e-4), (SQUARE[::-1], 16e-4), (ELL, 18e-4), (CIRCLE, np.pi * 4e-4)],
    ids=["square", "clockwise", "ell", "circle"],
)
def test_panels_fit_and_close(alone: MPI.Comm, outline: np.ndarray, area: float) -> None:
    pattern = two_panels(alone, outline, 4e-3)
    pattern.require_closed()
    check_twins(pattern)
    assert pattern.areas.sum() == pytest.approx(2 * area, rel=1e-9 if len(outline) < 9 else 0.02)
    assert volume(pattern) > 0
    seam = pattern.flat_points[pattern.seams]
    lengths = np.linalg.norm(seam[:, 0, 1] - seam[:, 0, 0], axis=1)
    assert lengths == pytest.approx(4e-3, rel=0.07)


def test_cut_of_one_edge_stays_open(alone: MPI.Comm) -> None:
    strip = np.array([[-0.03, 0], [0.03, 0], [0.03, 4e-3], [-0.03, 4e-3]])
    pattern = two_panels(alone, strip, 3.5e-3, planes=(0,))
    assert len(pattern.free_edges) == 4
    assert Planes(pattern, symmetry_plane(pattern, 0)).close


def test_lines_are_mesh_edges_on_both_panels(alone: MPI.Comm) -> None:
    lines = [
        ((0.03, 0.0), (0.03, 0.02)),
        ((0.0, 0.03), (0.02, 0.033)),
        ((0.045, -1.0), (0.03, 1.0)),
    ]
    pattern = two_panels(alone, ELL, 4e-3, lines=lines)
    check_twins(pattern)
    pattern.require_closed()
    for line in lines[:2]:
        ends = np.array(line)
        top, bottom = (edges_on(pattern, panel, *ends) for panel in ("top", "bottom"))
        assert len(top) >= 5
        assert top == pytest.approx(bottom, abs=1e-15)
        assert top[:, 0] == pytest.approx(np.append(0, top[:-1, 1]), abs=1e-12)
        assert top[-1, 1] == pytest.approx(1)


def test_crossing_lines(alone: MPI.Comm) -> None:
    lines = [((-0.02, -0.01), (0.02, 0.01)), ((0.01, -0.02), (-0.01, 0.02))]
    pattern = two_panels(alone, SQUARE, 4e-3, lines=lines)
    check_twins(pattern)
    assert np.linalg.norm(pattern.points[:, :2], axis=1).min() < 1e-15
    assert pattern.areas.sum() == pytest.approx(32e-4)


@pytest.mark.parametrize("planes", [(0,), (1,), (0, 1)])
def test_cut_is_free_and_in_its_plane(alone: MPI.Comm, planes: tuple[int, ...]) -> None:
    # A line along a cut, one across it, and one that the cut takes away or leaves.
    lines = [((0.0, -0.02), (0.0, 0.02)), ((-0.02, -0.013), (0.02, 0.013)),
             ((-0.015, -0.02), (-0.015, 0.02))]  # fmt: skip
    pattern = two_panels(alone, SQUARE, 4e-3, lines=lines, planes=planes)
    check_twins(pattern)
    assert pattern.areas.sum() == pytest.approx(32e-4 / 2 ** len(planes))
    assert volume(pattern) > 0
    fixed = symmetry_plane(pattern, planes[0])
    for axis in planes[1:]:
        fixed |= symmetry_plane(pattern, axis)
    assert Planes(pattern, fixed).close
    assert len(fixed.guided) == len(pattern.free_edges)
    for axis in planes:
        border = np.unique(symmetry_plane(pattern, axis).guided)
        assert (pattern.points[border, axis] == 0).all()
        assert (pattern.points[:, axis] >= 0).all()
    edges = edges_on(pattern, "bottom", np.array([0, 0]), np.array([0.02, 0.013]))
    assert edges[:, 0] == pytest.approx(np.append(0, edges[:-1, 1]), abs=1e-12)
    assert edges[-1, 1] == pytest.approx(1)


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


def test_rounded_convex_and_concave_corners() -> None:
    radius = 4e-3
    points = rounded(ELL, radius)
    x, y = points.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    # Five corners lose what the inner one gains, all of 90 degrees.
    exact = 18e-4 - 4 * (1 - np.pi / 4) * radius**2
    assert area == pytest.approx(exact, rel=1e-4)
    inner = points[np.linalg.norm(points - [0.024, 0.024], axis=1) < 1.001 * radius]
    assert np.linalg.norm(inner - [0.024, 0.024], axis=1) == pytest.approx(radius, rel=1e-12)
    sharp = rounded(ELL, [0, radius, radius, radius, radius, 0])
    assert sharp[0] == pytest.approx([0, 0])
    assert sharp[-1] == pytest.approx([0, 0.05])


def test_inner_edge_between_borders_is_halved(alone: MPI.Comm) -> None:
    """A strip one triangle wide has nothing but such edges."""
    strip = np.array([[0, 0], [0.03, 0], [0.03, 4e-3], [0, 4e-3]])
    pattern = two_panels(alone, strip, 3.5e-3)
    pattern.require_closed()
    seam = np.intersect1d(pattern.vertices_of("top"), pattern.vertices_of("bottom"))
    top = pattern.triangles[pattern.cells_of("top")]
    assert not np.isin(top, seam).all(axis=1).any()


def test_arcs() -> None:
    points = arc([1, 2], 0.5, 0, np.pi / 2)
    assert len(points) == 19
    assert points[[0, -1]] == pytest.approx(np.array([[1.5, 2], [1, 2.5]]), abs=1e-15)
    assert np.linalg.norm(points - [1, 2], axis=1) == pytest.approx(0.5)
