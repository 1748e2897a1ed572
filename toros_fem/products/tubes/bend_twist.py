"""A tube that bends and twists at once when inflated.

The positions and orientations of cross-sections and of the tip count; the skin may swell freely.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.design.loop.case import Case
from toros_fem.meshes.targets import bend, compose, twist
from toros_fem.products.actuators.scene import Level
from toros_fem.products.plausibility import Group, Inflated
from toros_fem.products.tables.steps import LineTable, TwistAngle, twist_key
from toros_fem.products.tubes.bend import BendTarget
from toros_fem.products.tubes.tube import SectionTubeScene, bend_metric, twist_metric


class BendTwistTarget(BendTarget):
    """Shape that is asked for."""

    twist: TwistAngle = twist_key(60.0)


class BendTwistScene(SectionTubeScene):
    """The tube that bends and twists."""

    target: BendTwistTarget = BendTwistTarget(angle=90.0)
    # Many lines, also where few are asked for, and with room for other widths: of a few wide ones
    # each decides about the shape.
    lines: LineTable = LineTable(
        share_weight=1e-3, relaxed_iterations=60, least_share=0.012, spread=2.0
    )

    KIND: ClassVar = "bend-twist"
    COARSE: ClassVar = {**SectionTubeScene.COARSE, "laid_width": 1.0, "second_laid_width": 1.0}
    FEW: ClassVar = (
        "angle", "twist", "neutral", "length", "diameter", "edge_length", "pressure", "seed",
    )  # fmt: skip

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from self.target.groups(skin, self.skin.length)
        yield from skin.twist("twist", self.target.twist, self.skin.length)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked, length = self.target, self.skin.length
        twisted = twist(np.radians(asked.twist), length)
        bent = bend(np.radians(asked.angle), length, neutral=asked.neutral)
        metrics = [bend_metric(asked.angle), twist_metric(asked.twist)]
        return self.tube_case(comm, level, compose(twisted, bent), metrics)
