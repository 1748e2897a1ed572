"""What is read off a shape, with its gradient: distances, angles, gaps, eqs. (17, 18)."""

from toros_fem.measures.alignment import AlignedObjective
from toros_fem.measures.between_regions import (
    TipFrame,
    bend_between,
    length_between,
    tip_frame,
    twist_between,
)
from toros_fem.measures.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.measures.gap import Body, GapObjective
from toros_fem.measures.metrics import (
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
from toros_fem.measures.mirrored import MirroredObjective
from toros_fem.measures.shape import Nodes, Objective, Part, ShapeObjective, ShapePart, SumObjective

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
    "Part",
    "ShapeObjective",
    "ShapePart",
    "SumObjective",
    "TipFrame",
    "bend_angle",
    "bend_between",
    "distance",
    "length_between",
    "length_ratio",
    "shortening",
    "swelling",
    "tip_frame",
    "turn_angle",
    "twist_angle",
    "twist_between",
]
