"""A tube that bends and twists at once when inflated.

The positions and orientations of cross-sections and of the tip count; the skin may swell freely.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.design.loop.case import Case
from toros_fem.meshes import bend, compose, twist
from toros_fem.products.actuators.scene import Level
from toros_fem.products.tables.loads import Pressing
from toros_fem.products.tables.steps import Lines
from toros_fem.products.tables.targets import TwistAngle, twist_key
from toros_fem.products.tubes.bend import BendTarget
from toros_fem.products.tubes.tube import SectionTubeScene, bend_metric, twist_metric


@dataclass(frozen=True)
class BendTwistTarget(BendTarget):
    """Shape that is asked for."""

    twist: TwistAngle = twist_key(60.0)


@dataclass(frozen=True)
class BendTwistScene(SectionTubeScene):
    """The tube that bends and twists."""

    target: BendTwistTarget = BendTwistTarget(angle=90.0)
    pressure: Pressing = Pressing(pressure=10e3)
    # Few lines would answer to a correction by leaps.
    lines: Lines = Lines(share_weight=3e-3)

    KIND: ClassVar = "bend-twist"
    FEW: ClassVar = ("angle", "twist", "neutral", "length", "diameter", "pressure", "seed")

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked, length = self.target, self.skin.length
        twisted = twist(np.radians(asked.twist), length)
        bent = bend(np.radians(asked.angle), length, neutral=asked.neutral)
        metrics = [bend_metric(asked.angle), twist_metric(asked.twist)]
        return self.tube_case(comm, level, compose(twisted, bent), metrics)
