"""Two flat panels along any outline: they fit and close, with lines and cuts at given places."""

import numpy as np
import pytest
from helpers.outlines import check_twins, edges_on, volume
from mpi4py import MPI

from toros_fem.mechanics.skin.planes import Planes
from toros_fem.mechanics.skin.supports import symmetry_plane
from toros_fem.meshes import two_panels

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
