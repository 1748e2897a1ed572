"""Configuration that all designs have in common: its materials, and what None leaves out."""

from typing import Any

import pytest

from toros_fem import errors
from toros_fem.design.loop.config import DesignConfig, MaterialConfig
from toros_fem.materials.sheet import Composite, Material


def test_materials_of_the_numbers() -> None:
    found = MaterialConfig(
        fabric_young=2e5, reinforcement_young=3e7, poisson=0.4, thickness=1e-3, c1=2.0, c2=3.0
    ).composite
    assert found == Composite(
        Material(2e5, 0.4, 1e-3), Material(3e7, 0.4, 1e-3), c1=2.0, c2=3.0, bending=None
    )


def test_default_materials_are_those_of_a_composite() -> None:
    assert MaterialConfig().composite == Composite(bending=None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"filter": "gauss"}, "filter = 'gauss' must be one of"),
        ({"filter_radius": 0.0}, "filter_radius = 0.0 m must be a finite number, above 0"),
        ({"eta": 1.0}, "eta = 1.0 must be a finite number, above 0 and below 1"),
        ({"line_width": 0.0}, "line_width = 0.0 m"),
        ({"perimeter_weight": 0.0}, "perimeter_weight = 0.0"),
        ({"move_limit": 1.1}, "move_limit = 1.1"),
        ({"c1": 1.0}, "c1 = 1.0 must be a finite number, above 1"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_bad_values(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        DesignConfig(**changes)


def test_none_leaves_out() -> None:
    config = DesignConfig(line_width=None, gap_width=None, perimeter_weight=None)
    assert (config.line_width, config.gap_width, config.perimeter_weight) == (None, None, None)
