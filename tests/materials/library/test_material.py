"""Entries of a library become materials."""

from typing import Any

import pytest

from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.materials.sheet import Bladder, Material

FABRIC: dict[str, Any] = {
    "name": "my-jersey", "kind": "fabric", "title": "my jersey", "young": 1e5, "poisson": 0.3,
    "thickness": 5e-4, "stretch_range": (1, 1.5), "source": "own test", "trust": "measured",
}  # fmt: skip
RUBBER = {**FABRIC, "kind": "rubber", "poisson": 0.5}


def test_values_become_a_sheet_or_a_bladder() -> None:
    entry = LibraryMaterial(**{**FABRIC, "young": 100_000, "c1": 2})
    assert entry.material == Material(1e5, 0.3, 5e-4, c1=2.0)
    assert entry.membrane_stiffness == pytest.approx(50.0)
    assert (entry.c1, entry.stretch_range) == (2.0, (1.0, 1.5))
    assert isinstance(entry.young, float)
    assert LibraryMaterial(**RUBBER).bladder == Bladder(1e5, 5e-4)
