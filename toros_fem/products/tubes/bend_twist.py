"""A tube that bends and twists at once when inflated.

The positions and orientations of cross-sections and of the tip count; the skin may swell freely.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.keys import In, Place, key
from toros_fem.meshes import bend, compose, twist
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.run import design_run
from toros_fem.products.tubes.tube import (
    CrossSectionTubeConfig,
    bend_metric,
    cross_section_case,
    twist_metric,
)


@dataclass(frozen=True)
class BendTwistConfig(CrossSectionTubeConfig):
    """Numbers of the tube that bends and twists; SI units."""

    angle: Annotated[float, In("deg", at_least=-720, at_most=720)] = key(
        90.0, "bend angle of the target"
    )
    twist: Annotated[float, In("deg", at_least=-2160, at_most=2160)] = key(
        60.0, "twist of the target, positive if counter-clockwise seen from the tip"
    )
    neutral: Place = key(
        0.01, "distance of the line that keeps its length from the axis, towards the inner side"
    )
    pressure: float = CrossSectionTubeConfig.redefault("pressure", 10e3)
    # Few lines would answer to a correction by leaps.
    share_weight: float | None = CrossSectionTubeConfig.redefault("share_weight", 3e-3)

    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "angle", "twist_deg": "twist"}


def case(comm: MPI.Comm, config: BendTwistConfig) -> ActuatorCase:
    """Return the tube and its target."""
    target = compose(
        twist(np.radians(config.twist), config.length),
        bend(np.radians(config.angle), config.length, neutral=config.neutral),
    )
    metrics = [bend_metric(config.angle), twist_metric(config.twist)]
    return cross_section_case(comm, config, target, metrics)


run = design_run(case, BendTwistConfig())
