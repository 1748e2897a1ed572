"""Newton's method on a model's energy inside a PETSc SNES, at the load and density that are set."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.linear_solver import PREFIX, TangentFactor
from toros_fem.mechanics.equilibrium.newton import NewtonResult, NewtonStep, RegularisedNewton
from toros_fem.mechanics.equilibrium.options import NewtonOptions

# Residual over the applied load at which a trial's objective is known well enough.
TRIAL_TOLERANCE = 1e-6


class SnesSolver:
    """A SNES that finds stable equilibria of a model near a start; its options' prefix is "toros_".

    Attributes:
        model: As given.
        factor: The factorised tangent; after success it is that at the equilibrium.
        newton: The method inside.
        tolerance: Residual over the applied load at which a state is an equilibrium.
        max_steps: Largest number of Newton steps.

    Args:
        model: The skin's model.
        options: Tolerance and limits.
        log: Called with every row of the history as it comes, on every rank.
    """

    def __init__(
        self,
        model: SkinModel,
        options: NewtonOptions,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self.model = model
        self.factor = TangentFactor(model)
        self.newton = RegularisedNewton(model, self.factor, options, log)
        self._context = _Callbacks(self)
        self._x, residual = self.factor.matrix.createVecs()
        snes = PETSc.SNES().create(model.skin.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setObjective(self._context.energy)
        snes.setFunction(self._context.residual, residual)
        snes.setJacobian(self._context.tangent, self.factor.matrix)
        snes.setKSP(self.factor.ksp)
        snes.setTolerances(rtol=options.tolerance, max_it=options.max_steps)
        snes.setType(PETSc.SNES.Type.PYTHON)
        snes.setPythonContext(self._context)
        snes.setFromOptions()
        self._snes = snes
        self.tolerance: float = snes.getTolerances()[0]
        self.max_steps: int = snes.getTolerances()[3]

    def __call__(
        self,
        start: Floats,
        *,
        near: bool = False,
        max_steps: int | None = None,
        trial: bool = False,
    ) -> NewtonResult:
        """Solve once from a start (collective).

        Args:
            start: Owned unknowns.
            near: Whether the start is the equilibrium of a neighbouring design or load.
            max_steps: Largest number of Newton steps; None takes that of the options.
            trial: Whether TRIAL_TOLERANCE is enough, without proof that the state is stable.
        """
        tolerance = max(self.tolerance, TRIAL_TOLERANCE) if trial else self.tolerance
        self._snes.setTolerances(rtol=tolerance, max_it=max_steps or self.max_steps)
        self._x.array[:] = start
        self._context.near, self._context.finish = near, not trial
        self._context.result = None
        self._snes.solve(None, self._x)
        found = self._context.result
        if found is not None:
            return replace(found, outcome=int(self._snes.getConvergedReason()))
        # Another type of SNES, chosen by an option, may have stopped at a saddle.
        state = np.array(self._x.array_r)
        outcome = int(self._snes.getConvergedReason())
        if outcome > 0 and not self.newton.stable(state):
            outcome = int(PETSc.SNES.ConvergedReason.DIVERGED_INNER)
        return NewtonResult(state, outcome, 0, (), False)


class _Callbacks:
    """What the SNES calls: energy, residual, tangent, and as its type "python" the whole solve.

    PETSc holds them out of sight of Python's garbage collector, with some versions for ever, and
    on several ranks beyond the end of the solver: hence the weak reference.
    """

    def __init__(self, solver: SnesSolver) -> None:
        self._solver = weakref.ref(solver)
        self.near, self.finish = False, True
        self.result: NewtonResult | None = None

    def _alive(self) -> SnesSolver:
        solver = self._solver()
        assert solver is not None
        return solver

    def energy(self, _: PETSc.SNES, x: PETSc.Vec) -> float:
        """Return the energy, as SNES requests it."""
        return self._alive().model.energy(x.array_r)

    def residual(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """Compute the residual."""
        f.array_w[:] = self._alive().model.residual(x.array_r)

    def tangent(self, _: PETSc.SNES, x: PETSc.Vec, __: PETSc.Mat, ___: PETSc.Mat) -> None:
        """Assemble the tangent."""
        factor = self._alive().factor
        factor.assemble(x.array_r)
        factor.fill(0.0)

    def solve(self, snes: PETSc.SNES, _: PETSc.Vec | None, x: PETSc.Vec) -> None:
        """Solve by `RegularisedNewton`."""
        newton = self._alive().newton
        tolerance, _, _, max_steps = snes.getTolerances()

        def monitor(step: int, size: float) -> None:
            snes.setIterationNumber(step)
            snes.setFunctionNorm(size)
            snes.monitor(step, size)

        self.result = newton.minimise(
            x.array.copy(), tolerance, max_steps, self.near, self.finish, monitor
        )
        x.array[:] = self.result.state
        snes.setConvergedReason(self.result.outcome)


class Attempts:
    """Sequence of solves; each uses the factors of the one before if that converged.

    Attributes:
        history: Rows of all of them.
        last: Where the last one ended.
        definite: Whether none of them needed a shift or met a saddle.

    Args:
        solver: The SNES.
        near: Whether the first start is the equilibrium of a neighbouring design or load.
    """

    def __init__(self, solver: SnesSolver, *, near: bool = False) -> None:
        self._solver, self._near = solver, near
        self._factorisations = solver.factor.count
        self.history: list[NewtonStep] = []
        self.last: Floats | None = None
        self.definite = True

    def __call__(
        self, start: Floats, max_steps: int | None = None, *, trial: bool = False
    ) -> NewtonResult:
        """Solve once more; the arguments are those of `SnesSolver` (collective)."""
        found = self._solver(start, near=self._near, max_steps=max_steps, trial=trial)
        self._near = found.converged
        self.history.extend(found.history)
        self.definite &= found.definite
        self.last = found.state
        return found

    @property
    def steps(self) -> int:
        """Number of Newton steps, each with the tangent at its state."""
        return sum(row.step > 0 and not row.modified for row in self.history)

    @property
    def modified_steps(self) -> int:
        """Number of modified Newton steps, with an older tangent."""
        return sum(row.modified for row in self.history)

    @property
    def factorisations(self) -> int:
        """Number of factorisations so far, retries with a shift included."""
        return self._solver.factor.count - self._factorisations
