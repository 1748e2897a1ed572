"""The membrane's energy and stress against hand values, limits and exact logarithms."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from helpers.models import SIZE, affine, pressurize, sheet_model, spread_by_rounding
from helpers.scenes import TABLE_A, table
from mpi4py import MPI

from toros_fem.forms.kinematics import Strain
from toros_fem.forms.membrane import barrier, plain_log
from toros_fem.materials.sheet import Composite


def stress(stretch: float, other: float, c1: float, c2: float) -> float:
    """Nominal stress of material A by the formula of the reference tables."""
    mu = lam = 50e3
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    own = 2 * mu * (stretch - 1) / (1 - (stretch - 1) ** 2 / a)
    total = stretch + other - 2
    return own + lam * total / (1 - total**2 / b)


@pytest.mark.parametrize("stretches", [(1.3, 0.9), (1.2, 1.2), (0.8, 0.95), (1.0, 1.0)])
def test_energy_and_force_of_an_affine_sheet(
    alone: MPI.Comm, stretches: tuple[float, float]
) -> None:
    c1, c2 = 1.8, 2.0
    model = sheet_model(alone, Composite(fabric=TABLE_A, c1=c1, c2=c2, bending=None))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    pressurize(model, 0.0)
    one, two = stretches
    state = affine(model, np.array([[one, 0], [0, two], [0, 0]]))
    a, b, mu = 0.64, 1.0, 50e3
    psi = (
        -mu * a * np.log(1 - (one - 1) ** 2 / a)
        - mu * a * np.log(1 - (two - 1) ** 2 / a)
        - mu / 2 * b * np.log(1 - (one + two - 2) ** 2 / b)
    )
    assert model.energy(state) == pytest.approx(psi * 3e-4 * SIZE**2, rel=1e-12, abs=1e-16)
    force = model.skin.gather_vertices(model.residual(state).reshape(-1, 3))
    border = model.skin.pattern.points[:, 0] > SIZE * (1 - 1e-9)
    pull = force[border].sum(axis=0) / (3e-4 * SIZE)
    assert pull[0] == pytest.approx(stress(one, two, c1, c2), rel=1e-11, abs=1e-6)
    assert pull[1:] == pytest.approx([0, 0], abs=1e-6)


def test_stress_formula_agrees_with_the_tables() -> None:
    """The closed form the forces are held against, at the tables' printed digits."""
    for row in table("gent_uniaxial"):
        if row["mat"] != "A":
            continue
        one, two = float(row["stretch"]), float(row["lateral_stretch"])
        c1, c2 = float(row["c1"]), float(row["c2"])
        expected = float(row["nominal_stress_Pa"])
        slope = 1e-8 * 2e6  # what half a unit of the last digit of the stretch is worth
        assert stress(one, two, c1, c2) == pytest.approx(expected, rel=1e-6, abs=slope)
        assert stress(two, one, c1, c2) == pytest.approx(0, abs=slope)
    for row in table("gent_equibiaxial_planestrain"):
        if row["mat"] != "A":
            continue
        stretch = float(row["stretch"])
        for column, pair in (
            ("P11_equibiaxial_Pa", (stretch, stretch)),
            ("P11_strip_l2=1_Pa", (stretch, 1.0)),
            ("P22_strip_Pa", (1.0, stretch)),
        ):
            if row[column]:
                assert stress(*pair, 1.8, 2.0) == pytest.approx(float(row[column]), rel=1e-7)


def exact_density(stretches: tuple[float, float], c1: float, c2: float) -> float:
    """Eq. (1) for material A in N/m, with 50 digits."""
    with localcontext() as context:
        context.prec = 50
        one, two = (Decimal(stretch) - 1 for stretch in stretches)
        a, b = (Decimal(c1) - 1) ** 2, (Decimal(c2) - 1) ** 2
        shear = a * (1 - one**2 / a).ln() + a * (1 - two**2 / a).ln()
        whole = -TABLE_A.mu * float(shear) - TABLE_A.lam / 2 * float(
            b * (1 - (one + two) ** 2 / b).ln()
        )
        return TABLE_A.thickness * whole


@pytest.mark.parametrize("bound", [1.9, 10.0, 1e4, 1e5, 1e6, 1e8])
@pytest.mark.parametrize("strain", [1e-3, 0.03, 0.099, 0.101, 0.5])
def test_energy_keeps_its_digits_with_wide_bounds(
    alone: MPI.Comm, bound: float, strain: float
) -> None:
    """Also on both sides of where the logarithm becomes a series."""
    model = sheet_model(alone, Composite(fabric=TABLE_A, c1=bound, c2=bound, bending=None))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    one, two = 1 + strain, 1 - strain / 3
    energy = model.energy(affine(model, np.array([[one, 0], [0, two], [0, 0]])))
    expected = exact_density((one, two), bound, bound) * SIZE**2
    assert energy == pytest.approx(expected, rel=1e-11)


def test_rounding_of_the_energy_is_bounded(alone: MPI.Comm) -> None:
    """With any bounds, on states that differ by rounding: what Newton's line search relies on."""
    for bound in (1.9, 1e3, 1e6):
        model = sheet_model(alone, Composite(fabric=TABLE_A, c1=bound, c2=bound, bending=None))
        model.set_density(np.zeros(len(model.skin.owned_cells)))
        state = affine(model, np.array([[1.3, 0], [0, 0.95], [0, 0]]))
        assert 0 < spread_by_rounding(model, state) < model.energy_rounding()


def test_logarithm_turns_positive_again_far_outside() -> None:
    """Both stretches at 2.5 with c1 = 1.8: eq. (1) has a value, and no meaning.

    Both factors of the joined logarithm are negative there, so that their product is positive
    and the formula gives a finite energy. Only the stretches show that the state is infeasible.
    """
    c1, c2, stretch = 1.8, 10.0, 2.5
    factor = 1 - (stretch - 1) ** 2 / (c1 - 1) ** 2
    assert factor < 0
    alike = Strain([stretch**2, stretch**2, 0.0])
    density = float(barrier(alike, 1.0, 0.0, c1, c2, plain_log))
    assert density == pytest.approx(-((c1 - 1) ** 2) * math.log(factor**2), rel=1e-12)
    model = sheet_model(MPI.COMM_SELF, Composite(fabric=TABLE_A, c1=c1, c2=c2, bending=None))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    assert model.energy(affine(model, stretch * np.eye(3)[:, :2])) == np.inf
