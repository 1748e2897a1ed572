"""A tube that shortens when inflated (paper Fig. 8c).

It may swell freely. The positions of cross-sections and of the end plate along the axis count, and
that all of them stay perpendicular to it. Half the tube is designed, by symmetry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import In, Table, key
from toros_fem.design.loop.case import Case
from toros_fem.measures.metrics import Measurement
from toros_fem.meshes import contract
from toros_fem.products.actuators.scene import Level
from toros_fem.products.tables.loads import Pressing, SectionWeights
from toros_fem.products.tables.steps import Designing, Lines
from toros_fem.products.tubes.tube import (
    SectionTubeScene,
    SymmetricTube,
    shortening_metric,
    twist_metric,
)

# Fig. 8c of the paper: the printed skin, inflated.
MEASURED = (Measurement("shortening_percent", 8.0, 10e3, 7.8, "paper, measured"),)


@dataclass(frozen=True)
class ContractTarget(Table):
    """Shape that is asked for."""

    contraction: Annotated[float, In("%", below=100)] = key(8.0, "shortening of the target")


@dataclass(frozen=True)
class ContractScene(SectionTubeScene):
    """The tube that shortens."""

    target: ContractTarget = ContractTarget()
    skin: SymmetricTube = SymmetricTube()
    pressure: Pressing = Pressing(pressure=10e3)
    objective: SectionWeights = SectionWeights(tip_weight=10.0)
    design: Designing = Designing(start="relaxed", corrections=6, iterations=90)
    # Bending of thin lines between their crossings needs two triangles across.
    lines: Lines = Lines(print_edge_length=0.5e-3)

    KIND: ClassVar[str] = "contract"
    MEASURED: ClassVar[tuple[Measurement, ...]] = MEASURED
    FEW: ClassVar[tuple[str, ...]] = ("contraction", "length", "diameter", "pressure", "seed")

    COARSE: ClassVar[Mapping[str, float]] = {
        **SectionTubeScene.COARSE,
        "print_edge_length": 9 / 5,
    }
    TARGETS: ClassVar[Mapping[str, str]] = {"shortening_percent": "contraction"}

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half the tube, or the whole, and its target."""
        asked, planes = self.target.contraction, () if self.skin.whole else (1,)
        metrics = [shortening_metric(asked), twist_metric(None)]
        return self.section_case(comm, level, contract(1 - asked / 100), metrics, planes)
