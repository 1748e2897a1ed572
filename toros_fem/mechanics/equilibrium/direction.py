"""Newton's step: the tangent, the linear solve, and the part of the step that is allowed."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.mechanics.equilibrium.iteration import SolveState
from toros_fem.mechanics.equilibrium.petsc_options import PREFIX

# Modified Newton steps are taken where at most this number of them promises to finish.
MODIFIED_STEPS = 3
# Fraction of the residual that a modified step may leave, and fraction of the predicted decrease
# of the energy that the first one must reach.
MODIFIED_RATE, MODIFIED_GAIN = 0.2, 0.2
# Krylov iterations with older factors are taken where they leave at most this fraction of the
# residual after KRYLOV_COST √n iterations: a factorisation of n unknowns costs some 0.05 √n solves.
INEXACT, KRYLOV_COST = 1e-2, 0.03
# With friction, steps with the whole derivative begin at the residual COUPLED over the load. GMRES
# leaves the fraction COUPLED_LEFT, and the step at most COUPLED_RATE of the residual.
COUPLED, COUPLED_LEFT, COUPLED_RATE, COUPLED_ITERATIONS = 1e-2, 1e-3, 0.3, 60


class Direction:
    """Hooks of the SNES, its KSP and its line search that make Newton's step.

    Attributes:
        newton, own_factors: Whether SNES and preconditioner are those of this package, and no
            option chooses others.
        reuses: Whether both are, so that older factors may serve.
    """

    def __init__(self, at: SolveState, snes: PETSc.SNES) -> None:
        self.at, self._snes, self._ksp = at, snes, snes.getKSP()
        self.newton = snes.getType() == PETSc.SNES.Type.NEWTONLS
        self.own_factors = self._ksp.getPC().getType() == PETSc.PC.Type.PYTHON
        self.reuses = self.newton and self.own_factors
        limited = PETSc.Options(PREFIX).hasName("ksp_max_it")
        self._limits_krylov = self.own_factors and not limited
        unknowns = at.model.space.dofmap.index_map.size_global
        self._krylov = round(KRYLOV_COST * unknowns**0.5)
        self._cg = self._ksp.getType() == PETSc.KSP.Type.CG
        self._rhs_size = 0.0

    def tangent(self, snes: PETSc.SNES, x: PETSc.Vec, _: PETSc.Mat, __: PETSc.Mat) -> None:
        """Assemble the tangent, or leave that of an older state for a modified step."""
        at = self.at
        usable = at.factor.usable and self.reuses
        promised = at.predict or at.residual * at.rate**MODIFIED_STEPS <= at.tolerance
        at.first, at.predict, at.rate = at.predict, False, np.inf
        at.ladder.renew = False
        if usable and promised:
            at.kind = "modified"
            return
        at.assemble(np.array(x.array_r))
        at.factor.fill()
        coupled = usable and at.model.slides and at.residual <= COUPLED
        at.kind = "coupled" if coupled else "cg" if usable and self._krylov >= 2 else "newton"
        at.factor.couple(at.base.state if coupled else None)
        at.ladder.renew = at.kind == "newton"
        if self._limits_krylov:
            self._ksp.setTolerances(max_it=COUPLED_ITERATIONS if coupled else max(self._krylov, 1))

    def end_iteration(self, ksp: PETSc.KSP, count: int, size: float) -> int:
        """Test the linear solve, and its first direction for negative curvature.

        PETSc's CG looks for a change of its sign only.
        """
        reasons = PETSc.KSP.ConvergedReason
        if self.at.kind == "modified":  # factors alone make the step, in `limit`
            return int(reasons.CONVERGED_ITS)
        relative, _, _, limit = ksp.getTolerances()
        if count == 0:
            self._rhs_size = size
        left = size / self._rhs_size if self._rhs_size > 0 else 0.0
        if not np.isfinite(left):
            return int(reasons.DIVERGED_NANORINF)
        if count == 1 and self._cg:
            solved = dot(self.at.comm, ksp.getRhs().array_r, ksp.getSolution().array_r)
            if not solved > 0:
                return int(reasons.DIVERGED_INDEFINITE_MAT)
        if left <= relative:
            return int(reasons.CONVERGED_RTOL)
        return int(reasons.DIVERGED_MAX_IT if count >= limit else reasons.ITERATING)

    def limit(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Renew a step of older factors that does not serve; shorten it by bounds and contact."""
        at = self.at
        at.iterations = self._ksp.getIterationNumber()
        if at.kind == "modified":
            y.array_w[:] = at.factor.solve(at.base.residual)
        while at.kind != "newton" and not self._serves(y):
            self._renew(y)
        if at.kind == "newton":
            self._descend(y)
            self._shorten(y)
        at.step = np.array(y.array_r)
        return True

    def _serves(self, y: PETSc.Vec) -> bool:
        """Return whether a step by older factors is good enough; it is shortened then."""
        at, base = self.at, self.at.base
        size = norm(at.comm, y.array_r)
        if self._ksp.getConvergedReason() < 0 or not np.isfinite(size):
            return False
        self._shorten(y)
        if at.kind == "cg":
            return True
        if at.cap < 1 and not at.first:
            return False
        trial = base.state - y.array_r
        if at.kind == "coupled":
            at.lag(trial)
            return at.points.at(trial).size <= COUPLED_RATE * base.size
        change = at.change(trial)
        if at.first:
            return change <= -MODIFIED_GAIN / 2 * dot(at.comm, base.residual, y.array_r)
        return change <= at.rounding and at.points.at(trial).size <= MODIFIED_RATE * base.size

    def _renew(self, y: PETSc.Vec) -> None:
        """Solve for the step anew: with the tangent of this state, then with its factors."""
        at = self.at
        if at.kind == "coupled":
            at.lag(at.base.state)
            at.factor.couple(None)
        if at.kind == "modified":
            at.assemble(at.base.state)
        at.kind = "cg" if at.kind == "modified" and self._krylov >= 2 else "newton"
        self._solve_anew(y, 0.0)

    def _solve_anew(self, y: PETSc.Vec, shift: float) -> None:
        at = self.at
        at.factor.fill(shift)
        at.ladder.renew = at.kind == "newton"
        self._ksp.solve(self._snes.getFunction()[0], y)
        at.iterations += self._ksp.getIterationNumber()

    def back(self, rhs: Floats) -> Floats:
        """Solve with the factors of the last step, or as an option wants it."""
        at = self.at
        if self.reuses:
            return at.factor.solve(rhs)
        right, solution = at.factor.matrix.createVecs()
        right.array[:] = rhs
        self._ksp.solve(right, solution)
        return np.array(solution.array_r)

    def _descend(self, y: PETSc.Vec) -> None:
        """Let the shift grow until the step goes downhill."""
        at, ksp, reasons = self.at, self._ksp, PETSc.KSP.ConvergedReason
        while True:
            reason = ksp.getConvergedReason()
            solved = reason > 0 or reason == reasons.DIVERGED_MAX_IT
            if solved and dot(at.comm, at.base.residual, y.array_r) > 0:
                return
            if at.ladder.exhausted:
                y.set(0.0)
                return
            at.ladder.enlarge()
            self._solve_anew(y, at.ladder.shift)

    def _shorten(self, y: PETSc.Vec) -> None:
        """Take the part of the step that stretch bounds and contact allow."""
        at = self.at
        at.longest = largest(at.comm, float(np.abs(y.array_r).max(initial=0.0)))
        at.cap = at.cap_of(at.base.state, -y.array_r)
        y.scale(at.cap)
