"""Krylov methods with a neighbouring tangent's factors, on one and on several ranks."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.mechanics.equilibrium.krylov import CGResult, conjugate_gradients, gmres
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import Skin

PRESSURE = 2e3


@pytest.fixture(scope="module")
def factor(tube: Skin, tube_solver: EquilibriumSolver) -> TangentFactor:
    """The tangent of a design, with the factors of another."""
    model = tube_solver.model
    model.set_load(Load(np.array([PRESSURE])))
    state = tube_solver.solve(np.full(len(tube.owned_cells), 0.3), PRESSURE).state
    model.set_density(np.full(len(tube.owned_cells), 0.3))
    found = TangentFactor(model)
    found.assemble(state)
    assert found.factorise()
    model.set_density(np.where(tube.owned_cells % 2, 0.2, 0.4))
    found.assemble(state)
    return found


def solved(comm: MPI.Comm, factor: TangentFactor, rhs: np.ndarray, *limits: float) -> CGResult:
    tolerance, most = limits
    return conjugate_gradients(
        comm, factor.multiply, factor.solve, rhs, tolerance, max_iterations=int(most)
    )


def test_the_residual_is_that_of_the_solution(
    tube_solver: EquilibriumSolver, factor: TangentFactor, comm: MPI.Comm
) -> None:
    model = tube_solver.model
    rhs = model.volume_gradient(model.assembled)
    found = solved(comm, factor, rhs, 1e-8, 50)
    assert found.positive
    assert 3 < found.iterations < 30
    left = norm(comm, rhs - factor.multiply(found.solution)) / norm(comm, rhs)
    assert left == pytest.approx(found.residual, rel=1e-3)
    assert left <= 1e-8
    exact = factor.solve(rhs)
    assert norm(comm, found.solution - exact) > 1e-3 * norm(comm, exact), "factors of another"


def test_few_iterations_leave_a_larger_residual(
    tube_solver: EquilibriumSolver, factor: TangentFactor, comm: MPI.Comm
) -> None:
    model = tube_solver.model
    rhs = model.volume_gradient(model.assembled)
    found = solved(comm, factor, rhs, 1e-8, 2)
    assert found.iterations == 2
    assert 1e-8 < found.residual < 1
    nothing = solved(comm, factor, 0 * rhs, 1e-8, 2)
    assert nothing.iterations == 0
    assert not nothing.solution.any()


def test_negative_curvature_is_told(
    tube_solver: EquilibriumSolver, factor: TangentFactor, comm: MPI.Comm
) -> None:
    model = tube_solver.model
    rhs = model.volume_gradient(model.assembled)
    found = conjugate_gradients(
        comm, lambda x: -factor.multiply(x), factor.solve, rhs, 1e-8, max_iterations=20
    )
    assert not found.positive
    assert found.iterations == 1
    assert not found.solution.any()


def test_gmres_solves_without_symmetry(
    tube_solver: EquilibriumSolver, factor: TangentFactor, comm: MPI.Comm
) -> None:
    model = tube_solver.model
    rhs = model.volume_gradient(model.assembled)
    sign = np.where(model.skin.owned_vertices % 2, 0.1, -0.1)

    def multiply(x: np.ndarray) -> np.ndarray:
        product = factor.multiply(x)
        turned = np.roll(model.positions(product), 1, axis=1) * sign[:, None]
        model.positions(product)[:] += turned
        return product * model.free

    solution, left = gmres(comm, multiply, factor.solve, rhs, 1e-10, 60)
    assert left <= 1e-10
    assert norm(comm, rhs - multiply(solution)) <= 2e-10 * norm(comm, rhs)
    assert gmres(comm, multiply, factor.solve, rhs, 1e-10, 3)[1] > 1e-10
    assert not gmres(comm, multiply, factor.solve, 0 * rhs, 1e-10, 3)[0].any()
