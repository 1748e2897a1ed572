"""A tube that shortens when inflated (paper Fig. 8c).

It may swell freely. The positions of cross-sections and of the end plate along the axis count, and
that all of them stay perpendicular to it. Half the tube is designed, by symmetry.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import Table
from toros_fem.design.loop.case import Case
from toros_fem.measures.metrics import Measurement
from toros_fem.meshes.targets import contract
from toros_fem.products.actuators.scene import Level
from toros_fem.products.plausibility import Group, Inflated
from toros_fem.products.tables.loads import SectionWeights
from toros_fem.products.tables.steps import DesignTable, Shortening, shortening_key
from toros_fem.products.tubes.tube import (
    SectionTubeScene,
    SymmetricTube,
    shortening_metric,
    twist_metric,
)


class ContractTarget(Table):
    """Shape that is asked for."""

    contraction: Shortening = shortening_key(8.0)


class ContractScene(SectionTubeScene):
    """The tube that shortens."""

    target: ContractTarget = ContractTarget()
    skin: SymmetricTube = SymmetricTube()
    objective: SectionWeights = SectionWeights(tip_weight=10.0)
    design: DesignTable = DesignTable(start="relaxed", corrections=8, iterations=90)

    KIND: ClassVar = "contract"
    FEW: ClassVar = ("contraction", "length", "diameter", "edge_length", "pressure", "seed")
    MEASURED: ClassVar = (Measurement("shortening_percent", 8.0, 10e3, 7.8, "paper, measured"),)

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from skin.shortening("contraction", self.target.contraction / 100)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half the tube, or the whole, and its target."""
        asked = self.target.contraction
        metrics = [shortening_metric(asked), twist_metric(None)]
        return self.tube_case(comm, level, contract(1 - asked / 100), metrics, self.skin.planes)
