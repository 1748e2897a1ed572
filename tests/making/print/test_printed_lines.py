"""Lines that come as polygons: on other meshes, on the whole of a part, printed and simulated."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.designs import make_problem
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.print.as_printed import as_printed, printed, printed_lines
from toros_fem.making.print.cleaning import MirroredPanels
from toros_fem.making.print.printability import PrintLimits, printed_cells
from toros_fem.making.print.regions import regions_on
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Pattern, Skin, cylinder, mirrored, two_panels

NOTHING = shapely.Polygon()


def slanted_lines(pattern: Pattern, name: str = "wall") -> list[BaseGeometry]:
    """Lines of 4 mm on one panel, and an island of 1 mm² between two of them."""
    corners = pattern.corners[pattern.cells_of(name)]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    lines = [
        shapely.LineString([low + [x, 0], low + [x + 0.02, high[1] - low[1]]]).buffer(2e-3)
        for x in np.arange(-0.02, 0.07, 0.012)
    ]
    lines.append(shapely.box(*(low + [0.014, 0.012]), *(low + [0.015, 0.013])))
    regions = [NOTHING] * len(pattern.panel_names)
    inside = shapely.box(*low, *high)
    regions[pattern.panel_index(name)] = shapely.union_all(lines).intersection(inside)
    return regions


@pytest.mark.parametrize("planes", [(1,), (0, 1)])
def test_lines_on_the_whole_of_a_tube(alone: MPI.Comm, planes: tuple[int, ...]) -> None:
    part = cylinder(alone, 0.06, 0.02, 2e-3, planes=planes)
    regions, whole = slanted_lines(part), mirrored(part, planes)
    found = MirroredPanels(part, whole).whole(regions)
    wall = part.panel_index("wall")
    images = 2 ** len(planes)
    assert found[wall].area == pytest.approx(images * regions[wall].area, rel=1e-5)
    same = printed_cells(whole.pattern, found) == whole.at_cells(
        printed_cells(part, regions).astype(float)
    )
    # But for centroids on a border, which rounding moves across it.
    assert np.count_nonzero(~same) <= images


def test_a_panel_that_is_not_cut_gets_an_image_of_its_own(alone: MPI.Comm) -> None:
    outline = np.array([[0, 0], [0.04, 0], [0.04, 0.02], [0, 0.02]]) - [0.02, 0.01]
    part = two_panels(alone, outline, 3e-3, planes=(0,))
    whole = mirrored(part, (0,))
    regions = [shapely.box(0.0, 0.0, 0.01, 0.005), shapely.box(0.005, -0.005, 0.01, 0.005)]
    found = MirroredPanels(part, whole).whole(regions)
    assert [region.area for region in found] == pytest.approx([1e-4, 1e-4], rel=1e-6)
    assert found[0].geom_type == "Polygon", "one piece across the cut"
    assert found[1].geom_type == "MultiPolygon"


def test_lines_on_another_mesh_are_scaled_with_its_panels(alone: MPI.Comm) -> None:
    coarse, fine = (cylinder(alone, 0.06, 0.02, edge) for edge in (5e-3, 1.5e-3))
    regions = slanted_lines(coarse)
    found = regions_on(coarse, regions, fine)
    wall = coarse.panel_index("wall")
    share = [
        area / pattern.areas[pattern.cells_of("wall")].sum()
        for area, pattern in ((regions[wall].area, coarse), (found[wall].area, fine))
    ]
    assert share[1] == pytest.approx(share[0], rel=1e-9)
    assert found[wall].area > 1.005 * regions[wall].area, "the coarse prism has fewer sides"
    again = regions_on(fine, found, coarse)
    assert again[wall].symmetric_difference(regions[wall]).area < 1e-9 * regions[wall].area


def test_contours_of_a_design_are_printed_alike(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    """The same polygons, by way of a density or given directly, make the same print."""
    problem = make_problem(short_tube, short_solver, beta=20.0)
    density = random_density(short_tube, 3, spread=0.5)
    result = DesignResult(problem, density, problem.simulate(density), (), "", {})
    limits = PrintLimits()
    first = as_printed(problem, result, limits, island_area=math.inf)
    near = short_tube.pattern, problem.physics.shape_of(result.final.equilibrium)
    lines = printed_lines(
        problem, short_tube.pattern, first.regions, limits, island_area=math.inf, near=near
    )
    assert first.cleaned.dropped
    assert lines.cells.tolist() == first.cells.tolist()
    far = printed_lines(problem, short_tube.pattern, first.regions, limits, island_area=math.inf)
    assert lines.evaluation.equilibrium.steps < far.evaluation.equilibrium.steps
    cold = printed(problem, lambda: first.cleaned, limits, pressure=3e3)
    assert cold.after.summary() == first.after.summary()
    assert cold.evaluation.equilibrium.pressure == 3e3
    there = cold.evaluation.problem.physics.shape_of(cold.evaluation.equilibrium)
    near = cold.evaluation.problem.skin.pattern, there
    warm = printed(problem, lambda: first.cleaned, limits, near=near, pressure=3e3)
    assert warm.evaluation.equilibrium.steps < cold.evaluation.equilibrium.steps
    # A print that is cleaned again moves by less than its smallest detail.
    away = [
        a.symmetric_difference(b).area for a, b in zip(lines.regions, first.regions, strict=True)
    ]
    assert sum(away) < 1e-4 * sum(region.area for region in first.regions)
    assert lines.evaluation.shape == pytest.approx(first.evaluation.shape, rel=1e-3)
    assert lines.evaluation.equilibrium.pressure == problem.physics.pressure
    cut = ~np.isin(lines.evaluation.density, (0.0, 1.0))
    assert 0 < cut.mean() < 0.5


def test_islands_are_kept_where_nothing_else_is_said(
    short_tube: Skin, short_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = make_problem(short_tube, short_solver)

    def failing(*_: Any, **__: Any) -> None:
        raise NoEquilibriumError("made to fail")

    monkeypatch.setattr(problem, "simulate_binary", failing)
    made = printed_lines(problem, short_tube.pattern, slanted_lines(short_tube.pattern))
    least = min(island.area for island in made.cleaned.bridged)
    assert least == pytest.approx(1e-6, rel=0.1), "that between two lines, with round corners"
    assert made.evaluation is None
