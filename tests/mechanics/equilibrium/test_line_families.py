"""Equilibria of relaxed designs: forces by hand, and continuation."""

from functools import partial

import numpy as np
import pytest
from helpers.models import line_design
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI
from scipy.optimize import brentq

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.designs import LineDesign
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Skin, sew

PRESSURE = 5e3


@pytest.fixture(scope="module")
def solver(short_tube: Skin) -> EquilibriumSolver:
    options = NewtonOptions(tolerance=1e-12)
    return solver_on_base(short_tube, options=options, design=partial(LineDesign, families=2))


def test_lines_along_hold_a_strip(alone: MPI.Comm) -> None:
    """A strip that is pulled along one family: force and lateral stretch by hand."""
    size, pull, share = 0.02, 1.3, 0.25
    pattern = square(n=6, size=size)
    points = pattern.points
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 2], fixed[0, 1] = True, True
    pulled = points[:, 0] > size * (1 - 1e-9)
    fixed[(points[:, 0] < 1e-9) | pulled, 0] = True
    supports = Supports(fixed, displacement=np.where(pulled[:, None], [(pull - 1) * size, 0, 0], 0))
    skin, composite = sew(alone, pattern), Composite(bending=None)
    solver = EquilibriumSolver(skin, composite, supports, design=partial(LineDesign, families=1))
    result = solver.solve(np.tile([0.0, share, 2.0, 0.0], (len(skin.owned_cells), 1)), 0.0)
    a, b = (composite.c1 - 1) ** 2, (composite.c2 - 1) ** 2
    fabric = composite.fabric

    def stress(one: float, two: float) -> float:
        shear = 2 * fabric.mu * (one - 1) / (1 - (one - 1) ** 2 / a)
        return shear + fabric.lam * (one + two - 2) / (1 - (one + two - 2) ** 2 / b)

    lateral = brentq(lambda two: stress(two, pull), 0.5, 1.0, xtol=1e-14)
    found = skin.gather_vertices(result.positions)
    assert found / size == pytest.approx(points * [pull, lateral, 0] / size, abs=1e-8)
    force = solver.reactions(result)[pulled, 0].sum()
    by_hand = fabric.thickness * stress(pull, lateral) / (1 - share)
    by_hand += share * composite.reinforcement.membrane_stiffness * (pull - 1)
    assert force == pytest.approx(by_hand * size, rel=1e-7)


def test_continuation_in_load_ends_at_the_same_shape(
    solver: EquilibriumSolver, short_tube: Skin
) -> None:
    one, two = line_design(short_tube, 2, 5), line_design(short_tube, 2, 8)
    design = partial(LineDesign, families=2)
    few = solver_on_base(short_tube, options=NewtonOptions(max_steps=2), design=design)
    near = few.solve(two, PRESSURE)
    for design_of, found in ((two, near), (one, few.solve(one, PRESSURE, start=near))):
        expected = solver.solve(design_of, PRESSURE).state
        off = norm(short_tube.comm, found.state - expected)
        assert off < 1e-7 * norm(short_tube.comm, expected)
        assert found.history[0].pressure == PRESSURE
        assert min(row.pressure for row in found.history) < PRESSURE, "the load was raised"
