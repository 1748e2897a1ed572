"""A design problem from a pattern, a target and numbers."""

import numpy as np
import pytest
from mpi4py import MPI

import toros_fem as tf
from toros_fem import errors
from toros_fem.meshes import Pattern

LENGTH, DIAMETER, RADIUS = 0.06, 0.02, 7e-3


@pytest.fixture(scope="module")
def pattern(comm: MPI.Comm) -> Pattern:
    return tf.meshes.cylinder(comm, LENGTH, DIAMETER, 4.5e-3)


def design(comm: MPI.Comm, pattern: Pattern, **changes: object) -> tf.ShapeDesign:
    given: dict[str, object] = {
        "target": tf.meshes.bend(np.radians(30), LENGTH, neutral=0.01),
        "supports": tf.clamp(pattern, ["base"]),
        "pressure": 4e3,
        "printed_panels": ["base", "tip"],
        "filter_radius": RADIUS,
        **changes,
    }
    return tf.ShapeDesign(comm, pattern, **given)  # type: ignore[arg-type]


def test_only_what_is_given_is_built(comm: MPI.Comm, pattern: Pattern) -> None:
    plain = design(comm, pattern, length_scale=None)
    parts = (plain.perimeter, plain.perimeter_weight, plain.length_scale, plain.whole)
    assert parts == (None,) * 4
    assert plain.pressure_ranges == (None,)
    with_all = design(
        comm, pattern, perimeter_weight=1e-5, perimeter_window=8e-3, pressure_bounds=(1e3, 9e3)
    )
    assert with_all.perimeter is not None
    assert with_all.perimeter.window == 8e-3
    assert with_all.length_scale is not None
    assert with_all.pressure_ranges == ((1e3, 9e3),)


def test_printed_panels_and_passive_densities(comm: MPI.Comm, pattern: Pattern) -> None:
    """Panels come on top of the densities that are prescribed triangle by triangle."""
    passive = np.full(len(pattern.triangles), np.nan)
    passive[pattern.cells_of("wall")[:5]] = 0.25
    problem = design(comm, pattern, passive=passive)
    every = problem.skin.gather_cells(problem.with_passive(np.full(len(problem.designed), 0.5)))
    for panel, density in (("base", 1.0), ("tip", 1.0)):
        np.testing.assert_array_equal(every[pattern.cells_of(panel)], density)
    np.testing.assert_array_equal(every[pattern.cells_of("wall")[:5]], 0.25)
    np.testing.assert_array_equal(every[pattern.cells_of("wall")[5:]], 0.5)


def test_own_start_and_metrics(comm: MPI.Comm, pattern: Pattern) -> None:
    """The history holds the metrics; without any, the distance from the target in mm."""
    start = np.where(pattern.centroids[:, 0] > 0.03, 0.7, 0.3)
    problem = design(comm, pattern, start=start)
    drawn = problem.skin.gather_cells(problem.start_density(seed=4))
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
    own = tf.Metric("length", "percent", 100.0, lambda of, x: 100 * (1 - tf.shortening(of, x)))
    other = design(comm, pattern, metrics=[own])
    assert set(tf.optimize(other, [tf.Stage(1)]).history[0].metrics) == {"length_percent"}


def test_error_of_the_default_metric(comm: MPI.Comm, pattern: Pattern) -> None:
    """A target given as a map is known on the refined mesh too; one given by vertex is not."""
    bend = tf.meshes.bend(np.radians(30), LENGTH, neutral=0.01)
    problem = design(comm, pattern, target=bend)
    found = problem.simulate(problem.start_density(seed=1))
    (metric,) = problem.metrics
    given = problem.solver, found.projected, found.equilibrium
    (estimate,) = tf.estimate_error(*given, [metric.measure])
    assert estimate.value == problem.metrics_of(found.equilibrium)["distance_mm"]
    assert estimate.refined == pytest.approx(estimate.value, rel=0.05)
    assert estimate.refined != estimate.value
    by_vertex = design(comm, pattern, target=bend(pattern.points))
    with pytest.raises(errors.TargetError, match="a function of the assembled positions"):
        tf.estimate_error(*given, [by_vertex.metrics[0].measure])


def test_seed_decides_the_start(comm: MPI.Comm, pattern: Pattern) -> None:
    problem = design(comm, pattern)
    one, same, other = (
        tf.optimize(problem, [tf.Stage(1)], seed=seed).history[0].objective for seed in (1, 1, 2)
    )
    assert one == same != other


def test_more_is_a_continuation(comm: MPI.Comm, pattern: Pattern) -> None:
    """Without a start of its own a run continues from the result that it is given."""
    problem = design(comm, pattern)
    first = tf.optimize(problem, [tf.Stage(2)])
    more = tf.optimize(problem, [tf.Stage(1)], after=first)
    assert more.history[3].objective == pytest.approx(first.history[-1].objective, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"passive": np.zeros(3)}, errors.DensityError, r"passive has shape \(3,\)"),
        ({"start": np.zeros(3)}, errors.DensityError, r"start has shape \(3,\)"),
        ({"printed_panels": ["cap"]}, errors.PanelError, "cap"),
        (
            {"printed_panels": ["base", "tip", "wall"]},
            errors.DensityError,
            "none is designed. Set NaN",
        ),
        ({"target": np.zeros((4, 3))}, errors.TargetError, r"target has shape \(4, 3\)"),
        ({"perimeter_weight": -1.0}, errors.ParameterError, "perimeter_weight = -1"),
        ({"filter": "gauss"}, errors.ParameterError, "filter = 'gauss'"),
        ({"pressure_bounds": (5e3, 9e3)}, errors.ParameterError, "pressure = 4000"),
        ({"pressure": -1.0}, errors.ParameterError, "pressure = -1"),
        ({"printed_panels": "tip"}, errors.ParameterError, r"a list of names: \['tip'\]"),
    ],
)
def test_bad_arguments(
    comm: MPI.Comm,
    pattern: Pattern,
    changes: dict[str, object],
    error: type[Exception],
    message: str,
) -> None:
    with pytest.raises(error, match=message):
        design(comm, pattern, **changes)


def test_start_leaves_room_for_noise(comm: MPI.Comm, pattern: Pattern) -> None:
    start = np.linspace(0.0, 0.5, len(pattern.triangles))
    with pytest.raises(errors.DensityError, match="start holds densities from 0 to 0.5"):
        design(comm, pattern, start=start)


def test_a_lone_stage_or_panel_is_refused(comm: MPI.Comm, pattern: Pattern) -> None:
    with pytest.raises(errors.ParameterError, match="give a list of stages"):
        tf.optimize(design(comm, pattern), tf.Stage(1))  # type: ignore[arg-type]
    with pytest.raises(errors.ParameterError, match=r"a list of names: \['base'\]"):
        tf.clamp(pattern, "base")


def test_metrics_need_names_of_their_own(comm: MPI.Comm, pattern: Pattern) -> None:
    same = tf.Metric("angle", "deg", 1.0, lambda *_: 0.0)
    with pytest.raises(errors.ParameterError, match="each needs its own name"):
        design(comm, pattern, metrics=[same, same])
