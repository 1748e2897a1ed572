"""The path through an equilibrium: snaps, singular points, states that are connected."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium import path
from toros_fem.mechanics.equilibrium.continuation import Attempt
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.path import SMALL, PathPoint, find_jump, joins, leads
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import cylinder, sew
from toros_fem.meshes.makers.sheets import rectangle

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


def test_tangents_at_both_ends_tell_a_smooth_path(arch: Arch) -> None:
    """Where neither of them does alone; across a jump they do not, however near it begins."""
    free, solver = arch.pushed(0.0), arch.solver
    model, newton = solver.model, solver._newton

    def told(begin: Equilibrium, end: Equilibrium) -> tuple[bool, bool]:
        solver.tangent_at(end)
        one = leads(model, newton.factor, end.point, begin.point, SMALL)
        return one, joins(model, newton, begin.point, end.point)

    below = arch.pushed(4.5e-3, free)
    assert told(free, below) == (False, True)
    assert newton.stable(below.state)
    x = np.cos(np.arange(len(below.state))) * model.free
    assert newton.factor.solve(newton.factor.multiply(x)) == pytest.approx(x, abs=1e-7)
    before = below
    for force in (6.5e-3, 6.8e-3, 6.9e-3):
        before = arch.pushed(force, before)
        assert arch.height(before) > 0
        for far in (8e-3, 20e-3, 50e-3):
            beyond = arch.pushed(far, before)
            assert beyond.condition.snapped is True
            assert told(before, beyond) == (False, False)


@pytest.mark.parametrize(
    ("forward", "backward", "joined"),
    [
        (1.1, 0.8, True),
        (1.45, 0.6, True),  # each explains half of the motion, their mean nearly all
        (1.51, 0.31, False),  # a fold, a jump of 60 %, and a path of constant stiffness
        (0.6, 1.45, True),
        (0.4, 1.45, False),
        (1.3, 1.3, False),
        (np.nan, 1.0, False),
        (1.0, np.nan, False),
    ],
)
def test_both_tangents_and_their_mean_must_predict(
    monkeypatch: pytest.MonkeyPatch, forward: float, backward: float, joined: bool
) -> None:
    one, load = np.ones(1), Load(np.ones(1))
    begin, end = PathPoint(one, load, 0 * one), PathPoint(one, load, one)
    moves = {0.0: forward, 1.0: -backward}
    monkeypatch.setattr(path, "_predicted", lambda *a: np.full(1, moves[float(a[2].state[0])]))
    model: Any = SimpleNamespace(
        skin=SimpleNamespace(comm=MPI.COMM_SELF), free=one, set_density=id, set_load=id
    )
    stable: list[Floats] = []

    def is_stable(state: Floats) -> bool:
        stable.append(state)
        return True

    newton: Any = SimpleNamespace(factor=None, stable=is_stable)
    assert joins(model, newton, begin, end) is joined
    there = len(stable)
    assert joins(model, newton, replace(begin, motion=np.full(1, forward)), end) is joined
    assert len(stable) == there, "the begin is not factorised where its motion is known"


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


def slope(path: Callable[[float], float], at: float) -> float:
    """The derivative of a path."""
    return (path(at + 1e-6) - path(at - 1e-6)) / 2e-6


def jump_of(
    path: Callable[[float], float], end: float, solved: list[float] | None = None
) -> tuple[bool | None, float]:
    """The answer for a path of one number that is known; `solved` takes the places of solves."""
    places = [] if solved is None else solved

    def attempt(_: Floats, at: float) -> Attempt:
        places.append(at)
        return Attempt(np.array([path(at)]), 1, 1)

    one = np.zeros(1)
    load = Load(one)
    begin, last = (PathPoint(one, load, np.array([x])) for x in (path(0.0), end))
    found, reached = find_jump(
        lambda a, b: float(abs(a - b)[0]),
        attempt,
        lambda a, f, b, g: abs(a + (g - f) * slope(path, f) - b)[0] <= 0.5 * abs(b - a)[0],
        begin,
        last,
    )
    return found, float(reached[0])


def test_jumps_of_known_paths() -> None:
    assert jump_of(lambda f: f, 1.0) == (False, 1.0)
    assert jump_of(lambda f: f**4, 1.0) == (False, 1.0)
    for place in (0.02, 0.3, 0.77, 0.99):
        assert jump_of(lambda f, p=place: 0.1 * f + (f > p), 1.1) == (True, 1.1)  # type: ignore[misc]
    solved: list[float] = []
    assert jump_of(lambda f: f + 0.3 * f * f, 1.3, solved) == (False, 1.3)
    assert solved == [0.5], "the tangent in the middle leads to both ends"
    # The path is smooth, but the end that was found lies elsewhere.
    assert jump_of(lambda f: f, 3.0)[1] == 1.0
