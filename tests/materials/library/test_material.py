"""Materials of a library are checked."""

from typing import Any

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.materials.library import LibraryMaterial
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "my jersey"}, "^name = 'my jersey' must be letters"),
        ({"name": "none"}, "not 'none'"),
        ({"name": 3}, "name = 3 must be letters"),
        ({"kind": "cloth"}, "kind = 'cloth' must be one of"),
        ({"trust": "sure"}, "trust = 'sure' must be one of"),
        ({"title": ""}, "title = '' must be one line"),
        ({"source": "a\nb"}, "source = .* must be one line"),
        ({"young": 0}, "young = 0 Pa must be a finite number, above 0"),
        ({"young": "1 kPa"}, "young = '1 kPa' must be a number"),
        ({"poisson": 0.6}, "poisson = 0.6 must be"),
        ({"thickness": 0.5}, "thickness = 0.5 m must be .* at most 0.05"),
        ({"stretch_range": (1.1, 1.5)}, r"stretch_range = \[1.1, 1.5\] must be a least stretch"),
        ({"stretch_range": 1.5}, "stretch_range has shape"),
        ({"stretch_range": (1, 1.5), "c1": 1.4}, "ends at 1.5, beyond the bound c1 = 1.4"),
        ({"c2": 1.0}, "c2 = 1.0 must be a finite number, above 1"),
        ({"with_fabric": True}, "with_fabric = True belongs to a print"),
        ({"with_fabric": 1}, "with_fabric = 1 must be True or False"),
        ({**RUBBER, "knit_ratio": 2.0}, "knit_ratio = 2.0 belongs to a fabric"),
        ({**RUBBER, "poisson": 0.4}, "a rubber is incompressible"),
        ({**RUBBER, "c1": 3.0}, "neo-Hookean and has no bounds"),
    ],
)
def test_wrong_values(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        LibraryMaterial(**{**FABRIC, **change})
