"""Skins that move under pressure, designed from start to files."""

from toros_fem.products.actuators.case import ActuatorCase, Touching
from toros_fem.products.actuators.pressure_curve import PressureCurve, trace_pressure_curve
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.actuators.run import ActuatorResult, design_actuator
from toros_fem.products.actuators.scene import ActuatorScene

__all__ = [
    "ActuatorCase",
    "ActuatorResult",
    "ActuatorScene",
    "PressureCurve",
    "Touching",
    "actuator_problem",
    "design_actuator",
    "trace_pressure_curve",
]
