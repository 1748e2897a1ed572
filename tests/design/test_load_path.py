"""Paths of loads and the gradients of functionals of several of their steps."""

import numpy as np
import pytest
from helpers.scenes import taylor_rates
from mpi4py import MPI

from toros_fem._mpi import dot, total
from toros_fem.density.field import random_density
from toros_fem.design.load_path import LoadPath, LoadStep
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.errors import ParameterError
from toros_fem.meshes import Skin


def test_taylor_of_two_steps(tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm) -> None:
    path = LoadPath(tube_solver, [LoadStep(2e3), LoadStep(5e3)])
    density = random_density(tube, 2, spread=0.3)
    shape = tube_solver.model.positions(tube_solver.model.assembled).shape
    weights = [np.cos(np.arange(3.0) + k) * np.ones(shape) * 1e-3 for k in range(2)]
    weights = [w * tube.pattern.points[tube.owned_vertices] for w in weights]
    base = path.solve(density)
    found = path.gradient(density, base, weights)
    change = 0.1 * np.cos(1.0 * tube.owned_cells)
    raised = np.array([[100.0], [-200.0]])
    slope = dot(comm, found.density, change) + float((found.pressures * raised).sum())

    def value(step: float) -> float:
        there = path.solve(density + step * change, np.array([[2e3], [5e3]]) + step * raised, base)
        return total(
            comm, sum((w * e.positions).sum() for w, e in zip(weights, there, strict=True))
        )

    assert taylor_rates(value, slope, 0.5) == pytest.approx(2, abs=0.02)


def test_a_step_that_does_not_matter_has_no_gradient(
    tube: Skin, tube_solver: EquilibriumSolver
) -> None:
    path = LoadPath(tube_solver, [LoadStep(2e3), LoadStep(4e3)])
    density = np.full(len(tube.owned_cells), 0.2)
    base = path.solve(density)
    slope = np.ones_like(base[0].positions)
    found = path.gradient(density, base, [slope, None])
    assert found.pressures[0, 0] != 0
    assert found.pressures[1, 0] == 0


def test_what_does_not_fit_is_refused(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(tube.owned_cells))
    with pytest.raises(ParameterError, match="at least one"):
        LoadPath(tube_solver, [])
    path = LoadPath(tube_solver, [LoadStep(2e3)])
    with pytest.raises(ParameterError, match=r"they must be \(1, 1\)"):
        path.solve(density, np.ones((2, 1)))
    with pytest.raises(ParameterError, match="the path has 1 steps"):
        path.gradient(density, path.solve(density), [])
