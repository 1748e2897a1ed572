"""A tube that twists when inflated (paper Fig. 8d).

The end plate is to turn about the axis, and each cross-section in proportion to its height. The
skin may swell freely. It may lengthen too, unless it is asked to keep its length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.keys import Flag, Positive, Table, key
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.loop.case import Case
from toros_fem.measures.metrics import Measurement
from toros_fem.meshes.targets import compose, contract, twist
from toros_fem.products.actuators.scene import Level
from toros_fem.products.plausibility import Group, Inflated
from toros_fem.products.tables.loads import PressureTable, SectionWeights
from toros_fem.products.tables.steps import TwistAngle, twist_key
from toros_fem.products.tubes.tube import SectionTubeScene, length_metric, twist_metric

# Width of the helices over that asked, if the length is kept: thin ones hold the axial lines less.
HELICES = 0.78
# Number of lines along the tube, if the length is kept. It bends about a single one, and about two
# in a plane; more of them hold the helices more.
ALONG = 3


class TwistTarget(Table):
    """Shape that is asked for."""

    twist: TwistAngle = twist_key(300.0)
    keep_length: Flag = key(
        False, "let the tube keep its length, or have the one given; else axial_weight is 0"
    )
    length_ratio: Positive = key(
        1.0, "length of the target over that of the tube, if the length is kept", metric="length"
    )


class TwistScene(SectionTubeScene):
    """The twisting tube."""

    target: TwistTarget = TwistTarget()
    pressure: PressureTable = PressureTable(pressure=15e3)
    objective: SectionWeights = SectionWeights(axial_weight=60.0)

    KIND: ClassVar = "twist"
    FEW: ClassVar = (
        "twist", "keep_length", "length", "diameter", "edge_length", "pressure", "seed",
    )  # fmt: skip
    NEEDS: ClassVar = dict.fromkeys(("length_ratio", "axial_weight"), ("keep_length", (True,)))
    MEASURED: ClassVar = (Measurement("twist_deg", 300.0, 15e3, 300.0, "paper, measured"),)

    @property
    def laid_widths(self) -> tuple[float, float]:
        """Width in m of the lines along either family."""
        first, second = self.lines.widths
        thinner = self.target.keep_length and self.lines.second_laid_width is None
        return first, HELICES * second if thinner else second

    @property
    def line_options(self) -> LineOptions:
        """Widths and limits of the lines that are laid."""
        options = super().line_options
        if not self.target.keep_length:
            return options
        return replace(options, spacings=(2 * np.pi * self.radius / ALONG, None))

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        asked = self.target
        yield from skin.twist("twist", asked.twist, self.skin.length)
        if asked.keep_length and asked.length_ratio != 1:
            yield from skin.shortening("length_ratio", 1 - asked.length_ratio)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked, length = self.target, self.skin.length
        deform, metrics = twist(np.radians(asked.twist), length), [twist_metric(asked.twist)]
        if not asked.keep_length:
            return self.updated(axial_weight=0.0).tube_case(comm, level, deform, metrics)
        deform = compose(deform, contract(asked.length_ratio))
        metrics.append(length_metric(asked.length_ratio))
        return self.tube_case(comm, level, deform, metrics)
