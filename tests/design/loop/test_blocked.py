"""The push of a blocked panel: its value, its gradient, and a design for it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.loops import OneEntry, Stopped, figures
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.design.loop.blocked import Blocked, ForceObjective
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.paths.rigid_panels import wrench
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, bend, cylinder

LENGTH = 0.06
PLAIN = Regularisation(9e-3, length_scale=None)
# The tip is held in x, and free to slide along z and to turn about y.
HINGED = (False, True, True, True, True, True)
ASIDE = (0.01, 0.0, -0.002, 0.0, 0.3, 0.0)


def case_of(tube: Pattern, blocked: Blocked) -> Case:
    free = Case(
        tube,
        target=bend(np.radians(40), LENGTH, neutral=0.01),
        supports=clamp(tube, ["base"]),
        pressure=5e3,
        printed_panels=["base", "tip"],
    )
    return replace(free, poses=[replace(free, blocked=blocked, name="blocked")])


@pytest.fixture
def tube(comm: MPI.Comm) -> Pattern:
    return cylinder(comm, LENGTH, 0.02, 6e-3)


def test_the_push_is_that_of_the_supports(comm: MPI.Comm, tube: Pattern) -> None:
    blocked = Blocked("tip", ASIDE, (2.0, 0.0, 0.0), 0.5)
    design = ShapeDesign(comm, case_of(tube, blocked), PLAIN)
    made = design.simulate(design.fields.start(2))
    of_tip = made.poses[0]
    assert isinstance(of_tip.problem, ShapeDesign)
    force = wrench(of_tip.problem.solver, of_tip.equilibrium, ["tip"])
    assert made.metrics["blocked_force_n"] == pytest.approx(-force[0])
    assert of_tip.shape == pytest.approx(0.5 * (-force[0] / 0.5 - 1) ** 2)
    # More than what is asked for is as good.
    less = ForceObjective(replace(blocked, force=0.5, direction=(-1, 0, 0)), 1)
    assert less.push(force) == pytest.approx(force[0])
    easy = ForceObjective(replace(less.blocked, force=0.5 * force[0]), 1)
    assert easy.forward(force) == 0
    assert not np.any(easy.backward(force))
    positions = of_tip.problem.solver.positions(of_tip.equilibrium)
    assert blocked.pose_at(tube, positions) == pytest.approx(ASIDE, abs=1e-9)


@pytest.mark.parametrize("free", [(False,) * 6, HINGED], ids=["held", "hinged"])
def test_gradient(comm: MPI.Comm, tube: Pattern, free: tuple[bool, ...]) -> None:
    """Where the panel is free in part, it goes where its wrench is zero."""
    design = ShapeDesign(comm, case_of(tube, Blocked("tip", ASIDE, (1, 0, 0.2), 0.5, free)), PLAIN)
    alone = design.poses[0]
    x = design.fields.start(1)
    first = design.simulate(x)
    here = first.poses[0]
    slope = alone.physics.pull_back(
        here.equilibrium, alone.objective.backward(alone.physics.observed(here.equilibrium))
    )[0]
    slope = design.fields.backward(here.filtered, slope)
    drawn = np.random.default_rng(5).uniform(-1, 1, len(tube.panel))
    way = drawn[design.skin.owned_cells] * design.designed
    expected = comm.allreduce(float(slope @ way))
    left = []
    for step in (2e-3, 1e-3):
        there = design.simulate(x + step * way, first.start).poses[0]
        left.append(abs(there.shape - here.shape - step * expected))
    assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.02)
    if free[1]:
        off = wrench(alone.solver, here.equilibrium, ["tip"])[list(free)]
        assert np.abs(off).max() < 1e-4


def test_a_loop_goes_on_bit_for_bit(alone: MPI.Comm) -> None:
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    case, options = case_of(tube, Blocked("tip", ASIDE, (1, 0, 0), 0.3)), DesignOptions((Stage(3),))
    whole = optimize(ShapeDesign(alone, case, PLAIN), options, seed=2)
    assert whole.final.objective < whole.history[0].objective
    journal = OneEntry(stop_at=2)
    with pytest.raises(Stopped):
        optimize(ShapeDesign(alone, case, PLAIN), options, seed=2, journal=journal)
    kept = OneEntry(saved=journal.kept)
    again = optimize(ShapeDesign(alone, case, PLAIN), options, seed=2, journal=kept)
    assert [figures(row) for row in again.history] == [figures(row) for row in whole.history]


def test_what_does_not_fit_is_told(alone: MPI.Comm) -> None:
    tube = cylinder(alone, LENGTH, 0.02, 6e-3)
    good = Blocked("tip", ASIDE, (1, 0, 0), 0.3)
    with pytest.raises(ParameterError, match="give it to one of `poses`"):
        ShapeDesign(alone, replace(case_of(tube, good), blocked=good), PLAIN)
    ball = Contact(bodies=[rigid_sphere("ball", 0.01, (0.1, 0.0, 0.0))])
    case = case_of(tube, good)
    touched = replace(case, poses=[replace(case.poses[0], contact=ball)])
    with pytest.raises(ParameterError, match="has a blocked panel and contact"):
        ShapeDesign(alone, touched, PLAIN)
    with pytest.raises(ParameterError, match="give the direction of the push"):
        replace(good, direction=(0, 0, 0))
    with pytest.raises(ParameterError, match="force = 0"):
        replace(good, force=0.0)
    with pytest.raises(ParameterError, match="pose"):
        replace(good, pose=(0, 0, 0))
