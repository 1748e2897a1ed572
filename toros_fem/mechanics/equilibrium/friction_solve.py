"""Linear systems with the whole derivative of a skin with friction."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor

# Residual over the right-hand side at which GMRES ends, that is enough, and its largest number of
# iterations.
TOLERANCE, ALLOWED, ITERATIONS = 1e-11, 1e-8, 200


def solve_with_friction(
    model: SkinModel, factor: TangentFactor, state: Floats, rhs: Floats, *, transposed: bool
) -> Floats:
    """Solve J y = rhs or its transpose, J the tangent and friction's derivative (collective).

    J is not symmetric. GMRES solves, with the factors of the tangent on its right, so that the
    residual is the true one (Saad & Schultz 1986).

    Raises:
        NoEquilibriumError: The iteration does not converge.
    """

    def multiply(_: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        change = np.array(x.array_r)
        coupled = model.friction_coupling(state, change, transposed=transposed)
        y.array_w[:] = factor.multiply(change) + coupled

    def precondition(_: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = factor.solve(np.array(x.array_r))

    size = (model.size_local, model.space.dofmap.index_map.size_global)
    comm = model.skin.comm
    matrix = PETSc.Mat().createPython((size, size), SimpleNamespace(mult=multiply), comm=comm)
    matrix.setUp()
    ksp = PETSc.KSP().create(comm)
    ksp.setOperators(matrix)
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.setGMRESRestart(ITERATIONS)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setTolerances(rtol=TOLERANCE, atol=0.0, max_it=ITERATIONS)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(SimpleNamespace(apply=precondition))
    right, solution = matrix.createVecs()
    right.array[:] = rhs
    ksp.solve(right, solution)
    found, whole = np.array(solution.array_r), norm(comm, rhs)
    left = ksp.getResidualNorm() / whole if whole > 0 else 0.0
    for held in (ksp, matrix, right, solution):
        held.destroy()
    if not left <= ALLOWED:
        raise NoEquilibriumError(
            f"the linear solve with friction leaves {left:.1g} of its right-hand side after "
            f"{ITERATIONS} iterations: the equilibrium is near to slipping as a whole. "
            "Shorten the step of the path, or lower the friction."
        )
    return found
