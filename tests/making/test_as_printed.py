"""The printed design, of a density or of lines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.designs import full, make_problem, passive_in, problem_of
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import NoEquilibriumError, PatternError
from toros_fem.design.loop.fields import densities_of, random_density
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed import (
    as_printed,
    contour_values,
    polished,
    printed,
    printed_lines,
    without_free_islands,
)
from toros_fem.making.cleaning import MirroredPanels
from toros_fem.making.printability import PrintLimits, printed_cells, regions_on
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Pattern, Skin, cylinder, mirrored, two_panels
from toros_fem.products.tubes import BendScene
from toros_fem.products.walker import WalkerScene

NOTHING = shapely.Polygon()


@pytest.fixture(scope="module")
def result(short_tube: Skin, short_solver: EquilibriumSolver) -> DesignResult:
    problem = full(short_tube, short_solver, beta=20.0)
    return optimize(problem, DesignOptions((Stage(2),)), start=random_density(short_tube, 3))


def test_contours_are_of_the_filters_own_field(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    problem = full(short_tube, short_solver)
    density = random_density(short_tube, 3, spread=0.5)
    at_points, at_centroids = contour_values(problem, density)
    pattern, wall = short_tube.pattern, short_tube.pattern.cells_of("wall")
    filtered = short_tube.gather_cells(
        densities_of(problem.fields).filter.forward(problem.fields.with_passive(density))
    )
    assert at_centroids[wall] == pytest.approx(filtered[wall])
    caps = np.setdiff1d(np.arange(len(pattern.panel)), wall)
    assert np.all(at_centroids[caps] == 1)
    assert np.all(at_points[pattern.flat_triangles[caps]] == 1)
    exact = densities_of(problem.fields).filter.at_points(problem.fields.with_passive(density))
    points = np.unique(pattern.flat_triangles[wall])
    assert at_points[points] == pytest.approx(exact[points])


def test_given_triangles_inside_a_panel(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """A point among given triangles is given, one at their border is the filter's."""
    pattern = short_tube.pattern
    given = (pattern.panel == pattern.panel_index("wall")) & (pattern.centroids[:, 1] < 0.02)
    passive = np.where(given, 0.0, np.nan)[short_tube.owned_cells]
    problem = passive_in(full(short_tube, short_solver), passive)
    at_points, at_centroids = contour_values(problem, np.ones(len(short_tube.owned_cells)))
    assert np.all(at_centroids[given] == 0)
    inside = np.setdiff1d(pattern.flat_triangles[given], pattern.flat_triangles[~given])
    border = np.intersect1d(pattern.flat_triangles[given], pattern.flat_triangles[~given])
    assert np.all(at_points[inside] == 0)
    assert np.all((at_points[border] > 0) & (at_points[border] < 1))


def test_printed_design(
    short_tube: Skin, short_solver: EquilibriumSolver, result: DesignResult
) -> None:
    problem = full(short_tube, short_solver, beta=20.0)
    printed = as_printed(problem, result, PrintLimits(), island_area=math.inf)
    for told in (result, printed, result.final.equilibrium):
        assert type(told).__name__ in repr(told)
        assert len(repr(told)) < 300, "no arrays"
    assert not printed.after.free_islands
    assert not printed.after.lines.narrow
    assert not printed.after.gaps.narrow
    part, cells = printed.evaluation.projected, printed.cells[short_tube.owned_cells]
    uncut = np.isin(part, (0.0, 1.0))
    assert np.array_equal(part[uncut] > 0.5, cells[uncut])
    areas = printed.pattern.areas[short_tube.owned_cells]
    drawn = sum(region.area for region in printed.regions)
    assert areas @ part == pytest.approx(drawn, rel=1e-3)

    # Contours alone are the projected density rounded.
    cells = printed_cells(printed.pattern, printed.contours)[short_tube.owned_cells]
    rounded = result.final.filtered > 0.5
    assert np.array_equal(cells[problem.designed], rounded[problem.designed])


def seen_starts(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How far the start of each print that is simulated is from the assembled shape."""
    simulate, starts = ShapeDesign.simulate_binary, list[float]()

    def seen(self: ShapeDesign, printed: Any, like: Any, *, start: Any, pressure: Any) -> Any:
        state = np.array_equal(start, self.solver.model.assembled)
        rest = self.skin.pattern.points[self.skin.owned_vertices]
        starts.append(0.0 if state else float(np.abs(start - rest).max()))
        return simulate(self, printed, like, start=start, pressure=pressure)

    monkeypatch.setattr(ShapeDesign, "simulate_binary", seen)
    return starts


def test_a_print_whose_start_is_out_of_bounds_starts_assembled(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of(
        alone, BendScene().updated(length=0.04, edge_length=5e-3, filter_radius=9e-3, levels=1)
    )
    made = optimize(problem, [Stage(1)], seed=1)
    starts = seen_starts(monkeypatch)
    near = as_printed(problem, made)
    monkeypatch.setattr(InflatedSkin, "state_at", lambda self, positions: None)
    far = as_printed(problem, made)
    assert starts[0] > 1e-3
    assert starts[1] == 0
    assert far.evaluation.shape == pytest.approx(near.evaluation.shape, rel=1e-5)


def test_a_flat_skin_is_inflated_from_rest(
    short_tube: Skin, short_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Near the shape of its design it may have another equilibrium: a crawler had, by 13°."""
    assert not full(short_tube, short_solver).flat_at_rest
    scene = WalkerScene.of(edge_length=5e-3, filter_radius=8e-3)
    level = scene.finest_level
    problem = scene.problem(MPI.COMM_SELF, scene.case(MPI.COMM_SELF, level), level)
    start = random_density(problem.skin, 3)
    found = optimize(problem, DesignOptions((Stage(1),)), start=start)
    starts = seen_starts(monkeypatch)
    made = as_printed(problem, found)
    assert made.evaluation is not None, made.failure
    assert isinstance(made.evaluation.problem, ShapeDesign)
    assert made.evaluation.problem.flat_at_rest
    assert starts == [0.0]


def test_islands_are_taken_out_of_the_density(
    short_tube: Skin, short_solver: EquilibriumSolver, result: DesignResult
) -> None:
    """A body, a speck near it and one far from it: both are joined to it, or it stays as it was."""
    problem = full(short_tube, short_solver, beta=20.0)
    pattern, radius = short_tube.pattern, densities_of(problem.fields).filter.radius
    u, v = pattern.centroids.T
    width = pattern.corners[pattern.cells_of("wall")][..., 0].max()
    spots = [(0.2 * width, 0.047), (0.8 * width, 0.042)]
    whole = (v < 0.03) & (v > 0.01)
    for x, y in spots:
        whole |= np.hypot(u - x, v - y) < 0.8 * radius
    density = whole.astype(float)[short_tube.owned_cells]
    chosen = DesignResult(problem, density, problem.simulate(density), result.history, "", {})
    printed = as_printed(problem, chosen, PrintLimits())
    assert len(printed.before.free_islands) == 2
    starts = without_free_islands(problem, chosen, printed)
    assert len(starts) == 2  # all islands are specks
    start, joined = sorted(starts, key=np.sum)
    assert (joined >= density).all()
    assert (start <= density).all()
    again = DesignResult(problem, start, problem.simulate(start), (), "", {})
    bare = as_printed(problem, again, PrintLimits())
    assert not bare.before.free_islands
    wall = pattern.panel_index("wall")
    body = max(printed.contours[wall].geoms, key=lambda part: part.area)
    assert bare.contours[wall].symmetric_difference(body).area < 0.01 * body.area
    options = DesignOptions((Stage(1),))
    assert polished(again, bare, options) is again
    onward = polished(chosen, printed, options)
    begin = onward.history[len(result.history)]
    least = min(problem.simulate(one).objective for one in starts)
    assert begin.objective == pytest.approx(least, rel=1e-3)
    assert len(onward.history) == len(result.history) + 2


def test_islands_near_each_other_are_joined_to_the_body(
    short_tube: Skin,
    short_solver: EquilibriumSolver,
    result: DesignResult,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two spots that are nearer to each other than to the body, and a speck: none is left free."""
    problem = full(short_tube, short_solver, beta=20.0)
    pattern, radius = short_tube.pattern, densities_of(problem.fields).filter.radius
    u, v = pattern.centroids.T
    width = pattern.corners[pattern.cells_of("wall")][..., 0].max()
    whole = (v < 0.024) & (v > 0.01)
    for way in (-0.95, 0.95):
        whole |= np.hypot(u - 0.37 * width - 1.6 * way * radius, v - 0.042) < 1.2 * radius
    from_speck = np.hypot(u - 0.88 * width, v - 0.044)
    whole |= from_speck < 0.8 * radius
    density = whole.astype(float)[short_tube.owned_cells]
    chosen = DesignResult(problem, density, problem.simulate(density), result.history, "", {})
    printed = as_printed(problem, chosen, PrintLimits())
    islands = [island.polygon for island in printed.before.free_islands]
    speck, one, two = sorted(islands, key=lambda island: island.area)
    assert speck.area < np.pi * radius**2 < one.area
    body = max(printed.contours[pattern.panel_index("wall")].geoms, key=lambda part: part.area)
    assert one.distance(two) < one.distance(body)
    starts = without_free_islands(problem, chosen, printed)
    cleared, without_specks, joined = sorted(starts, key=np.sum)
    for start in starts:
        found = DesignResult(problem, start, problem.simulate(start), (), "", {})
        assert not as_printed(problem, found, PrintLimits()).before.free_islands
    assert (joined >= density).all()
    assert (cleared <= density).all()
    distance = from_speck[short_tube.owned_cells]
    assert (without_specks[distance < 0.8 * radius] == 0).all()
    assert (without_specks >= density)[distance > 2 * radius].all()
    options, first = DesignOptions((Stage(1),)), len(result.history)
    onward, simulate, tried = polished(chosen, printed, options), problem.simulate, list[bool]()
    least = sorted((simulate(start).objective, index) for index, start in enumerate(starts))
    assert onward.history[first].objective == pytest.approx(least[0][0], rel=1e-3)

    def failing_for_the_best(*args: Any, **given: Any) -> Any:
        tried.append(True)
        if len(tried) == least[0][1] + 1:
            raise NoEquilibriumError("made to fail")
        return simulate(*args, **given)

    monkeypatch.setattr(problem, "simulate", failing_for_the_best)
    onward = polished(chosen, printed, options)
    assert onward.history[first].objective == pytest.approx(least[1][0], rel=1e-3)


def test_pattern_without_equilibrium_is_said(
    short_tube: Skin,
    short_solver: EquilibriumSolver,
    result: DesignResult,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = full(short_tube, short_solver, beta=20.0)

    def fails(*_: object, **__: object) -> None:
        raise EquilibriumError("made to fail", result.final.equilibrium)

    monkeypatch.setattr(short_solver, "solve", fails)
    printed = as_printed(problem, result, PrintLimits())
    assert printed.evaluation is None
    assert printed.failure == "made to fail"
    assert printed.after.pieces


def test_borders_that_meet_end_no_design(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """The print is on the mesh of the design then, and says why it is not simulated."""
    problem = problem_of(
        alone, BendScene().updated(length=0.04, edge_length=5e-3, filter_radius=9e-3, levels=1)
    )
    made = optimize(problem, [Stage(1)], seed=1)

    def refused(self: ShapeDesign, regions: Any) -> Any:
        raise PatternError("borders of the print meet each other near (1.00, 2.00) mm")

    monkeypatch.setattr(ShapeDesign, "for_print", refused)
    printed = as_printed(problem, made)
    assert printed.evaluation is None
    assert "meet each other near (1.00, 2.00) mm" in printed.failure
    assert len(printed.cells) == len(problem.whole.pattern.panel)
    assert not printed.metrics


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
