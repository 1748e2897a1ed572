"""The SNES: its arguments and results, and other types of SNES on the same functions."""

import numpy as np
import pytest
from helpers.standing import model_on_base
from petsc4py import PETSc

from toros_fem.base.mpi import norm
from toros_fem.mechanics.equilibrium.newton import Attempts, Newton, NewtonOptions
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import Skin


@pytest.fixture(scope="module")
def snes(tube: Skin) -> Newton:
    """The short tube at 1 kPa with a uniform design."""
    model = model_on_base(tube)
    model.set_density(np.full(len(tube.owned_cells), 0.5))
    model.set_load(Load(np.array([1e3])))
    return Newton(model, NewtonOptions())


def test_a_solve_returns_its_history(snes: Newton) -> None:
    found = snes(snes.model.assembled)
    assert found.converged
    assert found.outcome > 0
    assert found.steps == len(found.history) > 1
    assert {row.pressure for row in found.history} == {1e3}
    assert found.history[-1].step == 0
    again = snes(found.state)
    assert len(again.history) < len(found.history), "a history of its own"


def test_factors_are_reused_on_request(snes: Newton) -> None:
    model = snes.model
    base = snes(model.assembled)
    model.set_load(Load(np.array([1.01e3])))
    by_old_factors = snes(base.state, near=True)
    snes(base.state)
    snes.stable(base.state)
    by_new_factors = snes(base.state)
    model.set_load(Load(np.array([1e3])))
    assert by_old_factors.history[0].kind == "modified"
    assert by_new_factors.history[0].kind != "modified"
    gap = norm(model.skin.comm, by_old_factors.state - by_new_factors.state)
    assert gap < 1e-8 * norm(model.skin.comm, by_new_factors.state)


def test_max_steps_of_one_solve(snes: Newton) -> None:
    stopped = snes(snes.model.assembled, max_steps=1)
    assert stopped.outcome == int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT)
    assert sum(row.step > 0 and row.kind != "modified" for row in stopped.history) == 1
    assert snes(snes.model.assembled).converged, "the limit was that of one solve"


def test_attempts_add_up(snes: Newton) -> None:
    """Only an attempt that converged leaves factors for the next one."""
    model = snes.model
    attempts = Attempts(snes)
    before = snes.factor.count
    failed = attempts(model.assembled, 1)
    assert not failed.converged
    found = attempts(model.assembled)
    assert found.history[0].kind != "modified"
    model.set_load(Load(np.array([1.01e3])))
    near = attempts(found.state)
    model.set_load(Load(np.array([1e3])))
    assert near.history[0].kind == "modified"
    assert attempts.history == [*failed.history, *found.history, *near.history]
    assert attempts.steps + attempts.modified_steps == sum(row.step > 0 for row in attempts.history)
    assert attempts.factorisations == snes.factor.count - before
    assert attempts.last is near.state
