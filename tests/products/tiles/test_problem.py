"""The design problem of a tile, and its print in the endless sheet."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import shapely
from helpers.tiles import (
    CONTRAST,
    DIRECTIONS,
    EDGES,
    RADIUS,
    SIDE,
    SMALL,
    TARGET,
    profile_solver,
    small_case,
    tile_of,
)
from kit.pairs import tile_problem as tile_problem_of
from mpi4py import MPI
from shapely.affinity import affine_transform, translate
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from toros_fem import errors
from toros_fem.design.density.filters import cone_filter, group_mean
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.making.cleaning import CleanedRegions, clean
from toros_fem.making.printability import PrintLimits, printed_cells
from toros_fem.meshes import Tile, tile
from toros_fem.products.tiles.problem import (
    RepeatedTile,
    TilePrintability,
    TileProblem,
    island_areas,
    repeated,
    tile_printability,
    tile_problem,
)
from toros_fem.products.tiles.stiffness_profile import ProfileObjective, ProfileTarget

SIZE = 0.01


def start_of(problem: TileProblem) -> np.ndarray:
    """Return a symmetric density with noise."""
    x, y = (2 * np.pi * problem.skin.pattern.centroids / SIDE).T
    noise = np.random.default_rng(2).uniform(-1, 1, len(x))
    every = 0.5 + 0.3 * np.cos(x) * np.cos(y) + 0.15 * noise
    return np.asarray(every[problem.skin.owned_cells])


def make_problem(
    batched: bool,
    objective: ProfileObjective,
    symmetry: str = "tetragonal",
    angles: np.ndarray = DIRECTIONS,
    beta: float = 4.0,
) -> TileProblem:
    solver, found = profile_solver(batched, angles), tile_of(EDGES)
    skin = solver.tile.skin
    inner = cone_filter(skin, RADIUS, found.lattice)
    symmetric = inner.after(group_mean(skin, found.symmetry_maps(symmetry)))
    fields = DensityFields(skin, symmetric, Projection(beta))
    return TileProblem(fields, solver, objective)


def test_ranks_that_share_directions_have_equal_gradients(comm: MPI.Comm) -> None:
    """To the last digit, since each has an MMA of its own; contracts/test_pairs has the rest."""
    problem = tile_problem_of(TARGET, "tetragonal", comm, batched=True)
    _, slopes = problem.evaluate(start_of(problem))
    rows = slopes.residuals.gradients
    for theirs, others in comm.allgather((slopes.gradient, rows)):
        assert (theirs == slopes.gradient).all()
        assert np.array_equal(others, rows)


THREE = np.array([0.0, np.pi / 8, np.pi / 4])


def test_objective_of_zero() -> None:
    """T = 0 cannot be scaled: at the start, and on the way."""
    problem = make_problem(True, ProfileTarget(np.full(3, 1e3)), angles=THREE)
    start = np.round(start_of(problem), 3)  # as the loop rounds its variables
    there = problem.simulate(start).equilibrium
    reached = problem.changed(objective=ProfileTarget(there.stiffness))
    result = optimize(reached, DesignOptions((Stage(2),)), start=start)
    assert result.final.objective < 1e-20
    assert result.density == pytest.approx(start, abs=1e-6)
    near = problem.changed(objective=ProfileTarget(1.01 * there.stiffness))
    result = optimize(near, DesignOptions((Stage(12),), x_tol=1e-9), start=start)
    assert result.final.objective < 1e-12
    assert np.isfinite(result.density).all()


def test_metric_of_a_target() -> None:
    """The largest deviation from the target is a metric of the history, whatever the objective."""
    target = ProfileTarget(np.array([900.0, 1200.0, 2400.0]))
    problem = make_problem(True, target, angles=THREE).changed(goal=target)
    other = problem.changed(objective=ProfileTarget(np.full(3, 1e3)))
    result = optimize(other, [Stage(1)], start=start_of(problem))
    stiffness = result.final.equilibrium.stiffness
    worst = np.abs(stiffness / [900.0, 1200.0, 2400.0] - 1).max()
    assert result.history[-1].metrics == {"worst_percent": pytest.approx(100 * worst, rel=1e-12)}
    assert make_problem(True, CONTRAST).metrics_of(result.final.equilibrium) == {}


def test_ranks_that_share_directions_stop_together(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slowest rank decides on the time limit; here the last one's clock jumps ahead."""
    problem, clock, jump = make_problem(True, TARGET), time.perf_counter, [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + jump[0])

    def late(row: Iteration, _: object) -> None:
        if row.iteration == 1 and comm.rank == comm.size - 1:
            jump[0] = 1e6

    options = DesignOptions((Stage(1),), seconds=1e5)
    found = optimize(problem, options, start=start_of(problem), callback=late)
    assert comm.allgather(found.reason) == comm.size * ["100000 s have passed."]


def test_parts_of_the_problem(alone: MPI.Comm) -> None:
    """Only requested parts are built, with the numbers of the configuration."""
    case = small_case(alone)
    config = SMALL.updated(constrained=False, beta=7.0, eta=0.4)
    plain = tile_problem(case, config)
    assert not plain.terms
    assert plain.length_scale is None
    assert (plain.fields.projection.beta, plain.fields.projection.eta) == (7.0, 0.4)
    assert plain.fields.filter.radius == 2e-3
    assert plain.fields.filter.name == "cone"
    assert plain.goal is case.objective
    assert plain.physics.strain == 0.1
    assert plain.physics.angles == pytest.approx(np.radians([0, 15, 30, 45]))
    whole = tile_problem(
        case, SMALL.updated(filter="helmholtz", perimeter_weight=1e-3, line_width=2.2e-3)
    )
    (term,) = whole.terms
    assert term.price == 1e-3 / case.tile.pattern.size
    assert whole.fields.filter.name == "helmholtz"
    same = tile_problem(case, SMALL.updated(filter="helmholtz"))
    # A wider line has a higher threshold; the one for gaps stays.
    assert whole.length_scale.solid_threshold > same.length_scale.solid_threshold
    assert whole.length_scale.void_threshold == same.length_scale.void_threshold


def test_radius_of_a_small_tile(alone: MPI.Comm) -> None:
    with pytest.raises(errors.ParameterError, match="than twice the radius"):
        tile_problem(small_case(alone), SMALL.updated(filter_radius=6e-3))


def measured(patch: Tile, region: BaseGeometry) -> TilePrintability:
    """Return the printability of a region with limits of 0.6 mm."""
    return tile_printability(patch, region, printed_cells(patch.pattern, [region]), PrintLimits())


def test_repeated_regions_are_joined(alone: MPI.Comm) -> None:
    patch = tile(alone, (0.02, 0.01), 2e-3)
    band = shapely.box(0.0, 0.004, 0.02, 0.006)
    region = repeated(band, patch, 3, 2)
    assert region.area == pytest.approx(6 * band.area, rel=1e-6)
    assert len(shapely.get_parts(region)) == 2
    assert region.bounds == pytest.approx((0.0, 0.004, 0.06, 0.016))


def test_widths_across_the_border(alone: MPI.Comm) -> None:
    """A line on the border is as wide as its halves together; a gap likewise."""
    patch = tile(alone, 0.01, 0.1e-3)
    sides = [shapely.box(0, y, 0.01, y + h) for y, h in ((0, 0.2e-3), (9.7e-3, 0.3e-3))]
    line = shapely.union_all(sides)
    found = measured(patch, line)
    assert found.lines.smallest.width == pytest.approx(0.5e-3, abs=2e-6)
    assert found.gaps.smallest.width == pytest.approx(9.5e-3, abs=2e-6)
    assert found.lines.narrow
    assert not found.gaps.narrow
    assert not found.clean
    inverse = measured(patch, shapely.box(0, 0, 0.01, 0.01).difference(line))
    assert inverse.gaps.smallest.width == pytest.approx(0.5e-3, abs=2e-6)
    assert inverse.gaps.narrow
    assert not inverse.lines.narrow
    # A single tile cuts the bar's ends to tips; in the endless sheet it has none.
    bar = shapely.LineString([(-0.01, -0.01), (0.02, 0.02)]).buffer(0.7e-3)
    copies = [translate(bar, *shift) for shift in ((0, 0), (0.01, 0), (0, 0.01))]
    box = shapely.box(0, 0, 0.01, 0.01)
    diagonal = measured(patch, shapely.intersection(shapely.union_all(copies), box))
    assert diagonal.clean
    assert diagonal.lines.smallest.width == pytest.approx(1.4e-3, abs=2e-6)
    assert diagonal.summary() == {
        "islands": 0, "island_areas_mm2": [], "narrow_places": 0, "tight_places": 0,
        "smallest_width_mm": 1e3 * diagonal.lines.smallest.width,
        "smallest_gap_mm": pytest.approx(10 / np.sqrt(2) - 1.4, abs=2e-3),
    }  # fmt: skip


def test_an_island_is_a_flaw(alone: MPI.Comm) -> None:
    patch = tile(alone, 0.01, 0.25e-3)
    band = shapely.box(0, 0.001, 0.01, 0.003)
    assert measured(patch, band).clean
    spotted = measured(patch, band | shapely.Point(0.005, 0.0065).buffer(0.001))
    assert not spotted.clean
    assert spotted.summary()["islands"] == 1
    assert spotted.summary()["island_areas_mm2"] == pytest.approx([np.pi], rel=0.05)
    nothing = measured(patch, shapely.Polygon())
    assert nothing.summary()["smallest_width_mm"] is None


def test_islands(alone: MPI.Comm) -> None:
    """A line through the border is connected; a spot is an island, also across the border."""
    patch = tile(alone, 0.01, 1e-3)
    x, y = 1e3 * patch.pattern.centroids.T
    line = np.abs(y - 5) < 1
    spot = np.hypot(x - 5, y - 9) < 0.9
    corner = np.hypot((x + 5) % 10 - 5, (y + 5) % 10 - 5) < 2
    assert len(island_areas(patch, line)) == 0
    assert len(island_areas(patch, np.abs((x + y) % 10 - 5) < 1)) == 0
    areas = patch.pattern.areas
    assert island_areas(patch, line | spot) == pytest.approx([areas[spot].sum()])
    assert island_areas(patch, corner) == pytest.approx([areas[corner].sum()])
    assert island_areas(patch, corner | line | spot) == pytest.approx(
        [areas[corner].sum(), areas[spot].sum()]
    )
    assert len(island_areas(patch, np.ones(len(x), dtype=bool))) == 0
    assert len(island_areas(patch, np.zeros(len(x), dtype=bool))) == 0


@pytest.fixture(scope="module")
def sheet_tile(alone: MPI.Comm) -> Tile:
    return tile(alone, SIZE, 0.2e-3)


def cleaned(
    patch: Tile, region: BaseGeometry, island_area: float = 1e-6, symmetry: str = "none"
) -> CleanedRegions:
    """The print of a region; checked to keep all limits among its equals."""
    made = clean(RepeatedTile(patch, symmetry), [region], PrintLimits(), island_area)
    (one,) = made.regions
    found = tile_printability(patch, one, printed_cells(patch.pattern, [one]), PrintLimits())
    assert found.clean
    return made


def test_lines_on_the_border_count_with_both_halves(sheet_tile: Tile) -> None:
    """One of 0.8 mm stays, one of 0.4 mm gets the least width, although halves are thinner."""
    for half, width in ((0.4e-3, 0.8e-3), (0.2e-3, 0.609e-3)):
        line = box(0, 0, SIZE, half) | box(0, SIZE - half, SIZE, SIZE)
        made = cleaned(sheet_tile, line)
        assert made.regions[0].area == pytest.approx(width * SIZE, rel=0.01)


def test_gaps_across_the_border(sheet_tile: Tile) -> None:
    plate = box(0, 0.2e-3, SIZE, 8e-3)
    made = cleaned(sheet_tile, plate | box(0, 8.4e-3, SIZE, SIZE))
    heights = sorted(
        p.area / SIZE for p in shapely.get_parts(repeated(made.regions[0], sheet_tile, 1, 3))
    )
    assert made.regions[0].area < plate.area + 1.6e-3 * SIZE
    assert heights[-1] == pytest.approx(8e-3 + 1.4e-3, rel=0.02)


def test_islands_are_removed_or_joined_everywhere(sheet_tile: Tile) -> None:
    line, island = box(0, 1e-3, SIZE, 2e-3), Point(0.01, 6e-3).buffer(1e-3)
    here = (island | Point(0, 6e-3).buffer(1e-3)) & box(0, 0, SIZE, SIZE)
    gone = cleaned(sheet_tile, line | here, island_area=1e-5)
    assert len(gone.dropped) == 1
    assert gone.regions[0].area == pytest.approx(line.area, rel=1e-2)
    joined = cleaned(sheet_tile, line | here)
    assert [len(joined.dropped), len(joined.bridged)] == [0, 1]
    assert joined.regions[0].area == pytest.approx((line | here).area + 1.2e-3 * 3e-3, rel=0.03)


@pytest.mark.parametrize(
    ("side", "place"),
    [
        (8.0, (0.5, 0.0)),
        (9.0, (0.5, 0.6)),
        (9.5, (0.0, 0.6)),
        (10.0, (0.5, 0.0)),
        (11.0, (0.0, 0.0)),
        (12.5, (0.5, 0.6)),
    ],
)
def test_an_island_counts_once_wherever_it_lies(
    alone: MPI.Comm, side: float, place: tuple[float, float]
) -> None:
    """Of a spot on the tile's border each copy is removed, or joined by one line."""
    size = side * 1e-3
    patch = tile(alone, size, size / 20)
    line, (x, y) = box(0, 0.25 * size, size, 0.25 * size + 1e-3), np.multiply(place, size)
    spots = [Point(x + i * size, y + j * size).buffer(0.8e-3) for i in (0, 1) for j in (0, 1)]
    region = shapely.union_all([line, *spots]) & box(0, 0, size, size)
    gone = cleaned(patch, region, island_area=math.inf)
    assert [len(gone.dropped), len(gone.bridged)] == [1, 0]
    assert gone.regions[0].area == pytest.approx(line.area, rel=1e-2)
    joined = cleaned(patch, region, island_area=0.0)
    assert [len(joined.dropped), len(joined.bridged)] == [0, 1]


def test_gaps_between_a_bridge_and_its_image_are_closed(sheet_tile: Tile) -> None:
    """Bridges of 1.2 mm from two teeth on either side of a mirror would leave 0.4 mm."""
    quarter = box(0, 0, 5e-3, 1e-3) | box(3.9e-3, 0, 4.5e-3, 3e-3) | box(3e-3, 4.5e-3, 5e-3, 5e-3)
    half = quarter | affine_transform(quarter, [-1, 0, 0, 1, SIZE, 0])
    region = half | affine_transform(half, [1, 0, 0, -1, 0, SIZE])
    assert cleaned(sheet_tile, region, 0.0, "orthotropic").bridged


def test_smooth_contours_go_on_across_the_border(sheet_tile: Tile) -> None:
    steps = [box(x, 4e-3, x + 0.5e-3, 6e-3 + 0.2e-3 * (k % 2))
             for k, x in enumerate(0.5e-3 * i for i in range(20))]  # fmt: skip
    region = shapely.union_all(steps)
    made = clean(RepeatedTile(sheet_tile, "none"), [region], PrintLimits(), 0.0, 1e-3)
    left, right = (made.regions[0] & box(x, 0, x + 1e-4, SIZE) for x in (0, SIZE - 1e-4))
    assert left.bounds[3] == pytest.approx(right.bounds[3], abs=1e-5)
    assert left.bounds[3] == pytest.approx(6.1e-3, abs=2e-5)


def test_tetragonal_prints_stay_so(sheet_tile: Tile) -> None:
    """A net whose islands and thin lines are cleaned alike in all images."""
    net = box(0, 0, SIZE, 0.7e-3) | box(0, 9.3e-3, SIZE, SIZE) | box(0, 0, 0.7e-3, SIZE)
    net |= box(9.3e-3, 0, SIZE, SIZE)
    spots = [Point(x, y).buffer(0.9e-3) for x in (3e-3, 7e-3) for y in (3.2e-3, 6.8e-3)]
    spots += [Point(y, x).buffer(0.9e-3) for x in (3e-3, 7e-3) for y in (3.2e-3, 6.8e-3)]
    made = cleaned(sheet_tile, shapely.union_all([net, *spots]), 0.0, "tetragonal")
    one = made.regions[0]
    assert made.bridged
    for turn in ([0, -1, 1, 0, SIZE, 0], [-1, 0, 0, 1, SIZE, 0], [0, 1, 1, 0, 0, 0]):
        image = affine_transform(one, turn)
        assert image.symmetric_difference(one).area < 1e-6 * one.area
