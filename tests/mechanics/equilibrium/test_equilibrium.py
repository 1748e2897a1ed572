"""What is told of an equilibrium, or of none: its condition, sentences, and the path through it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import TABLE_A, square
from helpers.standing import model_on_base, solver_on_base
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.validation import Floats
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium import equilibrium
from toros_fem.mechanics.equilibrium.equilibrium import (
    Condition,
    Equilibrium,
    PathPoint,
    condition_of,
    may_snap,
)
from toros_fem.mechanics.equilibrium.search import ContinuationResult, failure, success
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Skin, cylinder, sew
from toros_fem.meshes.sheets import rectangle

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


LENGTH, WIDTH = 0.06, 0.01


class Arch:
    """A strip between walls that are too close, so that it stands up or hangs down."""

    def __init__(self, comm: MPI.Comm) -> None:
        rise = 2 / np.pi * np.sqrt(0.03) * LENGTH

        def place(flat: Floats) -> Floats:
            u, v = flat.T
            return np.column_stack([0.97 * u, v, rise * np.sin(np.pi * u / LENGTH)])

        pattern = rectangle(comm, LENGTH, WIDTH, 5e-3, "right", place)
        u = pattern.flat_points[:, 0]
        ends = (u < 1e-9) | (u > LENGTH - 1e-9)
        self.middle = np.abs(u - LENGTH / 2) < 1e-9
        self.skin = sew(comm, pattern)
        composite = Composite(reinforcement=Material(2e6, 0.3, 1e-3))
        held = Supports(np.repeat(ends[:, None], 3, axis=1))
        self.said: list[str] = []
        self.solver = EquilibriumSolver(self.skin, composite, held, log=self._listen)
        self.density = np.ones(len(self.skin.owned_cells))

    def _listen(self, row: object) -> None:
        if isinstance(row, str):
            self.said.append(row)

    def pushed(self, force: float, start: Equilibrium | None = None) -> Equilibrium:
        """Push the middle down by a force in N."""
        forces = np.zeros((len(self.middle), 3))
        forces[self.middle, 2] = -force / self.middle.sum()
        return self.solver.solve(self.density, Load(0.0, force=forces), start)

    def height(self, result: Equilibrium) -> float:
        return float(self.skin.gather_vertices(result.positions)[self.middle, 2].mean())


@pytest.fixture(scope="module")
def arch(alone: MPI.Comm) -> Arch:
    return Arch(alone)


def test_a_snap_is_told_and_a_path_without_one_is_not(arch: Arch) -> None:
    free = arch.pushed(0.0)
    assert free.condition.snapped is None  # its start, the assembled shape, is no equilibrium
    assert arch.pushed(50e-3, free).condition.snapped is True, "far over it"
    below = arch.pushed(6e-3, free)
    assert below.condition.snapped is False
    assert arch.height(below) > 5e-3
    beyond = arch.pushed(8e-3, below)
    assert beyond.condition.snapped is True
    assert arch.height(beyond) < -5e-3
    assert "snapped" in beyond.reason
    assert "snapped" in arch.said[-1]
    # It stays below when the force goes, far from where it was: no jump.
    back = arch.pushed(0.0, beyond)
    assert back.condition.snapped is False
    assert arch.height(back) == pytest.approx(-arch.height(free), rel=1e-3)


def test_a_jump_is_told_from_a_steep_path(arch: Arch) -> None:
    """However near it begins, and however far the load goes on."""
    free = arch.pushed(0.0)
    before = arch.pushed(4.5e-3, free)
    x = np.cos(np.arange(len(free.state))) * arch.solver.model.free
    factor = arch.solver._newton.factor
    assert factor.solve(factor.multiply(x)) == pytest.approx(x, abs=1e-7), "those of the end"
    for force in (6.5e-3, 6.8e-3, 6.9e-3):
        assert arch.pushed(force, free).condition.snapped is False
        before = arch.pushed(force, before)
        assert before.condition.snapped is False
        assert arch.height(before) > 0
        for far in (8e-3, 20e-3, 50e-3):
            assert arch.pushed(far, before).condition.snapped is True


@pytest.mark.parametrize(
    ("predicted", "jumps"),
    [(0.45, True), (0.55, False), (5.0, False), (-1.0, True), (np.nan, True)],
)
def test_the_tangent_must_predict_half_of_the_motion(
    monkeypatch: pytest.MonkeyPatch, predicted: float, jumps: bool
) -> None:
    one, load = np.ones(2), Load(np.ones(1))
    begin, end = PathPoint(one, load, 0 * one), PathPoint(one, load, one)
    aside = np.array([1.0, -1.0])
    monkeypatch.setattr(equilibrium, "motion_to", lambda *_: -predicted * one + aside)
    skin = SimpleNamespace(comm=MPI.COMM_SELF, pattern=SimpleNamespace(size=1.0))
    model: Any = SimpleNamespace(skin=skin, free=one)
    assert may_snap(model, None, begin, end) is jumps  # type: ignore[arg-type]
    assert not may_snap(model, None, begin, begin)  # type: ignore[arg-type]


def test_a_limit_point_is_seen_from_near(arch: Arch) -> None:
    free = arch.pushed(0.0)
    early = arch.pushed(5e-3, free)
    assert early.condition.critical_load is None
    solver, x = arch.solver, np.cos(np.arange(len(early.state))) * arch.solver.model.free
    same = solver.solve_tangent(solver._factor.multiply(x), early)
    assert same == pytest.approx(x, abs=1e-7), "the factors and the tangent are of one state"
    near = arch.pushed(6.8e-3, early)
    critical = near.condition.critical_load
    assert 1.0 < critical < 1.05
    assert "limit point or a bifurcation" in near.reason
    # It does snap there, and not before.
    assert arch.pushed(0.5 * (1 + critical) * 6.8e-3 * 0.99, near).condition.snapped is False
    assert arch.pushed(critical * 6.8e-3 * 1.01, near).condition.snapped is True


def test_a_completed_trial_knows_its_path(arch: Arch) -> None:
    """As on a path of loads, which is made of trials that are completed."""
    free = arch.pushed(0.0)
    for force, snapped in ((6e-3, False), (25e-3, True)):
        forces = np.zeros((len(arch.middle), 3))
        forces[arch.middle, 2] = -force / arch.middle.sum()
        trial = arch.solver.solve(arch.density, Load(0.0, force=forces), start=free, trial=True)
        assert trial.condition.snapped is None
        free = arch.solver.finish(trial)
        assert free.condition.snapped is snapped
        assert arch.solver.solve_tangent(np.ones_like(free.state), free).any()


def test_a_skin_blown_up_to_its_bounds_says_so(alone: MPI.Comm) -> None:
    """Beyond the limit pressure of its law it is found where the barrier stops it."""
    skin = sew(alone, cylinder(alone, 0.04, 0.02, 5e-3, mesh="structured"))
    plain = np.zeros(len(skin.owned_cells))
    far = Composite(fabric=TABLE_A, c1=1e3, c2=1e3, bending=None)
    blown = solver_on_base(skin, far).solve(plain, 2.5e3)
    assert blown.converged
    assert blown.stretch_use > 0.99
    assert blown.condition.blown_up
    assert "only the stretch bounds hold it" in blown.reason
    cloth = Composite(fabric=TABLE_A, bending=None)
    held = solver_on_base(skin, cloth).solve(plain, 2.5e3)
    assert not held.condition.blown_up
    assert held.condition.sentences == ""
