"""Uniaxial tension of eq. (1): the exact root, near the bounds too, and its derivatives."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.scenes import TABLE_A, table
from helpers.tensile_tests import uniaxial_curve
from scipy.optimize import brentq

from toros_fem.materials.sheet import Composite, Knit, Material
from toros_fem.products.fitting.uniaxial import (
    Coefficients,
    Scales,
    lateral_strain,
    tension,
)


def test_closed_form_table() -> None:
    rows = [r for r in table("gent_uniaxial") if r["mat"] == "A" and float(r["stretch"]) >= 1]
    assert len(rows) > 5
    stretch = np.array([float(r["stretch"]) for r in rows])
    stress, lateral = uniaxial_curve(replace(TABLE_A, c1=1.8, c2=2.0), stretch)
    expected = np.array([float(r["nominal_stress_Pa"]) for r in rows]) * TABLE_A.thickness
    assert stress == pytest.approx(expected, rel=3e-8, abs=1e-12)  # the table's digits
    assert lateral == pytest.approx([float(r["lateral_stretch"]) for r in rows], rel=3e-8)


@pytest.mark.parametrize("b", [0.0, 0.3, 4.0, 100.0])
@pytest.mark.parametrize(("across", "more"), [(0.0, 0.0), (2.0, 0.0), (2.0, 5.0)])
def test_root_up_to_the_bounds(b: float, across: float, more: float) -> None:
    """Against Brent's method, at strains that differ from both bounds by down to 1e-9."""
    c = Coefficients(1.0, 0.7, 1.0, b, 0.0, across, 0.0, more)
    end = np.inf if b == 0 else b**-0.5
    strain = np.array([0.0, 1e-12, 1e-6, 0.1, 0.5, 0.9, 0.999, 1 - 1e-9])

    def residual(w: float, x: float) -> float:
        z = x + w
        threads = across * w * np.exp(more * w * w)
        return 2 * w / (1 - w * w) + threads + 0.7 * z / (1 - b * z * z)

    found = lateral_strain(strain, c)
    assert (found <= 0).all()
    assert (found + strain < end).all()
    for x, w in zip(strain[1:], found[1:], strict=True):
        inside = 1e-15
        exact = brentq(residual, -x, min(-inside * x, end * (1 - inside) - x), (x,), xtol=1e-17)
        assert w == pytest.approx(exact, rel=1e-9, abs=1e-15)


def test_derivatives() -> None:
    """Up to the bounds, and of fibres in both directions."""
    strain, course = np.array([0.1, 0.5, 0.9]), np.array([True, False, True])
    scales = Scales(0.91, 0.6, 50.0, "course", 0.9, 0.5)
    theta = np.array([np.log(50.0), 0.3, 0.4, np.log(30.0), 1.5, np.log(8.0), 2.0])

    def curve(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return tension(strain, partial(scales.coefficients, course=course), theta)

    slopes, step = curve(theta)[1], 1e-6
    for k, along in enumerate(np.eye(7)):
        ends = [curve(theta + sign * step * along)[0] for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert slopes[..., k] == pytest.approx(difference, rel=1e-6, abs=1e-7)


def test_moduli_of_a_knit() -> None:
    """At small strain the slopes are those that `Composite.moduli` tells."""
    fabric = Material(1e5, 0.25, 4e-4, c1=1.9, c2=2.6)
    expected = Composite(fabric=fabric, knit=Knit(3.0)).moduli
    for direction, modulus in zip(("course", "wale"), expected, strict=True):
        stretch = np.array([1 + 1e-6])
        stress, _ = uniaxial_curve(fabric, stretch, knit_ratio=3.0, direction=direction)
        assert stress[0] / 1e-6 / fabric.thickness == pytest.approx(modulus, rel=1e-5)
