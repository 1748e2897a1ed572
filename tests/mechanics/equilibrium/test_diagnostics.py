"""Sentences that say why a solve ended."""

import numpy as np
import pytest
from helpers.scenes import square
from helpers.standing import model_on_base
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.equilibrium.continuation import ContinuationResult
from toros_fem.mechanics.equilibrium.diagnostics import Condition, condition_of, failure, success
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Skin, sew

OUTCOMES = PETSc.SNES.ConvergedReason
LOAD = Load(np.array([2e3]))
USUAL = Condition()


@pytest.fixture(scope="module")
def model(short_tube: Skin) -> SkinModel:
    return model_on_base(short_tube)


def said(model: SkinModel, outcome: int, load_factor: float | None) -> str:
    end = ContinuationResult(model.assembled, load_factor, outcome)
    return failure(model, end, LOAD, model.assembled, max_steps=7, once=False)


def test_success_and_its_warnings(short_tube: Skin, model: SkinModel) -> None:
    assert success(LOAD, 1e-11, USUAL) == "A stable equilibrium was found at 2000 Pa."
    assert "a residual of 3e-06 of the load" in success(LOAD, 3e-6, USUAL)
    assert condition_of(model, model.assembled, None, None) == USUAL
    out = model.assembled.copy()
    model.positions(out)[:, 0] *= -1
    told = condition_of(model, out, None, None).sentences
    assert "has a volume of -" in told
    assert "turned inside out" in told
    upper = short_tube.pattern.points[short_tube.pattern.triangles].mean(axis=1)[:, 2] > 0.03
    chambers = Chambers(("low", "high"), upper.astype(int))
    two = model_on_base(short_tube, Composite(bending=None), chambers=chambers)
    two.set_load(Load(np.array([2e3, 2e3])))
    state = two.assembled.copy()
    points = two.positions(state)
    points[points[:, 2] > 0.03, 0] *= -1
    assert "chamber 'high' has a volume of -" in condition_of(two, state, None, None).sentences


@pytest.mark.parametrize(
    ("outcome", "sentence"),
    [
        (OUTCOMES.DIVERGED_MAX_IT, "took 7 steps without converging"),
        (OUTCOMES.DIVERGED_INNER, "is not stable"),
        (OUTCOMES.DIVERGED_LINE_SEARCH, "no step lowered the energy"),
        (-4, "forces are no numbers"),
        (OUTCOMES.DIVERGED_TR_DELTA, "the trust region shrank"),
        (OUTCOMES.DIVERGED_JACOBIAN_DOMAIN, "ended by reason -10"),
    ],
)
def test_failure_says_why(model: SkinModel, outcome: int, sentence: str) -> None:
    assert sentence in said(model, int(outcome), 0.25)


def test_failure_says_how_far_the_load_came(model: SkinModel) -> None:
    part = said(model, -6, 0.25)
    assert "The last equilibrium is at 500 Pa, 25 % of the load" in part
    assert "Lower the load" in part
    none = said(model, -6, None)
    assert "none under a lower load" in none
    assert "Check materials and supports" in none


def test_folded_edges_are_counted_once(alone: MPI.Comm) -> None:
    """One half of a sheet is laid onto the other: the four edges of the fold."""
    pattern = square(n=4)
    model = make_model(
        sew(alone, pattern), Composite(), Supports(np.ones(pattern.points.shape, dtype=bool))
    )
    state = model.assembled
    nodes = model.positions(state)
    middle = 0.01
    over = nodes[:, 0] > middle
    nodes[over, 2] += 1e-3 * (nodes[over, 0] - middle)
    nodes[over, 0] = 2 * middle - nodes[over, 0]
    end = ContinuationResult(model.assembled, None, -6)
    said = failure(model, end, LOAD, state, max_steps=7, once=False)
    assert "4 edges are folded by more than 170 degrees" in said


def test_a_single_attempt_tells_of_no_continuation(model: SkinModel) -> None:
    end = ContinuationResult(model.assembled, None, int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT))
    said = failure(model, end, LOAD, model.assembled, max_steps=7, once=True)
    assert "at once: Newton's method took 7 steps without converging." in said
    assert "by raising the load" not in said
    assert said.endswith("Solve without trial = True, which also tries continuation.")
