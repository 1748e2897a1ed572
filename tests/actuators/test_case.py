"""Configuration of an actuator: words for the bending term."""

import pytest

from toros_fem import errors
from toros_fem.actuators.case import ActuatorConfig
from toros_fem.materials import Bending


def test_bending_by_name() -> None:
    for setting in ({"bending": "cubic"}, {"seams": "glued"}, {"refine": 2}):
        with pytest.raises(errors.ParameterError, match=next(iter(setting))):
            ActuatorConfig(**setting)  # type: ignore[arg-type]
    assert ActuatorConfig(bending="none").composite.bending is None
    assert ActuatorConfig(bending="average", seams="hinged").composite.bending == Bending(
        "average", "hinged"
    )
