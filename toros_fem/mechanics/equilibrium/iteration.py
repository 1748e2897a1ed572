"""One solve for an equilibrium: where it is, its limits, its history."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, norm, smallest
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.equilibrium.linear_solver import ShiftLadder, TangentFactor

# PETSc's reason where a residual is not finite; its name is another one from 3.25.
NO_NUMBER = -4
# If rounding keeps every step from lowering the energy, this residual over the load is enough.
STAGNATED = 1e-8
# Or this one, where Newton's full step leaves the fraction STUCK of it and moves nothing further
# than the fraction RESOLVED of the skin's size.
UNRESOLVED, STUCK, RESOLVED = 1e-5, 0.5, 1e-9
# Where rounding hides a step's gain, it must be the fraction ARMIJO of the predicted one, or leave
# at most the fraction FLATTER of the slope.
ARMIJO, FLATTER = 1e-4, 0.9

# States that are kept: the begin of a step, and the last trials.
KEPT = 3


class SolveState:
    """What the hooks of a SNES share.

    Attributes:
        model: The skin's model, at the load and density that are set.
        factor, ladder: Its tangent and the shift of that.
        points: Energies and residuals of the last states.
        history: Rows of the solve.
        base: Begin of the step.
        reference: Applied load there in N, by which residuals are measured.
        rounding: Change of the energy in J that rounding may hide.
        tolerance: Residual over the load at which a state is an equilibrium.
        finish: Whether the tangent there must be positive definite; `proven` tells if it is.
        kind, iterations: Of the step, as in `NewtonStep`.
        step: Newton's step as far as the bounds allow it, `cap` this part of it, and `longest` its
            largest component in m.
        rate: Fraction of the residual that a modified step would leave.
        predict: Whether the next step may be a modified one from the start; `first` whether this
            one is.
        escapes: Number of saddles that were left.
    """

    def __init__(
        self,
        model: SkinModel,
        fraction_to_barrier: float,
        log: Callable[[NewtonStep], None] | None,
    ) -> None:
        self.model, self.comm = model, model.skin.comm
        self._fraction, self._log = fraction_to_barrier, log
        self.factor = TangentFactor(model)
        self.ladder = ShiftLadder(self.factor)
        self.points = Points(model)
        self.history: list[NewtonStep] = []
        self._stiffness, self._clock = 0.0, 0.0
        self.base: Point

    def forget(self, *, near: bool) -> None:
        """Begin a solve, near the last one or not; its runs share a history (collective)."""
        self.history = []
        self._stiffness, self._clock = 0.0, time.perf_counter()
        self.ladder.reset(near=near)

    def begin(self, start: Floats, tolerance: float, *, finish: bool, predict: bool) -> bool:
        """Begin a run of the SNES; return whether the start is admissible (collective)."""
        model = self.model
        self.lag(start)
        self.base = self.points.at(start)
        crossed = model.contact is not None and model.contact.crossed(start)
        self.tolerance, self.finish, self.predict = tolerance, finish, predict
        self.kind, self.first, self.proven = "newton", False, False
        self.step: Floats = np.zeros_like(start)
        self.rate, self.cap, self.longest = np.inf, 1.0, np.inf
        self.iterations = self.escapes = 0
        if not np.isfinite(self.base.energy) or crossed:
            return False
        self.measure()
        return True

    @property
    def residual(self) -> float:
        """Residual over the load at the begin of the step."""
        return self.base.size / self.reference

    @property
    def exact(self) -> bool:
        """Whether the step is Newton's own: with factors of this state, without a shift."""
        return self.kind == "newton" and self.ladder.shift == 0

    def measure(self) -> None:
        """Measure the load and the rounding of the energy at the base (collective)."""
        self.reference = self.load_at(self.base.state)
        load_energy = self.model.load_energy(self.base.state)
        self.rounding = self.model.energy_rounding() + 1e-14 * load_energy

    def load_at(self, state: Floats) -> float:
        """Return the norm of the applied load in N, by which residuals are measured (collective).

        Where supports move, or without any load, it is that of their reaction. Without any
        reaction it is the force of a strain of 1e-4.
        """
        model = self.model
        load = norm(self.comm, model.applied_load(state))
        if load > 0 and model.load.displacement is None:
            return load
        reaction = norm(self.comm, model.reaction(state))
        if load > 0:
            return max(load, reaction)
        area = float(model.skin.pattern.areas.sum())
        return max(1e-4 * model.mean_modulus() * area**0.5, reaction)

    def assemble(self, state: Floats) -> None:
        """Assemble the tangent at a state."""
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        self.assemble(state)
        return self.factor.factorise()

    def change(self, state: Floats) -> float:
        """Return the change of the energy in J since the begin of the step.

        Where rounding hides it, it is the work of the mean force.
        """
        change = self.points.near(state).energy - self.base.energy
        return sum(self._work(state)) / 2 if abs(change) <= self.rounding else change

    def merit(self, state: Floats) -> float:
        """Return what the line search lowers: the change of the energy in J.

        Where rounding hides it, Armijo's rule must hold, or the step must flatten the slope: else
        one that moves nothing would do (Hager & Zhang 2005, eq. 2.4, approximate Wolfe).
        """
        change = self.points.near(state).energy - self.base.energy
        if not abs(change) <= self.rounding:
            return change
        before, after = self._work(state)
        if change <= ARMIJO * before:
            return change
        flatter = abs(after) <= FLATTER * abs(before)
        return (before + after) / 2 if flatter else self.rounding

    def _work(self, state: Floats) -> tuple[float, float]:
        """Return the work in J of the forces at the begin and at a state, on the way to it."""
        moved = state - self.base.state
        residual = self.points.near(state).residual
        return dot(self.comm, self.base.residual, moved), dot(self.comm, residual, moved)

    def cap_of(self, state: Floats, step: Floats) -> float:
        """Return the part of a step that stretch bounds and contact allow."""
        return self.model.largest_step(state, step, self._fraction)

    def lag(self, state: Floats) -> None:
        """Let friction have the normal forces of a state; energy and residual are by these."""
        self.points.forget()
        if self.model.contact is not None:
            self.model.contact.lag_friction(state)

    def record(self, kind: str, step: float) -> None:
        """Add a row to the history: the step from the base, and the part of it that was taken."""
        now = time.perf_counter()
        row = NewtonStep(
            self.model.load.largest,
            self.residual,
            self.base.energy,
            self.ladder.shift if kind == "newton" else 0.0,
            step,
            kind,
            self.iterations,
            now - self._clock,
        )
        self._clock = now
        self.history.append(row)
        if self._log is not None:
            self._log(row)

    def force_rounding(self) -> float:
        """Return the norm in N by which rounded positions may change the residual."""
        return 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size * self._stiffness


class Point:
    """A state with its energy in J, its residual in N, and its norm, each evaluated once."""

    def __init__(self, model: SkinModel, state: Floats) -> None:
        self._model, self.state = model, np.array(state)

    @cached_property
    def energy(self) -> float:
        """Energy, infinite outside the stretch bounds."""
        return self._model.energy(self.state)

    @cached_property
    def residual(self) -> Floats:
        """First variation, zero at fixed components."""
        return self._model.residual(self.state)

    @cached_property
    def size(self) -> float:
        """Norm of the residual."""
        return norm(self._model.skin.comm, self.residual)


class Points:
    """The last states of a model (collective)."""

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._known: list[Point] = []

    def forget(self) -> None:
        """Forget all: the model has another load, design or friction now."""
        self._known.clear()

    def same(self, one: Floats, two: Floats) -> bool:
        """Return whether two states are equal to the last bit, on all ranks."""
        return smallest(self._model.skin.comm, np.array_equal(one, two)) > 0

    def near(self, state: Floats) -> Point:
        """Return a point, of which what is asked for is evaluated while the model is as it is."""
        for place, known in enumerate(reversed(self._known), start=1):
            if self.same(known.state, state):
                self._known.append(self._known.pop(-place))
                return known
        self._known.append(Point(self._model, state))
        del self._known[:-KEPT]
        return self._known[-1]

    def at(self, state: Floats) -> Point:
        """Return a point that stays as it is, whatever becomes of the model."""
        found = self.near(state)
        assert found.energy is not None
        assert found.size is not None
        return found
