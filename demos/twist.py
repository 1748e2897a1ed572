"""A tube that twists when inflated (paper Fig. 8d): design of its reinforcement pattern.

    python demos/twist.py --coarse

The end plate of the tube of `bend.py` is to turn by 300° about the axis, and each cross-section in
proportion to its height. The positions of the cross-sections along the axis are free, and the skin
may swell freely. The design starts from four left-handed helical lines; `--helices 0` starts
without a pattern and ends near 255°.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.run import design_run, summary_sentence
from toros_fem.actuators.tube import (
    CrossSectionTubeConfig,
    coarse_tube,
    cross_section_case,
    twist_metric,
)
from toros_fem.command_line import run_from_command_line
from toros_fem.config import quantity
from toros_fem.meshes import twist


@dataclass(frozen=True)
class TwistConfig(CrossSectionTubeConfig):
    """Numbers of the twisting tube; SI units."""

    twist: float = quantity(
        300.0, "twist of the target, positive if counter-clockwise seen from the tip", "deg"
    )
    axial_weight: float = CrossSectionTubeConfig.redefault("axial_weight", 0.0)
    helices: int = CrossSectionTubeConfig.redefault("helices", 4)
    # Left-handed lines unwind counter-clockwise.
    helix_angle: float = CrossSectionTubeConfig.redefault("helix_angle", -55.0)
    helix_width: float = CrossSectionTubeConfig.redefault("helix_width", 2.5e-3)
    pressure: float = CrossSectionTubeConfig.redefault("pressure", 15e3)


def case(comm: MPI.Comm, config: TwistConfig) -> ActuatorCase:
    """Return the tube and its target."""
    target = twist(np.radians(config.twist), config.length)
    return cross_section_case(comm, config, target, [twist_metric(config.twist)])


def coarse(config: TwistConfig) -> TwistConfig:
    """Return the same design on a coarse mesh, with wider lines to start from."""
    return coarse_tube(config).updated(helix_width=4e-3)


run = design_run(case, TwistConfig())


if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            TwistConfig(),
            run,
            Path("output/twist"),
            coarse=coarse,
            sentence=summary_sentence,
        )
    )
