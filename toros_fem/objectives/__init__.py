"""Objectives and metrics of a simulated shape, eqs. (17, 18)."""

from toros_fem.objectives.alignment import AlignedObjective
from toros_fem.objectives.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.objectives.gap import Body, GapObjective
from toros_fem.objectives.metrics import (
    Measurement,
    Metric,
    bend_angle,
    distance,
    length_ratio,
    shortening,
    swelling,
    turn_angle,
    twist_angle,
)
from toros_fem.objectives.mirrored import MirroredObjective
from toros_fem.objectives.shape import Nodes, Objective, ShapeObjective, SumObjective

__all__ = [
    "AlignedObjective",
    "Body",
    "CrossSectionObjective",
    "CrossSections",
    "GapObjective",
    "Measurement",
    "Metric",
    "MirroredObjective",
    "Nodes",
    "Objective",
    "ShapeObjective",
    "SumObjective",
    "bend_angle",
    "distance",
    "length_ratio",
    "shortening",
    "swelling",
    "turn_angle",
    "twist_angle",
]
