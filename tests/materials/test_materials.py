"""Moduli and bounds of materials."""

from dataclasses import replace

import pytest

from toros_fem.materials.sheet import Composite, Material


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_lame_parameters(poisson: float) -> None:
    """They are those of plane stress, and lead back to the moduli."""
    made = Material(2.6e7, poisson, 4e-4)
    back = Material.from_lame(made.mu, made.lam, made.thickness)
    assert back.young == pytest.approx(made.young, rel=1e-14)
    assert back.poisson == pytest.approx(poisson, rel=1e-14)
    if poisson < 0.5:  # from three dimensions
        solid = made.young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        assert made.lam == pytest.approx(2 * made.mu * solid / (solid + 2 * made.mu), rel=1e-14)


def test_bounds_of_each_material() -> None:
    """A material without bounds of its own takes those of the composite."""
    fabric, printed = Material(1e5, 0.3, 5e-4, c1=1.5), Material(1e7, 0.3, 5e-4, c2=2)
    made = Composite(fabric, printed, c1=1.9, c2=2.6)
    assert made.fabric_bounds == (1.5, 2.6)
    assert made.reinforcement_bounds == (1.9, 2.0)
    assert made.widest_bounds == (1.9, 2.6)
    assert not made.shares_bounds
    assert made.stated_bounds == "c1 = 1.5, c2 = 2.6 of the fabric, c1 = 1.9, c2 = 2 of the print"
    both = Composite(replace(fabric, c1=1.5, c2=2.0), replace(printed, c1=1.5))
    assert both.shares_bounds
    assert both.stated_bounds == "c1 = 1.5, c2 = 2"
