"""One print in several poses: objective, gradient, checkpoints, and what is refused."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.loops import OneEntry, Stopped, figures
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.validation import Floats
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.levels import gathered
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign
from toros_fem.making.as_printed import as_printed
from toros_fem.measures.metrics import Metric, bend_angle
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, bend, cylinder
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.pressure import trimmed, worst_of_print

LENGTH = 0.06
PLAIN = Regularisation(9e-3, length_scale=None)


def angle(target: float) -> Metric:
    def measure(pattern: Pattern, positions: Floats) -> float:
        return float(np.degrees(bend_angle(pattern, positions)))

    return Metric("angle", "deg", target, measure)


def pose(tube: Pattern, degrees: float, pressure: float, **changes: object) -> Case:
    given = {
        "target": bend(np.radians(degrees), LENGTH, neutral=0.01),
        "supports": clamp(tube, ["base"]),
        "pressure": pressure,
        "metrics": [angle(degrees)],
        "printed_panels": ["base", "tip"],
        **changes,
    }
    return Case(tube, **given)  # type: ignore[arg-type]


def hung(tube: Pattern, newtons: float) -> Floats:
    """A force on the tip that bends the tube back."""
    force, tip = np.zeros_like(tube.points), tube.vertices_of("tip")
    force[tip, 0] = -newtons / len(tip)
    return force


def three_poses(tube: Pattern) -> Case:
    """At a lower pressure, with a weight at the tip, and held at both ends."""
    held = clamp(tube, ["base", "tip"])
    return pose(
        tube,
        40.0,
        6e3,
        importance=2.0,
        poses=[
            pose(tube, 20.0, 3e3),
            pose(tube, 40.0, 6e3, force=hung(tube, 0.05), name="loaded", importance=0.5),
            pose(tube, 0.0, 4e3, supports=held),
        ],
    )


@pytest.fixture
def tube(comm: MPI.Comm) -> Pattern:
    return cylinder(comm, LENGTH, 0.02, 6e-3)


def test_the_objective_is_the_weighted_mean(comm: MPI.Comm, tube: Pattern) -> None:
    """Poses do not know of each other: each is as if it were designed alone."""
    case = three_poses(tube)
    together = ShapeDesign(comm, case, PLAIN)
    found = together.simulate(together.fields.start(3))
    shapes: list[float] = []
    values: list[float] = []
    for one in (replace(case, poses=()), *case.poses):
        alone = ShapeDesign(comm, one, PLAIN)
        made = alone.simulate(alone.fields.start(3))
        shapes.append(made.shape)
        values += made.metrics.values()
    assert found.shape == pytest.approx(np.dot([2, 1, 0.5, 1], shapes) / 4.5, rel=1e-7)
    assert found.metrics == pytest.approx(
        dict(
            zip(
                ("angle_deg", "pose_2_angle_deg", "loaded_angle_deg", "pose_4_angle_deg"),
                values,
                strict=True,
            )
        ),
        rel=1e-6,
        abs=1e-6,
    )
    assert found.steps == sum(one.equilibrium.steps for one in found.every)


def test_gradient_of_all_poses(comm: MPI.Comm, tube: Pattern) -> None:
    design = ShapeDesign(comm, three_poses(tube), PLAIN)
    x = design.fields.start(1)
    here, slopes = design.evaluate(x)
    drawn = np.random.default_rng(5).uniform(-1, 1, len(tube.panel))
    way = drawn[design.skin.owned_cells] * design.designed
    slope = comm.allreduce(float(slopes.gradient @ way))
    left = []
    for step in (1.5e-3, 7.5e-4):
        there = design.simulate(x + step * way, here.start)
        left.append(abs(there.objective - here.objective - step * slope))
    assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.02)


def test_a_loop_goes_on_bit_for_bit(alone: MPI.Comm) -> None:
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    options = DesignOptions((Stage(3),))

    def make() -> ShapeDesign:
        return ShapeDesign(alone, three_poses(tube), PLAIN)

    whole = optimize(make(), options, seed=2)
    journal = OneEntry(stop_at=2)
    with pytest.raises(Stopped):
        optimize(make(), options, seed=2, journal=journal)
    again = optimize(make(), options, seed=2, journal=OneEntry(saved=journal.kept))
    assert [figures(row) for row in again.history] == [figures(row) for row in whole.history]
    assert again.final.metrics == whole.final.metrics


def test_poses_are_carried_to_another_mesh(alone: MPI.Comm) -> None:
    """Each starts from its own shape there."""
    coarse, fine = (cylinder(alone, LENGTH, 0.02, edge) for edge in (6e-3, 4.5e-3))
    first = optimize(ShapeDesign(alone, three_poses(coarse), PLAIN), [Stage(1)], seed=2)
    assert len(gathered(first).poses) == 3
    begin = ShapeDesign(alone, three_poses(coarse), PLAIN)
    made = begin.simulate(begin.fields.start(2))
    at, *others = (begin.skin.gather_vertices(one.equilibrium.positions) for one in made.every)
    density = begin.skin.gather_cells(made.density)
    design = CarriedDesign(coarse, density, positions=at, poses=tuple(others))
    problem = ShapeDesign(alone, three_poses(fine), PLAIN)
    density, start = design.on(problem)
    warm = problem.simulate(density, start)
    assert warm.metrics == pytest.approx(problem.simulate(density).metrics, abs=1e-3)
    transfer = make_transfer(coarse, fine)
    for begun, shape in zip(start, (at, *others), strict=True):
        off = problem.skin.gather_vertices(begun) - transfer.positions(shape)
        assert np.median(np.abs(off)) < 1e-12, "but where stretches would leave their bounds"


def test_a_print_is_simulated_in_all_poses(alone: MPI.Comm) -> None:
    """Its pressures are trimmed by one factor, for the worst figure of all."""
    tube = cylinder(alone, LENGTH, 0.02, 4.5e-3)
    case = pose(tube, 35.0, 6e3, poses=[pose(tube, 20.0, 3e3, name="half")])
    result = optimize(ShapeDesign(alone, case, PLAIN), [Stage(12)], seed=2)
    made = as_printed(result.problem, result)
    assert made.evaluation is not None
    assert [*made.metrics] == ["angle_deg", "half_angle_deg"]
    better = trimmed(made)
    assert better.evaluation is not None
    assert worst_of_print(better) <= worst_of_print(made)
    first, second = (one.equilibrium.pressure for one in better.evaluation.every)
    assert second == pytest.approx(first / 2)
    printed = made.evaluation
    lower = printed.problem.simulate_binary(printed.projected, printed, pressure=4.5e3)
    assert [one.equilibrium.pressure for one in lower.every] == pytest.approx([4.5e3, 2.25e3])


WRONG: list[tuple[Callable[[Pattern, MPI.Comm], dict[str, object]], str]] = [
    (lambda tube, _: {"poses": [pose(tube, 9.0, 1e3, poses=[pose(tube, 9.0, 1e3)])]}, "of its own"),
    (
        lambda _, comm: {"poses": [pose(cylinder(comm, LENGTH, 0.02, 5e-3), 9.0, 1e3)]},
        "another pattern",
    ),
    (
        lambda tube, _: {"poses": [pose(tube, 9.0, 1e3, composite=tf.Composite(bending=None))]},
        "another composite",
    ),
    (
        lambda tube, _: {"poses": [pose(tube, 9.0, 1e3, pressure_bounds=(1e3, 2e3))]},
        "are prescribed",
    ),
    (lambda _, __: {"poses": ["half"]}, "must be a list of Cases"),
    (
        lambda tube, _: {"poses": [pose(tube, 9.0, 1e3, name=name) for name in ("a", "a")]},
        "two poses are named 'a'",
    ),
    (
        lambda tube, _: {
            "metrics": [replace(angle(9.0), name="pose_2_angle")],
            "poses": [pose(tube, 9.0, 1e3)],
        },
        "two metrics are named 'pose_2_angle_deg'",
    ),
    (lambda _, __: {"importance": 0.0}, "importance = 0"),
]


@pytest.mark.parametrize(("given", "words"), WRONG, ids=[words for _, words in WRONG])
def test_what_does_not_fit_is_told(
    alone: MPI.Comm, given: Callable[[Pattern, MPI.Comm], dict[str, object]], words: str
) -> None:
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    case = pose(tube, 40.0, 6e3, **{"composite": tf.Composite(), **given(tube, alone)})
    with pytest.raises(ParameterError, match=words):
        ShapeDesign(alone, case, PLAIN)


def test_a_lost_pose_is_named(alone: MPI.Comm) -> None:
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    case = pose(tube, 20.0, 2e3, poses=[pose(tube, 20.0, 2e3), pose(tube, 20.0, 5e3)])
    design = ShapeDesign(alone, case, PLAIN)

    def respond(*_: object, trial: bool) -> None:
        raise NoEquilibriumError("nothing holds it.")

    lost: Any = SimpleNamespace(pressures=(5e3,), respond=respond)
    design.poses[1].physics = lost
    with pytest.raises(NoEquilibriumError, match="pose 3: nothing holds it"):
        design.simulate(design.fields.start(2), trial=True)
    with pytest.raises(ParameterError, match="has 0 further poses, the design 2"):
        design.towards(replace(case, poses=()))


def test_a_design_begins_with_its_first_pose(alone: MPI.Comm) -> None:
    """There it counts most; rows tell the miss of all poses by their own weights."""
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    case = pose(tube, 40.0, 6e3, poses=[pose(tube, -20.0, 3e3)])
    found = optimize(ShapeDesign(alone, case, PLAIN), [Stage(4)], seed=2)
    rows = found.history
    first = [row for row in rows if row.beta < rows[-1].beta]
    assert first[-1].metrics["angle_deg"] > 15
    assert first[-1].objective < 0.5 * first[-1].shape
    assert rows[-1].objective == pytest.approx(rows[-1].shape)
    assert found.final.shape == pytest.approx(rows[-1].shape)
    assert optimize(found.problem, [Stage(1)], after=found).history[-1].stage == rows[-1].stage + 1
    # What another load suits is far from what suits the first pose.
    loaded = replace(case, poses=[pose(tube, -20.0, 3e3, force=hung(tube, 0.05))])
    both = optimize(ShapeDesign(alone, loaded, PLAIN), [Stage(4)], seed=2)
    assert both.history[-1].stage == rows[-1].stage - 1
