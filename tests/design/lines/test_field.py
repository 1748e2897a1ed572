"""Fields of lines, and the sewn triangles that they are laid on."""

import numpy as np
import pytest
from helpers.lines import turned_halves
from mpi4py import MPI

from toros_fem.design.lines.field import LineField, LineMesh, LineOptions, make_line_mesh
from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import rectangle

SHEET = rectangle(MPI.COMM_SELF, 0.02, 0.01, 5e-3)
COUNT = len(SHEET.panel)


def test_holds_copies_that_do_not_change() -> None:
    shares = np.full((COUNT, 2), 0.1)
    field = LineField(SHEET, shares, np.zeros((COUNT, 2)))
    shares[:] = 0.5
    assert field.families == 2
    assert field.shares.max() == 0.1
    with pytest.raises(ValueError, match="read-only"):
        field.angles[0, 0] = 1.0


def test_one_width_counts_for_all_families() -> None:
    assert LineOptions(widths=(1e-3,)).width_of(1, 2) == 1e-3
    assert LineOptions(widths=(4e-3, 1e-3)).width_of(1, 2) == 1e-3


def whole(pattern: Pattern) -> LineMesh:
    return make_line_mesh(pattern, np.ones(len(pattern.panel), dtype=bool))


@pytest.mark.parametrize("degrees", [0.0, 37.0, 140.0, -90.0])
def test_a_direction_is_the_same_in_all_charts(degrees: float) -> None:
    pattern = turned_halves(degrees)
    mesh = whole(pattern)
    angle = np.radians(20.0 + degrees * pattern.panel)
    double = mesh.smoother(8e-3, turned=True)(mesh.double_angles(angle, np.ones(len(angle))))
    found = np.angle(double)[mesh.vertex] / 2 + mesh.turn
    assert np.abs(np.sin(found - angle[:, None])).max() < 1e-12
    assert np.allclose(np.abs(double), 1.0, atol=1e-12)


def test_a_mean_keeps_the_integral() -> None:
    mesh = whole(turned_halves(60.0))
    values = np.random.default_rng(0).random(mesh.size)
    smooth = mesh.smoother(5e-3)(values)
    assert mesh.vertex_areas @ smooth == pytest.approx(mesh.vertex_areas @ values, rel=1e-12)
    assert np.std(smooth) < 0.2 * np.std(values)
    assert np.array_equal(mesh.smoother(None)(values), values)


def test_fans_that_share_a_point_are_apart() -> None:
    """Around a point where two triangles without lines meet the others there are two fans."""
    sheet = rectangle(MPI.COMM_SELF, 2.0, 2.0, 1.0)
    middle = int(np.argmin(np.linalg.norm(sheet.points[:, :2] - 1.0, axis=1)))
    around = np.flatnonzero((sheet.triangles == middle).any(axis=1))
    angle = np.arctan2(*(sheet.centroids[around] - 1.0).T[::-1])
    order = around[np.argsort(angle)]
    active = np.ones(len(sheet.panel), dtype=bool)
    active[[order[0], order[3]]] = False
    mesh = make_line_mesh(sheet, active)
    assert np.array_equal(mesh.cells, np.flatnonzero(active))
    here = sheet.triangles[mesh.cells] == middle
    assert len(np.unique(mesh.vertex[here])) == 2


def test_directions_go_around_a_tube() -> None:
    """Helices cross the seam of the wall without a turn, and the rims to the caps with one."""
    tube = cylinder(MPI.COMM_SELF, 0.05, 0.02, 3e-3)
    wall = make_line_mesh(tube, tube.panel == tube.panel_index("wall"))
    assert np.abs(wall.turn).max() == 0
    assert np.abs(whole(tube).turn).max() > 0.1
