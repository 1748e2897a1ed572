"""The tension field's energy, natural width and tangent against hand values and differences."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ufl
from helpers.models import SIZE, affine, pressurize, sheet_model
from helpers.scenes import TABLE_A
from mpi4py import MPI
from scipy.optimize import minimize_scalar

from toros_fem.base.errors import ParameterError
from toros_fem.forms.membrane import natural_narrowing
from toros_fem.materials.sheet import Bladder, Composite, Knit, Membrane
from toros_fem.mechanics.terms.model import SkinModel

RESIDUAL = 1e-3


COMPOSITE = Composite(
    fabric=TABLE_A,
    reinforcement=replace(TABLE_A, young=10 * TABLE_A.young, poisson=0.2),
    c1=1.8,
    c2=2.0,
    bending=None,
    membrane=Membrane("tension-field", RESIDUAL),
)


def sheet(comm: MPI.Comm, composite: Composite = COMPOSITE) -> SkinModel:
    model = sheet_model(comm, composite)
    density = np.random.default_rng(3).uniform(0.1, 0.9, len(model.skin.pattern.panel))
    model.set_density(density[model.skin.owned_cells])
    pressurize(model, 0.0)
    return model


def uniaxial(one: float, two: float) -> float:
    """Eq. (1) for material A per flat area in N/m."""
    x, y, a, b = one - 1, two - 1, 0.64, 1.0
    log = -a * np.log(1 - x * x / a) - a * np.log(1 - y * y / a)
    return 15 * float(log - b / 2 * np.log(1 - (x + y) ** 2 / b))


@pytest.mark.parametrize("stretches", [(1.3, 0.95), (1.3, 0.5), (1.02, 0.1), (0.9, 0.3)])
def test_energy_is_the_least_over_the_width(
    alone: MPI.Comm, stretches: tuple[float, float]
) -> None:
    model = sheet_model(alone, replace(COMPOSITE, membrane=Membrane("tension-field", 1e-9)))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    one, two = stretches
    found = minimize_scalar(
        lambda width: uniaxial(one, width), bounds=(max(two, 0.8), 1.0), method="bounded",
        options={"xatol": 1e-10},
    )  # fmt: skip
    expected = min(found.fun, uniaxial(one, max(two, 0.8))) if one > 1 else 0.0
    quadratic = 30 * ((one - 1) ** 2 + (two - 1) ** 2)  # at most, times the residual stiffness
    energy = model.energy(affine(model, np.diag([one, two, 1.0])[:, :2])) / SIZE**2
    assert energy == pytest.approx(expected, rel=1e-8, abs=2e-9 * quadratic)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("bounds", [(1.8, 2.0), (1.9, 1.9), (1e5, 1e5)])
@pytest.mark.parametrize("x", [0.0, 1e-9, 0.02, 0.7])
def test_natural_width_has_no_stress_across(
    poisson: float, bounds: tuple[float, float], x: float
) -> None:
    mu, lam = 1.0, 2 * poisson / (1 - poisson)
    y = float(natural_narrowing(ufl.as_ufl(x), mu, lam, *bounds))
    a, b = ((c - 1) ** 2 for c in bounds)
    across = 2 * mu * y / (1 - y * y / a)
    expected = lam * (x - y) / (1 - (x - y) ** 2 / b)
    assert across == pytest.approx(expected, rel=1e-11, abs=1e-14 * x)
    assert -1e-14 * x <= y <= x


@pytest.mark.parametrize(
    "other", [{"bladder": Bladder(1e6, 1e-4)}, {"knit": Knit(2.0)}, {"c1": 1.9, "c2": 1.5}]
)
def test_unsupported_combinations_are_refused(other: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match="wrinkling = 'tension-field'"):
        Composite(membrane=Membrane("tension-field"), **other)


def test_residual_stiffness_alone_resists_compression(alone: MPI.Comm) -> None:
    """What is slack has the energy of the residual stiffness, of a material without bounds."""
    model = sheet_model(alone, COMPOSITE)
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    energy = model.energy(affine(model, np.diag([0.9, 0.01, 1.0])[:, :2])) / SIZE**2
    by_hand = 15 * (0.1**2 + 0.99**2) + 7.5 * 1.09**2
    assert energy == pytest.approx(RESIDUAL * by_hand, rel=1e-12)
