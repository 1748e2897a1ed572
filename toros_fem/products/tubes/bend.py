"""A tube that bends when inflated (paper Fig. 8b).

The tube lies along z and its end z = 0 is clamped. Its caps are printed, its wall is designed. The
target bends towards +x, and the inner side of the bend keeps its length. The end plate at the tip
counts as much as all the rest. The target is symmetric about y = 0, so half the tube is designed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.keys import In, Place, Table, key
from toros_fem.design.loop.case import Case
from toros_fem.measures.metrics import Measurement
from toros_fem.mechanics.terms.loads import GRAVITY
from toros_fem.meshes.makers.sheets import TIP
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.targets import bend
from toros_fem.products.actuators.scene import Level
from toros_fem.products.plausibility import Group, Inflated, bend_strain
from toros_fem.products.tables.steps import BendAngle, DesignTable, bend_key
from toros_fem.products.tubes.tube import SymmetricTube, TubeScene, bend_metric


class BendTarget(Table):
    """Shape that is asked for."""

    angle: BendAngle = bend_key(180.0)
    neutral: Place = key(
        0.01, "distance of the line that keeps its length from the axis, towards the inner side"
    )

    def strain(self, radius: float, length: float) -> float:
        """Return the strain of the outer side of a tube of a radius and a length in m."""
        return bend_strain(self.angle, length, radius + self.neutral)

    def groups(self, skin: Inflated, length: float) -> Iterator[Group]:
        """Yield the groups of the bend of a tube of a length in m."""
        yield from skin.bend("angle", self.angle, length, skin.radius + self.neutral)


class HungLoad(Table):
    """What hangs from the tip. The tube lies and x points up, so that a bend lifts it."""

    hung_mass: Annotated[float, In("kg", above=0)] | None = key(
        None, "mass that hangs from the tip; none for none"
    )

    def force(self, pattern: Pattern, parts: int) -> Floats | None:
        """Return dead forces in N on the vertices of one of some equal parts, (n, 3)."""
        if self.hung_mass is None:
            return None
        tip, force = pattern.vertices_of(TIP), np.zeros_like(pattern.points)
        areas = pattern.vertex_areas[tip]
        force[tip, 0] = -self.hung_mass * GRAVITY / parts * areas / areas.sum()
        return force


class BendScene(TubeScene):
    """The bending tube."""

    target: BendTarget = BendTarget()
    load: HungLoad = HungLoad()
    skin: SymmetricTube = SymmetricTube()
    # With a perimeter: fewer islands, a shorter border, and nearer to the target
    # (docs/optimisation.md).
    design: DesignTable = DesignTable(perimeter_weight=1e-4)

    KIND: ClassVar = "bend"
    FEW: ClassVar = (
        "angle", "neutral", "length", "diameter", "edge_length", "pressure", "hold_pressure",
        "seed",
    )  # fmt: skip
    MEASURED: ClassVar = (Measurement("angle_deg", 180.0, 13e3, 150.0, "paper, measured"),)

    @property
    def needed_strain(self) -> float:
        """Strain of the outer side of the bend."""
        return self.target.strain(self.radius, self.skin.length)

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from self.target.groups(skin, self.skin.length)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half the tube, or the whole, and its target."""
        asked = self.target
        deform = bend(np.radians(asked.angle), self.skin.length, neutral=asked.neutral)
        metrics = [bend_metric(asked.angle)]
        case = self.tube_case(comm, level, deform, metrics, self.skin.planes)
        return replace(case, force=self.load.force(case.pattern, case.whole.parts))
