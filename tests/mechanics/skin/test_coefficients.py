"""Coefficients of the forms."""

import pytest

from toros_fem.materials.sheet import Material
from toros_fem.mechanics.skin.coefficients import sheet_stiffness
from toros_fem.meshes import Skin


def test_stiffness_of_a_sheet(short_tube: Skin) -> None:
    """Membrane h, bending h³/12 times the plane-stress Lamé parameters."""
    sheet = Material(2e6, 0.25, 2e-3)
    found = sheet_stiffness(short_tube.mesh, sheet)
    mu, lam = 2e6 / 2.5, 2e6 * 0.25 / (1 - 0.0625)
    assert float(found.mu.value) == pytest.approx(2e-3 * mu)
    assert float(found.lam.value) == pytest.approx(2e-3 * lam)
    assert float(found.mu_bend.value) == pytest.approx(8e-9 / 12 * mu)
    assert float(found.lam_bend.value) == pytest.approx(8e-9 / 12 * lam)
