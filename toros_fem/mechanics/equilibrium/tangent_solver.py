"""Linear systems with the tangent of a skin at one of its equilibria."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import norm, smallest
from toros_fem.base.validation import require_kind
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.linear_solver import ShiftedCholesky
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.path import PathPoint, motion_to
from toros_fem.mechanics.skin.load import Load

# With friction, residual over the right-hand side at which GMRES ends, that is enough, and its
# largest number of iterations.
TOLERANCE, ALLOWED, ITERATIONS = 1e-11, 1e-8, 200


class TangentSolver:
    """Solver for linear systems with the tangent at equilibria of a skin.

    Attributes:
        skin, model: The skin, and its model.
    """

    def __init__(
        self, model: SkinModel, options: NewtonOptions, log: Callable[[NewtonStep], None] | None
    ) -> None:
        self.skin, self.model = model.skin, model
        self._newton = Newton(model, options, log)
        self._factor = self._newton.factor
        self._at: Equilibrium | None = None  # where the tangent is factorised

    def tangent_at(self, at: Equilibrium) -> None:
        """Factorise the tangent at an equilibrium, if it is not that already (collective).

        Raises:
            ParameterError: It is not complete; or its tangent is not positive definite, as that of
                another solver.
        """
        require_kind("at", at, Equilibrium, "an Equilibrium of this solver")
        if at is self._at:
            return
        fits = at.complete and at.state.shape == (self.model.size_local,)
        stable = smallest(self.skin.comm, fits) > 0
        if stable:
            self._set(at.density, at.load, at.begin, at.state)
            stable = self._newton.stable(at.state)
        if not stable:
            raise ParameterError(
                "the state is no stable equilibrium of this solver: finish a trial first, and ask "
                "the solver that found it."
            )
        self._at = at

    def forget(self) -> None:
        """Forget where the tangent is factorised: the model is used for something else now."""
        self._at = None

    @property
    def linear_solver(self) -> str:
        """What factorises the tangent, on which ranks or threads."""
        return self._factor.describe()

    def solve_tangent(self, rhs: Floats, at: Equilibrium, *, adjoint: bool = False) -> Floats:
        """Solve K y = rhs with the tangent at an equilibrium, zero at fixed components.

        This is the adjoint solve of eq. (19). Without friction K is symmetric. With friction GMRES
        solves, with the factors of the symmetric part; `adjoint` solves with the transpose, since
        normal forces change friction, and friction does not change them. The tangent is factorised
        again if another solve came between.

        Raises:
            ParameterError: As of `tangent_at`; or an adjoint through friction on free bodies is
                asked for.
            NoEquilibriumError: With friction: the iteration does not converge.
        """
        self.tangent_at(at)
        rhs, model = rhs * self.model.free, self.model
        if not model.slides:
            return self._factor.solve(rhs)
        if adjoint and model.free_bodies:
            raise ParameterError(
                "there is no adjoint through friction on free bodies; hold or move the bodies, or "
                "leave the friction out."
            )
        return self._solve_with_friction(rhs, at.state, transposed=adjoint)

    def _solve_with_friction(self, rhs: Floats, state: Floats, *, transposed: bool) -> Floats:
        """Solve J y = rhs or its transpose, J the tangent and friction's derivative (collective).

        J is not symmetric. GMRES solves, with the factors of the tangent on its right, so that the
        residual is the true one (Saad & Schultz 1986).
        """
        comm, factor, ladder = self.skin.comm, self._factor, self._newton.ladder
        factor.fill()
        factor.couple(state, transposed=transposed)
        ladder.renew = False
        ksp = PETSc.KSP().create(comm)
        ksp.setOperators(factor.matrix)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(ITERATIONS)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setTolerances(rtol=TOLERANCE, atol=0.0, max_it=ITERATIONS)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(ShiftedCholesky(ladder))
        right, solution = factor.matrix.createVecs()
        right.array[:] = rhs
        ksp.solve(right, solution)
        factor.couple(None)
        found, whole = np.array(solution.array_r), norm(comm, rhs)
        left = ksp.getResidualNorm() / whole if whole > 0 else 0.0
        for held in (ksp, right, solution):
            held.destroy()
        if not left <= ALLOWED:
            raise NoEquilibriumError(
                f"the linear solve with friction leaves {left:.1g} of its right-hand side after "
                f"{ITERATIONS} iterations: the equilibrium is near to slipping as a whole. "
                "Shorten the step of the path, or lower the friction."
            )
        return found

    def motion_to(self, density: Floats, load: Load, at: Equilibrium) -> Floats:
        """Return the motion to another design and load that the tangent predicts (collective).

        Supports and bodies stay, and there is no friction. It is 0 where the equilibrium is outside
        the stretch bounds of the other design.
        """
        self.tangent_at(at)
        return motion_to(self.model, self._factor, at.point, PathPoint(density, load, at.state))

    def reactions(self, at: Equilibrium) -> Floats:
        """Return the forces in N by which the supports pull at all vertices, (n, 3) (collective).

        They are zero at free components.
        """
        self.tangent_at(at)
        return self.skin.gather_vertices(self.model.positions(self.model.reaction(at.state)))

    def _set(self, density: Floats, load: Load, begin: Floats | None, state: Floats) -> None:
        """Let the model have density, load and friction of a state."""
        self.forget()
        self.model.set_density(density)
        self.model.set_load(load)
        contact = self.model.contact
        if contact is not None:
            contact.begin_step(begin, load)
            contact.lag_friction(state)
