"""Newton's method on a model's energy inside a PETSc SNES, at given load and density."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.equilibrium.linear_solver import PREFIX, TangentFactor
from toros_fem.equilibrium.newton import NewtonStep, RegularisedNewton
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.mechanics.model import SkinModel


class SnesSolver:
    """A SNES that finds stable equilibria of a model from near ones; options have prefix "toros_".

    Attributes:
        factor: The factorised tangent, after success that at the equilibrium.
        newton: The solver inside, with the history of its steps.
        max_steps: Newton steps at most.

    Args:
        model: The scene.
        options: How hard to try.
        log: Called with every row of the history as it comes, on every rank.
    """

    def __init__(
        self,
        model: SkinModel,
        options: NewtonOptions,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self._model = model
        self.factor = TangentFactor(model)
        self.newton = RegularisedNewton(model, self.factor, options, log)
        self._x, residual = self.factor.matrix.createVecs()
        snes = PETSc.SNES().create(model.skin.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setObjective(lambda _, x: model.energy(x.array_r))
        snes.setFunction(self._residual, residual)
        snes.setJacobian(self._tangent, self.factor.matrix)
        snes.setKSP(self.factor.ksp)
        snes.setTolerances(rtol=options.tolerance, max_it=options.max_steps)
        snes.setType(PETSc.SNES.Type.PYTHON)
        snes.setPythonContext(self.newton)
        snes.setFromOptions()
        self._snes = snes
        self.max_steps: int = snes.getTolerances()[3]

    def __call__(self, start: Floats, max_steps: int | None = None) -> tuple[Floats, int, int]:
        """One solve: the state, its converged reason, and how many rows the history grew by."""
        self._snes.setTolerances(max_it=max_steps or self.max_steps)
        self._x.array[:] = start
        rows = len(self.newton.history)
        self._snes.solve(None, self._x)
        state = self.tried
        outcome = int(self._snes.getConvergedReason())
        steps = len(self.newton.history) - rows
        if outcome > 0 and steps == 0 and not self.newton.stable(state):
            # Another type of SNES, chosen by an option, may have stopped at a saddle.
            outcome = int(PETSc.SNES.ConvergedReason.DIVERGED_INNER)
        return state, outcome, steps

    @property
    def tried(self) -> Floats:
        """Where the last solve ended, whether or not it converged."""
        return np.array(self._x.array_r)

    def _residual(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array_w[:] = self._model.residual(x.array_r)

    def _tangent(self, _: PETSc.SNES, x: PETSc.Vec, __: PETSc.Mat, ___: PETSc.Mat) -> None:
        self.factor.assemble(x.array_r)
        self.factor.fill(0.0)
