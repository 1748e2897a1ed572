"""A tube that bends when inflated (paper Fig. 8b): design of its reinforcement pattern.

    python demos/bend.py --coarse
    mpirun -n 2 python demos/bend.py --coarse --output output/bend-2
    python demos/bend.py --coarse --whole
    python demos/bend.py --coarse --knit-ratio 3

The tube, 15 cm long and 2 cm wide, lies along z. Its end z = 0 is clamped. Its two end caps are
printed all over, as end plates are. Its wall is designed, at the 5 kPa that the paper states;
`--design-pressure` designs the pressure too. The target bends
towards +x, and the inner side of the bend keeps its length, because a skin under pressure does not
shorten. The end plate at the tip counts as much as all the rest, so that the design reaches the
angle and not only the shape. Constraints on the widths of lines and gaps act after the first
stage. The pattern is then thresholded, cleaned so that it can be printed, and simulated again.

The target is symmetric about the plane y = 0, so half the tube is designed, in about half the time.
Files, pictures and figures are those of the whole. A whole tube (`--whole`) may also find patterns
that are not symmetric.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.run import design_run, summary_sentence
from toros_fem.actuators.tube import (
    SymmetricConfig,
    TubeConfig,
    bend_metric,
    coarse_tube,
    tube_case,
)
from toros_fem.command_line import run_from_command_line
from toros_fem.config import quantity
from toros_fem.meshes import bend
from toros_fem.objectives.metrics import Measurement

# Fig. 8b of the paper: the printed skin, inflated.
MEASURED = (Measurement("angle_deg", 180.0, 13e3, 150.0, "paper, measured"),)


@dataclass(frozen=True)
class BendConfig(SymmetricConfig, TubeConfig):
    """Numbers of the bending tube; SI units."""

    angle: float = quantity(180.0, "bend angle of the target", "deg")
    neutral: float = quantity(
        0.01,
        "distance of the line that keeps its length from the axis, towards the inner side",
        "m",
    )

    corrections: int = TubeConfig.redefault("corrections", 6)
    # Fewer islands, a shorter border, and nearer to the target: docs/optimisation.md.
    perimeter_weight: float | None = TubeConfig.redefault("perimeter_weight", 1e-4)

    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "angle"}


def case(comm: MPI.Comm, config: BendConfig) -> ActuatorCase:
    """Return half the tube, or the whole, and its target."""
    target = bend(np.radians(config.angle), config.length, neutral=config.neutral)
    planes = () if config.whole else (1,)
    return tube_case(comm, config, target, [bend_metric(config.angle)], planes)


run = design_run(case, BendConfig(), MEASURED)


if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            BendConfig(),
            run,
            Path("output/bend"),
            coarse=coarse_tube,
            sentence=summary_sentence,
        )
    )
