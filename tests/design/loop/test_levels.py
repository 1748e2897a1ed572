"""Designs from coarse to fine."""

import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import toros_fem as tf
from toros_fem import errors
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.loop.levels import gathered, optimize_levels, refinements
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.measures.metrics import Metric
from toros_fem.meshes import Pattern, bend, cylinder
from toros_fem.meshes.refine import refine

LENGTH, EDGE, RADIUS = 0.06, 3.2e-3, 5e-3
CALM = MMAOptions(move=0.1)


def tube(comm: MPI.Comm, factor: float, **changes: Any) -> ShapeDesign:
    """A short tube with edges and filter radius `factor` times those of the finest."""
    pattern = cylinder(comm, LENGTH, 0.02, factor * EDGE)
    return design(comm, pattern, factor * RADIUS, **changes)


def design(comm: MPI.Comm, pattern: Pattern, radius: float, **changes: Any) -> ShapeDesign:
    given: dict[str, Any] = {
        "target": bend(np.radians(45), LENGTH, neutral=0.01),
        "supports": tf.clamp(pattern, ["base"]),
        "printed_panels": ["base", "tip"],
        "filter_radius": radius,
        "pressure": 5e3,
        "pressure_bounds": (1e3, 20e3),
        **changes,
    }
    return ShapeDesign(comm, pattern, **given)


def tubes(comm: MPI.Comm) -> Iterator[ShapeDesign]:
    """Two tubes that are coarser still."""
    return (tube(comm, factor) for factor in (3.0, 2.0))


@pytest.fixture(scope="module")
def coarse(comm: MPI.Comm) -> tf.DesignResult:
    stages = (Stage(12), Stage(8, constrained=True))
    return tf.optimize(tube(comm, 2.0), DesignOptions(stages), seed=1)


def test_first_solve_of_a_level_is_warm(comm: MPI.Comm, coarse: tf.DesignResult) -> None:
    """It takes fewer steps than a cold one, to the same equilibrium, and T changes little."""
    problem = tube(comm, 1.0)
    start = gathered(coarse).start(problem)
    assert start.level == 1
    assert start.pressures == coarse.pressures
    assert start.history == coarse.history
    assert start.initial is coarse.initial
    assert start.initial is not None
    first = coarse.problem.skin.pattern
    assert np.array_equal(start.initial.pattern.flat_points, first.flat_points)
    assert len(start.initial.density) == len(first.panel)
    warm = problem.simulate(start.density, start.state, start.pressures)
    cold = problem.simulate(start.density, None, start.pressures)
    assert warm.objective == pytest.approx(cold.objective, rel=1e-6)
    assert warm.equilibrium.steps <= 0.7 * cold.equilibrium.steps
    assert warm.equilibrium.steps <= 10
    drawn = problem.simulate(problem.start_density(1), None, start.pressures)
    assert warm.objective < 0.1 * drawn.objective


def test_printed_area_is_kept(comm: MPI.Comm, coarse: tf.DesignResult) -> None:
    problem = tube(comm, 1.0)
    start = gathered(coarse).start(problem)
    fraction = []
    for skin, density in (
        (coarse.problem.skin, coarse.final.projected),
        (problem.skin, start.density),
    ):
        wall, every = skin.pattern.cells_of("wall"), skin.gather_cells(density)
        fraction.append(np.average(every[wall], weights=skin.pattern.areas[wall]))
    assert fraction[1] == pytest.approx(fraction[0], rel=1e-12)


def test_a_shape_out_of_the_stretch_bounds_is_left_out(comm: MPI.Comm) -> None:
    problem = tube(comm, 1.0)
    points = problem.skin.pattern.points
    state = problem.state_at(1.01 * points)
    assert state is not None
    assert np.array_equal(state, 1.01 * points[problem.skin.owned_vertices])
    assert problem.state_at(2.5 * points) is None


@pytest.mark.slow
def test_fine_steps_reach_what_the_coarse_design_had(comm: MPI.Comm) -> None:
    """With half its widths, and the constraints on them; the coarse problem is freed by then."""
    coarse_steps = (Stage(20), Stage(15, constrained=True))
    steps_there = 16
    fine = DesignOptions((Stage(steps_there, constrained=True),), pressure_move=0.02, mma=CALM)
    problems, seen = [], []

    def made() -> Iterator[ShapeDesign]:
        for factor in (2.0, 1.0):
            problem = tube(comm, factor)
            problems.append(weakref.ref(problem))
            yield problem
            del problem

    def watch(row: Iteration, _: object) -> None:
        seen.append((row.level, problems[0]() is None))

    result = optimize_levels(made(), [DesignOptions(coarse_steps), fine], seed=1, callback=watch)
    rows = 1 + steps_there
    before, first = result.history[-rows - 1].objective, result.history[-rows].objective
    assert result.final.objective < 0.4 * first
    assert result.final.objective < 1.1 * before
    limits = result.problem.length_scale
    assert limits is not None
    assert result.final.length_scale is not None
    assert np.all(result.final.length_scale <= limits.epsilon)
    assert seen == [(0, False)] * (len(seen) - rows) + [(1, True)] * rows
    assert [row.level for row in result.history] == [level for level, _ in seen]
    steps = [row.iteration for row in result.history]
    assert steps == sorted(steps)
    assert steps[-1] == sum(stage.iterations for stage in coarse_steps) + steps_there
    assert [row.stage for row in result.history[-rows:]] == [2] * rows
    assert len(result.density) == len(result.problem.skin.owned_cells)
    assert result.seconds["next levels"] > 0


def test_each_level_is_finished(comm: MPI.Comm) -> None:
    """What `finish` returns is carried over."""
    seen: list[int] = []

    def finish(result: tf.DesignResult) -> tf.DesignResult:
        seen.append(result.history[-1].level)
        return tf.optimize(result.problem, [Stage(1)], after=result)

    options = [DesignOptions((Stage(1),))] * 2
    result = optimize_levels(tubes(comm), options, seed=1, finish=finish)
    assert seen == [0, 1]
    assert [row.level for row in result.history] == [0] * 4 + [1] * 4
    assert result.history[-1].iteration == 4


def test_levels_that_do_not_fit(comm: MPI.Comm) -> None:
    rules = DesignOptions((Stage(1),))
    with pytest.raises(errors.ParameterError, match="options is empty"):
        optimize_levels(tubes(comm), [])
    with pytest.raises(errors.ParameterError, match="there are 2 problems for 3 levels"):
        optimize_levels(tubes(comm), [rules] * 3, seed=1)
    with pytest.raises(errors.ParameterError, match="levels = 0 must"):
        next(refinements(tube(comm, 2.0), 0))


def test_refined_design(comm: MPI.Comm) -> None:
    """All that is given is carried to the refined pattern, at half the scale."""
    pattern = cylinder(comm, LENGTH, 0.02, 2 * EDGE)
    rng = np.random.default_rng(0)
    weights, start = rng.random(len(pattern.points)), rng.uniform(0.2, 0.8, len(pattern.panel))
    force = rng.standard_normal(pattern.points.shape)
    passive = np.where(rng.random(len(pattern.panel)) < 0.1, 0.25, np.nan)
    target = bend(np.radians(45), LENGTH, neutral=0.01)
    metric = Metric("height", "m", 0.0, lambda of, x: float(x[:, 2].max()))
    problem = design(
        comm, pattern, 2 * RADIUS, target=target(pattern.points), weights=weights, start=start,
        force=force, passive=passive, perimeter_weight=1e-5, perimeter_window=7e-3,
        length_scale=LengthScale(line_width=9e-3), metrics=(metric,),
    )  # fmt: skip
    finer, (same, fine) = refine(pattern), refinements(problem, 2)
    assert same is problem
    assert np.array_equal(fine.skin.pattern.flat_points, finer.pattern.flat_points)
    assert fine.filter.radius == RADIUS
    assert fine.perimeter is not None
    assert fine.perimeter.window == 3.5e-3
    coarse_widths, widths = problem.length_scale, fine.length_scale
    assert coarse_widths is not None
    assert widths is not None
    assert widths.solid_threshold == pytest.approx(coarse_widths.solid_threshold, rel=1e-12)
    assert fine.metrics == (metric,)
    assert fine.pressure_ranges == problem.pressure_ranges
    # The target was given as positions: it is interpolated.
    assert fine.target is not None
    assert np.allclose(fine.target, finer.at_vertices(target(pattern.points)), atol=1e-15)
    again = fine.with_passive(np.full(len(fine.skin.owned_cells), np.nan))
    given = np.where(np.isin(pattern.panel, [1, 2]), 1.0, passive)
    expected = given[finer.cell][fine.skin.owned_cells]
    assert np.array_equal(again, expected, equal_nan=True)
    assert fine.start is not None
    assert np.array_equal(fine.start, start[finer.cell])
    assert fine.force is not None
    assert np.allclose(fine.force.sum(axis=0), force.sum(axis=0), rtol=1e-12)
    assert not np.array_equal(fine.force[: len(force)], force), "the force is spread"


def test_a_target_map_is_evaluated_again(comm: MPI.Comm) -> None:
    target = bend(np.radians(45), LENGTH, neutral=0.01)
    fine = tube(comm, 2.0).refined()
    assert fine.target is not None
    assert np.array_equal(fine.target, target(fine.skin.pattern.points))


def test_refined_design_goes_on(comm: MPI.Comm, coarse: tf.DesignResult) -> None:
    """From each triangle to its quarters."""
    problem = coarse.problem
    assert isinstance(problem, ShapeDesign)
    fine = problem.refined()
    start = gathered(coarse).start(fine)
    finer = refine(problem.skin.pattern)
    whole = problem.skin.gather_cells(coarse.final.projected)
    assert np.abs(start.density - whole[finer.cell][fine.skin.owned_cells]).max() < 1e-12
    assert fine.simulate(start.density, start.state, start.pressures).equilibrium.steps <= 10
