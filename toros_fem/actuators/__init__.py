"""The tubes, walkers and grippers of the paper, designed under pressure."""

from toros_fem.actuators.case import ActuatorCase, Touching
from toros_fem.actuators.config import ActuatorConfig
from toros_fem.actuators.gait import Gait
from toros_fem.actuators.pressure_curve import PressureCurve, trace_pressure_curve
from toros_fem.actuators.problem import actuator_problem
from toros_fem.actuators.run import ActuatorResult, design_actuator
from toros_fem.actuators.tube import (
    CrossSectionTubeConfig,
    TubeConfig,
    cross_section_case,
    tube_case,
)

__all__ = [
    "ActuatorCase",
    "ActuatorConfig",
    "ActuatorResult",
    "CrossSectionTubeConfig",
    "Gait",
    "PressureCurve",
    "Touching",
    "TubeConfig",
    "actuator_problem",
    "cross_section_case",
    "design_actuator",
    "trace_pressure_curve",
    "tube_case",
]
