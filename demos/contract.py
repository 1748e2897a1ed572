"""A tube that shortens when inflated (paper Fig. 8c): design of its reinforcement pattern.

    python demos/contract.py --coarse

The tube of `bend.py` is to become 8 % shorter at 10 kPa. It may swell freely, and it must: the work
of the pressure on a larger cross-section is what pulls the ends together. The positions of twelve
cross-sections and of the end plate along the axis count, and that all of them stay perpendicular to
it. The design starts from helical lines that cross at 28° to the axis, as in a McKibben muscle.
From a start without a pattern the design stays a stiff tube. The default materials allow little
more than 8 %, and only with finer lines than these (docs/limits.md). Half the tube is designed, by
symmetry; `--whole` designs all of it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.run import design_run, summary_sentence
from toros_fem.actuators.tube import (
    CrossSectionTubeConfig,
    SymmetricConfig,
    coarse_tube,
    cross_section_case,
    shortening_metric,
    twist_metric,
)
from toros_fem.command_line import run_from_command_line
from toros_fem.config import quantity
from toros_fem.meshes import contract


@dataclass(frozen=True)
class ContractConfig(SymmetricConfig, CrossSectionTubeConfig):
    """Numbers of the tube that shortens; SI units."""

    contraction: float = quantity(8.0, "shortening of the target", "%", below=100)
    tip_weight: float = CrossSectionTubeConfig.redefault("tip_weight", 10.0)
    helices: int = CrossSectionTubeConfig.redefault("helices", 3)
    helix_angle: float = CrossSectionTubeConfig.redefault("helix_angle", 28.0)
    helix_width: float = CrossSectionTubeConfig.redefault("helix_width", 2.5e-3)
    crossed: bool = CrossSectionTubeConfig.redefault("crossed", True)
    iterations: int = CrossSectionTubeConfig.redefault("iterations", 90)
    pressure: float = CrossSectionTubeConfig.redefault("pressure", 10e3)

    TARGETS: ClassVar[Mapping[str, str]] = {"shortening_percent": "contraction"}


def case(comm: MPI.Comm, config: ContractConfig) -> ActuatorCase:
    """Return half the tube, or the whole, and its target."""
    target = contract(1 - config.contraction / 100)
    metrics = [shortening_metric(config.contraction), twist_metric(None)]
    return cross_section_case(comm, config, target, metrics, () if config.whole else (1,))


def coarse(config: ContractConfig) -> ContractConfig:
    """Return the same design on a coarse mesh, with wider lines to start from."""
    return coarse_tube(config).updated(helix_width=3e-3)


run = design_run(case, ContractConfig())


if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            ContractConfig(),
            run,
            Path("output/contract"),
            coarse=coarse,
            sentence=summary_sentence,
        )
    )
