"""Skins that move under pressure, designed from start to files."""

from toros_fem.products.actuators.designer import design_actuator
from toros_fem.products.actuators.pressure_curve import PressureCurve, trace_pressure_curve
from toros_fem.products.actuators.result import ActuatorResult
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.actuators.simulate import simulate_actuator

__all__ = [
    "ActuatorResult",
    "ActuatorScene",
    "Level",
    "PressureCurve",
    "design_actuator",
    "simulate_actuator",
    "trace_pressure_curve",
]
