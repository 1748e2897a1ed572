"""Equilibria of sheets that wrinkle: gradients, ranks, and what default settings leave as it is."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import affine, drawn, sheet_model
from helpers.scenes import TABLE_A
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.materials.sheet import Bending, Composite, Membrane
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.wrinkles import wrinkle_field
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Skin, sew
from toros_fem.meshes.sheet import rectangle

SIDE, PRESSURE = 0.04, 300.0
COMPOSITE = Composite(
    fabric=TABLE_A,
    reinforcement=replace(TABLE_A, young=10 * TABLE_A.young),
    c1=1.8,
    c2=2.0,
    bending=None,
    membrane=Membrane("tension-field", 1e-4),
)


def pillow(comm: MPI.Comm, composite: Composite) -> EquilibriumSolver:
    """The upper one of two sewn squares."""

    def place(flat: np.ndarray) -> np.ndarray:
        u, v = (np.pi * flat / SIDE).T
        lift = 0.05 * SIDE * np.sin(u) * np.sin(v)
        return np.column_stack([flat - SIDE / 2, np.where(lift < 1e-9, 0.0, lift)])

    pattern = rectangle(comm, SIDE, SIDE, SIDE / 6, "union-jack", place)
    seam = symmetry_plane(pattern, 2)
    fixed = seam.fixed
    x, y, _ = pattern.points.T
    middle = np.abs(y) < 1e-9
    fixed[middle & (np.abs(x) > 0.49 * SIDE), 1] = True
    fixed[(np.abs(x) < 1e-9) & (y < -0.49 * SIDE), 0] = True
    supports = Supports(fixed, planes=seam.planes)
    return EquilibriumSolver(
        sew(comm, pattern), composite, supports, NewtonOptions(tolerance=1e-12)
    )


@pytest.fixture(scope="module")
def solver(comm: MPI.Comm) -> EquilibriumSolver:
    return pillow(comm, COMPOSITE)


def density_of(skin: Skin) -> np.ndarray:
    values = np.random.default_rng(3).uniform(0.1, 0.9, len(skin.pattern.panel))
    return np.asarray(values[skin.owned_cells])


def test_same_shape_on_any_number_of_ranks(solver: EquilibriumSolver, comm: MPI.Comm) -> None:
    if comm.size == 1:
        pytest.skip("needs two ranks to compare with one")
    skin = solver.skin
    found = solver.solve(density_of(skin), PRESSURE)
    serial = pillow(MPI.COMM_SELF, COMPOSITE)
    expected = serial.solve(density_of(serial.skin), PRESSURE)
    field = wrinkle_field(solver, density_of(skin), found)
    alone = wrinkle_field(serial, density_of(serial.skin), expected)
    assert np.array_equal(field.state, alone.state)
    assert np.abs((field.flat * alone.flat).sum(axis=1)) == pytest.approx(
        (alone.state > 0).astype(float), abs=1e-6
    )


def test_line_families_are_refused(solver: EquilibriumSolver) -> None:
    with pytest.raises(ParameterError, match="line families take compression"):
        EquilibriumSolver(solver.skin, COMPOSITE, solver.model.supports, families=1)


@pytest.mark.parametrize("bending", [None, Bending()])
def test_default_is_eq_1_to_the_bit(alone: MPI.Comm, bending: Bending | None) -> None:
    """No membrane given, the default one, and one with another unused residual stiffness."""
    plain = replace(COMPOSITE, membrane=Membrane(), bending=bending)
    composites = (
        Composite(fabric=plain.fabric, reinforcement=plain.reinforcement, c1=1.8, c2=2.0,
                  bending=bending),
        plain,
        replace(plain, membrane=Membrane(residual_stiffness=1e-2)),
    )  # fmt: skip
    seen = []
    for composite in composites:
        model = sheet_model(alone, composite)
        model.set_density(density_of(model.skin))
        state = affine(model, np.array([[1.1, 0.05], [0, 0.9], [0.02, 0.0]]))
        state += 1e-4 * drawn(model, 2)
        seen.append((model.energy(state), model.residual(state)))
    for energy, residual in seen[1:]:
        assert energy == seen[0][0]
        assert np.array_equal(residual, seen[0][1])
