"""Other widths of lines that stay where they are."""

import numpy as np
import pytest
from helpers.lines import even_field
from mpi4py import MPI

from toros_fem.design.lines.field import LineOptions
from toros_fem.design.lines.laid_lines import LaidLines, widened
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.lines.widths import smooth_functions, width_changes, within_bounds
from toros_fem.meshes.makers.sheets import rectangle

SIDE = 0.04


@pytest.fixture(scope="module")
def lines() -> LaidLines:
    """Lines along y, 1 mm wide, and 5 mm apart."""
    sheet = rectangle(MPI.COMM_SELF, SIDE, SIDE, 2e-3, "unstructured")
    return lay_lines(even_field(sheet, [0.2], [90.0]), LineOptions(widths=(1e-3,)))


def test_smooth_functions_are_those_of_a_square(lines: LaidLines) -> None:
    """Eigenvalues (π/a)² (i² + j²); the functions are orthonormal."""
    mesh = lines.mesh
    found = smooth_functions(mesh, 6)
    weight = mesh.vertex_areas / mesh.vertex_areas.sum()
    assert np.allclose(found.T @ (weight[:, None] * found), np.eye(6), atol=1e-8)
    energy = found.T @ (mesh.laplacian(mesh.weights) @ found)
    values = energy.diagonal() / mesh.vertex_areas.sum()
    expected = (np.pi / SIDE) ** 2 * np.array([0, 1, 1, 2, 4, 4])
    assert values == pytest.approx(expected, rel=0.03, abs=1e-6)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_widths_change_and_lines_stay(lines: LaidLines, factor: float) -> None:
    shape = 1, lines.mesh.size
    other = widened(lines, np.full(shape, factor))
    assert other.area == pytest.approx(factor * lines.area, rel=5e-3)  # the ends of lines are round
    assert other.families[0].length == lines.families[0].length
    wide = widened(lines, np.full(shape, 9.0))
    assert wide.area == pytest.approx(1.5 * lines.area, rel=0.02), "the largest width"
    assert np.all(within_bounds(wide, np.full(shape, 0.1)) == 0)
    assert np.allclose(within_bounds(wide, np.full(shape, -0.1)), -0.1)
    least = np.log(1.5**2)  # from the largest to the least
    assert np.allclose(within_bounds(wide, np.full(shape, -3.0)), -least)


def test_densities_of_changes_are_those_under_the_lines(lines: LaidLines) -> None:
    """The first function is 1: all lines get wider by as much as their density would grow."""
    fine = rectangle(MPI.COMM_SELF, SIDE, SIDE, 0.4e-3, "unstructured")
    changes = width_changes(lines.mesh, fine, [lines.families[0].under], 3)
    cells, free = np.arange(len(fine.panel)), np.ones((1, lines.mesh.size), dtype=bool)
    rows = changes.densities(cells, free)
    assert len(rows) == 3
    printed = abs(rows[0]) > 0.5
    assert np.allclose(abs(rows[0][printed]), 1.0, atol=1e-3)
    assert fine.areas @ printed == pytest.approx(lines.area, rel=0.02)
    change = changes.change(np.array([0.1 / changes.functions[0, 0], 0.0, 0.0]))
    assert np.allclose(change, 0.1, rtol=1e-3)
    assert np.allclose(changes.density(cells, change)[printed], 0.1, rtol=1e-3)
    assert not np.any(changes.densities(cells, ~free)[0])
