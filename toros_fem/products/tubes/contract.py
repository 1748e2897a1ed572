"""A tube that shortens when inflated (paper Fig. 8c).

It may swell freely. The positions of cross-sections and of the end plate along the axis count, and
that all of them stay perpendicular to it. Half the tube is designed, by symmetry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import In, key
from toros_fem.measures.metrics import Measurement
from toros_fem.meshes import contract
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.run import design_run
from toros_fem.products.tubes.tube import (
    CrossSectionTubeConfig,
    SymmetricConfig,
    cross_section_case,
    shortening_metric,
    twist_metric,
)

# Fig. 8c of the paper: the printed skin, inflated.
MEASURED = (Measurement("shortening_percent", 8.0, 10e3, 7.8, "paper, measured"),)


@dataclass(frozen=True)
class ContractConfig(SymmetricConfig, CrossSectionTubeConfig):
    """Numbers of the tube that shortens; SI units."""

    contraction: Annotated[float, In("%", below=100)] = key(8.0, "shortening of the target")
    tip_weight: float = CrossSectionTubeConfig.redefault("tip_weight", 10.0)
    iterations: int = CrossSectionTubeConfig.redefault("iterations", 90)
    pressure: float = CrossSectionTubeConfig.redefault("pressure", 10e3)
    # Bending of thin lines between their crossings needs two triangles across.
    print_edge_length: float = CrossSectionTubeConfig.redefault("print_edge_length", 0.5e-3)

    TARGETS: ClassVar[Mapping[str, str]] = {"shortening_percent": "contraction"}


def case(comm: MPI.Comm, config: ContractConfig) -> ActuatorCase:
    """Return half the tube, or the whole, and its target."""
    target = contract(1 - config.contraction / 100)
    metrics = [shortening_metric(config.contraction), twist_metric(None)]
    return cross_section_case(comm, config, target, metrics, () if config.whole else (1,))


run = design_run(case, ContractConfig(), MEASURED)
