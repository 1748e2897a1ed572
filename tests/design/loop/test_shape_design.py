"""A design problem from a pattern, a target and numbers."""

import numpy as np
import pytest
from helpers.designs import shape_design
from mpi4py import MPI

import toros_fem as tf
from toros_fem import errors
from toros_fem.base.validation import Floats
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem, carried_along
from toros_fem.measures.metrics import bend_angle, shortening
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, bend, cylinder
from toros_fem.meshes.panels import with_flat_points
from toros_fem.meshes.transfer import refine

LENGTH, DIAMETER, RADIUS = 0.06, 0.02, 7e-3


def test_shape_derivatives_are_those_of_moved_meshes(comm: MPI.Comm) -> None:
    """Lines of a tube move on its flat panel, across the seam too; each end is solved anew."""
    tube = cylinder(comm, 0.06, 0.02, 4.5e-3)
    design = shape_design(
        comm,
        tube,
        target=bend(np.radians(60), 0.06, neutral=0.01),
        supports=clamp(tube, ["base"]),
        pressure=5e3,
        printed_panels=["base", "tip"],
        filter_radius=9e-3,
        length_scale=None,
    )
    density = np.where(tube.centroids[:, 0] % 15e-3 < 6e-3, 1.0, 0.0)

    def simulated(problem: ShapeProblem) -> Evaluation[Equilibrium]:
        return problem.simulate_binary(density[problem.skin.owned_cells])

    def values(positions: Floats) -> Floats:
        means = [positions[part].mean(axis=0) for part in (tip, middle)]
        return np.array([bend_angle(tube, positions, sections=6), *np.concatenate(means)])

    middle = np.abs(tube.points[:, 2] - 0.02) < 6e-3
    tip, wall = tube.vertices_of("tip"), tube.panel_of_point == tube.panel_index("wall")
    inside = np.ones(len(tube.points), dtype=bool)
    for name in ("base", "tip"):
        inside[tube.vertices_of(name)] = False
    z, way = tube.points[:, 2] / 0.06, np.random.default_rng(3).normal(size=(len(tube.points), 2))
    smooth = np.stack([np.sin(np.pi * z), np.sin(2 * np.pi * z)], axis=1)
    moves = [
        2e-3 * (inside[:, None] * each)[tube.sewn] * wall[:, None] for each in (smooth, way / 10)
    ]
    base = simulated(design)
    found = design.shape_derivatives(base, moves, values)
    step = 0.02
    for move, rates in zip(moves, found.T, strict=True):
        ends = []
        for sign in (1, -1):
            moved = design.on(with_flat_points(tube, tube.flat_points + sign * step * move))
            here = simulated(moved).equilibrium.positions
            here = moved.skin.gather_vertices(here)
            ends.append(values(here - sign * step * carried_along(moved.skin.pattern, here, move)))
        expected = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(rates - expected).max() < 5e-3 * np.abs(expected).max()
        assert np.abs(expected).max() > 1e-4


@pytest.fixture(scope="module")
def pattern(alone: MPI.Comm) -> Pattern:
    return tf.meshes.cylinder(alone, LENGTH, DIAMETER, 4.5e-3)


def design(comm: MPI.Comm, pattern: Pattern, **changes: object) -> tf.ShapeDesign:
    given: dict[str, object] = {
        "target": tf.meshes.bend(np.radians(30), LENGTH, neutral=0.01),
        "supports": tf.clamp(pattern, ["base"]),
        "pressure": 4e3,
        "printed_panels": ["base", "tip"],
        "filter_radius": RADIUS,
        **changes,
    }
    return shape_design(comm, pattern, **given)


def test_printed_panels_and_passive_densities(alone: MPI.Comm, pattern: Pattern) -> None:
    """Panels come on top of the densities that are prescribed triangle by triangle."""
    passive = np.full(len(pattern.triangles), np.nan)
    passive[pattern.cells_of("wall")[:5]] = 0.25
    problem = design(alone, pattern, passive=passive)
    every = problem.skin.gather_cells(
        problem.fields.with_passive(np.full(len(problem.designed), 0.5))
    )
    for panel, density in (("base", 1.0), ("tip", 1.0)):
        np.testing.assert_array_equal(every[pattern.cells_of(panel)], density)
    np.testing.assert_array_equal(every[pattern.cells_of("wall")[:5]], 0.25)
    np.testing.assert_array_equal(every[pattern.cells_of("wall")[5:]], 0.5)


def test_own_start_and_metrics(alone: MPI.Comm, pattern: Pattern) -> None:
    """The history holds the metrics; without any, the distance from the target in mm."""
    start = np.where(pattern.centroids[:, 0] > 0.03, 0.7, 0.3)
    problem = design(alone, pattern, start=start)
    drawn = problem.skin.gather_cells(problem.fields.start(seed=4))
    assert np.abs(drawn - start).max() <= 0.1
    assert np.abs(drawn - start).min() < 0.01
    result = tf.optimize(problem, [tf.Stage(1)], seed=4)
    assert result.problem is problem
    wanted = problem.metrics_of(result.final.equilibrium)
    assert set(wanted) == {"distance_mm"}
    assert result.history[-1].metrics == wanted
    # T of this objective is half the square of the distance over the skin's size.
    size = 1e3 * pattern.size
    assert wanted["distance_mm"] == pytest.approx(size * np.sqrt(2 * result.history[-1].shape))
    own = tf.Metric("length", "percent", 100.0, lambda of, x: 100 * (1 - shortening(of, x)))
    other = design(alone, pattern, metrics=[own])
    assert set(tf.optimize(other, [tf.Stage(1)]).history[0].metrics) == {"length_percent"}


def test_the_default_metric_on_another_mesh(alone: MPI.Comm, pattern: Pattern) -> None:
    """A target given as a map is known there too; one given by vertex is not."""
    bend = tf.meshes.bend(np.radians(30), LENGTH, neutral=0.01)
    finer = refine(pattern).pattern
    (metric,) = design(alone, pattern, target=bend).metrics
    assert metric.value(finer, bend(finer.points)) == pytest.approx(0, abs=1e-9)
    (by_vertex,) = design(alone, pattern, target=bend(pattern.points)).metrics
    with pytest.raises(errors.ParameterError, match="a function of the assembled positions"):
        by_vertex.value(finer, finer.points)


def test_a_design_towards_another_target(alone: MPI.Comm, pattern: Pattern) -> None:
    """On a pattern that has moved too; a target that is a map is evaluated there."""
    problem, other = design(alone, pattern), design(alone, pattern, target=lambda x: 1.02 * x)
    asking, at = problem.towards(other.case), problem.skin.owned_vertices
    expected = other.objective.forward(1.1 * pattern.points[at])
    for found in (asking, asking.on(pattern)):
        assert found.objective.forward(1.1 * pattern.points[at]) == pytest.approx(expected)
    assert problem.objective.forward(1.1 * pattern.points[at]) != pytest.approx(expected)


def test_changes_go_on_or_are_refused_on_another_mesh(alone: MPI.Comm, pattern: Pattern) -> None:
    problem = design(alone, pattern)
    assert problem.changed(metrics=()).on(pattern).metrics == ()
    assert [m.key for m in problem.on(pattern).metrics] == [m.key for m in problem.metrics]
    other = problem.changed(objective=design(alone, pattern).objective)
    with pytest.raises(errors.ParameterError, match=r"towards\(case\)"):
        other.on(pattern)
