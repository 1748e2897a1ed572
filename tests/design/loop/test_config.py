"""Configuration that all designs have in common: its materials, and what None leaves out."""

from toros_fem.materials.sheet import Composite, Material
from toros_fem.products.tables.sheets import Sheets


def test_materials_of_the_numbers() -> None:
    found = Sheets(
        fabric_young=2e5, reinforcement_young=3e7, poisson=0.4, thickness=1e-3, c1=2.0, c2=3.0
    ).composite
    assert found == Composite(
        Material(2e5, 0.4, 1e-3), Material(3e7, 0.4, 1e-3), c1=2.0, c2=3.0, bending=None
    )


def test_default_materials_are_those_of_a_composite() -> None:
    assert Sheets().composite == Composite(bending=None)
