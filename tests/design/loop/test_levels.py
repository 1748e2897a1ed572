"""Designs from coarse to fine."""

import weakref
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
import pytest
from helpers.designs import shape_design
from mpi4py import MPI

import toros_fem as tf
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.loop.levels import gathered, optimize_levels, refinements
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.cross_sections import label_cross_sections
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.skin.supports import symmetry_planes
from toros_fem.meshes import Pattern, bend, cylinder, mirrored, sew
from toros_fem.meshes.transfer import refine

LENGTH, EDGE, RADIUS = 0.06, 3.2e-3, 5e-3


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
    return shape_design(comm, pattern, **given)


def tubes(comm: MPI.Comm) -> Iterator[ShapeDesign]:
    """Two tubes that are coarser still."""
    return (tube(comm, factor) for factor in (3.0, 2.0))


@pytest.fixture(scope="module")
def coarse(alone: MPI.Comm) -> tf.DesignResult:
    return tf.optimize(tube(alone, 2.0), [Stage(12), Stage(8, constrained=True)], seed=1)


def test_first_solve_of_a_level_is_warm(alone: MPI.Comm, coarse: tf.DesignResult) -> None:
    """It takes fewer steps than a cold one, to the same equilibrium, and T changes little."""
    problem = tube(alone, 1.0)
    carried = gathered(coarse)
    assert carried.level == 1
    assert carried.pressures == coarse.pressures
    assert carried.history == coarse.history
    assert carried.initial is coarse.initial
    pattern, first = carried.initial
    assert np.array_equal(pattern.flat_points, coarse.problem.skin.pattern.flat_points)
    assert len(first) == len(pattern.panel)
    density, state = carried.on(problem)
    warm = problem.simulate(density, state, carried.pressures)
    cold = problem.simulate(density, None, carried.pressures)
    assert warm.objective == pytest.approx(cold.objective, rel=1e-6)
    assert warm.equilibrium.steps <= 0.7 * cold.equilibrium.steps
    assert warm.equilibrium.steps <= 10
    drawn = problem.simulate(problem.fields.start(1), None, carried.pressures)
    assert warm.objective < 0.5 * drawn.objective


def test_a_shape_out_of_the_stretch_bounds_is_left_out(alone: MPI.Comm) -> None:
    problem = tube(alone, 1.0)
    points = problem.skin.pattern.points
    state = problem.physics.state_at(1.01 * points)
    assert np.array_equal(state, 1.01 * points[problem.skin.owned_vertices])
    assert problem.physics.state_at(2.5 * points) is None


def test_levels_are_one_design(comm: MPI.Comm) -> None:
    """Rows of all levels follow each other; the coarse problem is freed by then."""
    problems, seen = [], []

    def made() -> Iterator[ShapeDesign]:
        for problem in tubes(comm):
            problems.append(weakref.ref(problem))
            yield problem
            del problem

    def watch(row: Iteration, _: object) -> None:
        seen.append((row.level, problems[0]() is None))

    coarse, fine = DesignOptions((Stage(2), Stage(1))), DesignOptions((Stage(2),))
    result = optimize_levels(made(), [coarse, fine], seed=1, callback=watch)
    assert seen == [(0, False)] * 5 + [(1, True)] * 3
    assert [row.level for row in result.history] == [level for level, _ in seen]
    assert [row.iteration for row in result.history] == [0, 1, 2, 2, 3, 3, 4, 5]
    assert [row.stage for row in result.history] == [0, 0, 0, 1, 1, 2, 2, 2]
    assert len(result.density) == len(result.problem.skin.owned_cells)
    assert result.seconds["next levels"] > 0


def test_each_level_is_finished(alone: MPI.Comm) -> None:
    """What `finish` returns is carried over."""
    seen: list[int] = []

    def finish(result: tf.DesignResult) -> tf.DesignResult:
        seen.append(result.history[-1].level)
        return tf.optimize(result.problem, [Stage(1)], after=result)

    options = [DesignOptions((Stage(1),))] * 2
    result = optimize_levels(tubes(alone), options, seed=1, finish=finish)
    assert seen == [0, 1]
    assert [row.level for row in result.history] == [0] * 4 + [1] * 4
    assert result.history[-1].iteration == 4


def test_refined_design(alone: MPI.Comm) -> None:
    """All that is given is carried to the refined pattern, at half the scale."""
    pattern = cylinder(alone, LENGTH, 0.02, 2 * EDGE)
    rng = np.random.default_rng(0)
    weights, start = rng.random(len(pattern.points)), rng.uniform(0.2, 0.8, len(pattern.panel))
    force = rng.standard_normal(pattern.points.shape)
    passive = np.where(rng.random(len(pattern.panel)) < 0.1, 0.25, np.nan)
    target = bend(np.radians(45), LENGTH, neutral=0.01)
    metric = Metric("height", "m", 0.0, lambda of, x: float(x[:, 2].max()))
    problem = design(
        alone, pattern, 2 * RADIUS, target=target(pattern.points).tolist(), start=start.tolist(),
        parts=[tf.ShapePart(cast(Any, weights.tolist()))], force=force.tolist(),
        passive=passive.tolist(), perimeter_weight=1e-5, perimeter_window=7e-3,
        length_scale=LengthScale(line_width=9e-3), metrics=(metric,),
        composite=tf.Composite(knit=tf.Knit(2.0, {"wall": 0.7, "base": 0.0, "tip": 0.1})),
    )  # fmt: skip
    finer, (same, fine) = refine(pattern), refinements(problem, 2)
    assert same is problem
    assert np.array_equal(fine.skin.pattern.flat_points, finer.pattern.flat_points)
    assert fine.fields.filter.radius == RADIUS
    assert isinstance(fine.terms[0].measure, Perimeter)
    assert fine.terms[0].measure.window == 3.5e-3
    coarse_widths, widths = problem.length_scale, fine.length_scale
    assert widths.solid_threshold == pytest.approx(coarse_widths.solid_threshold, rel=1e-12)
    assert fine.metrics == (metric,)
    assert fine.solver.model.composite == problem.solver.model.composite != tf.Composite()
    assert fine.physics.pressure_ranges == problem.physics.pressure_ranges
    # The target was given as positions: it is interpolated.
    assert np.allclose(fine.target, finer.at_vertices(target(pattern.points)), atol=1e-15)
    again = fine.fields.with_passive(np.full(len(fine.skin.owned_cells), np.nan))
    given = np.where(np.isin(pattern.panel, [1, 2]), 1.0, passive)
    expected = given[finer.cell][fine.skin.owned_cells]
    assert np.array_equal(again, expected, equal_nan=True)
    assert np.array_equal(fine.fields.centre, start[finer.cell])
    assert np.allclose(fine.physics.force.sum(axis=0), force.sum(axis=0), rtol=1e-12)
    assert not np.array_equal(fine.physics.force[: len(force)], force), "the force is spread"


def test_refined_design_goes_on(coarse: tf.DesignResult) -> None:
    """From each triangle to its quarters."""
    problem = coarse.problem
    assert isinstance(problem, ShapeDesign)
    fine = problem.refined()
    carried = gathered(coarse)
    density, state = carried.on(fine)
    finer = refine(problem.skin.pattern)
    whole = problem.skin.gather_cells(coarse.final.projected)
    assert np.abs(density - whole[finer.cell][fine.skin.owned_cells]).max() < 1e-12
    assert fine.simulate(density, state, carried.pressures).equilibrium.steps <= 10


@pytest.mark.parametrize("planes", [(), (1,), (1, 0)])
def test_refined_parts(alone: MPI.Comm, planes: tuple[int, ...]) -> None:
    """Weights and cross-sections of the whole skin go to that of the refined part."""
    pattern = cylinder(alone, LENGTH, 0.02, 3 * EDGE, planes=planes)
    whole, slope = mirrored(pattern, planes).pattern, np.array([3.0, -5.0, 7.0])
    labels = label_cross_sections(whole, whole.vertices_of("wall"), (0, 0, 1), 3)
    shape = tf.ShapePart(1 + whole.points @ slope, 2 + whole.points @ slope)
    rings = tf.CrossSections(labels, np.ones((4, 3)), np.ones(4))
    supports = tf.clamp(pattern, ["base"]) | symmetry_planes(pattern, planes)
    made = tf.Case(
        pattern, pattern.points, supports, 1.0, parts=[shape, rings], symmetry=planes,
        parts_of_whole=True,
    ).refined()  # fmt: skip
    fine = mirrored(made.pattern, planes).pattern
    finer_shape, finer_rings = made.parts
    assert isinstance(finer_shape, tf.ShapePart)
    assert isinstance(finer_rings, tf.CrossSections)
    np.testing.assert_allclose(finer_shape.weights, 1 + fine.points @ slope, atol=1e-12)
    np.testing.assert_allclose(finer_shape.relative, 2 + fine.points @ slope, atol=1e-12)
    wall = fine.vertices_of("wall")
    tip = fine.points[wall, 2] > LENGTH - 1e-9
    np.testing.assert_array_equal(finer_rings.labels[wall] == 3, tip)
    skin = sew(alone, made.pattern)
    assert made.objective(skin).forward(made.pattern.points[skin.owned_vertices]) < 1e-20
