"""The strip as it is really tested: clamps hold its width, so that it is stiffer at its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import require_comm
from toros_fem.base.validation import require_count, require_positive
from toros_fem.materials.sheet import Composite, Knit, Material
from toros_fem.meshes.makers.sheets import rectangle
from toros_fem.meshes.skin import sew
from toros_fem.products.fitting.uniaxial import uniaxial_curve
from toros_fem.products.tiles.pull_test import PullMachine

# Strains at which the strip is simulated, as parts of the largest.
PARTS = (0.03, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88, 1.0)


@dataclass(frozen=True)
class ClampedStrip:
    """A strip between clamps that hold its width; the stretch is that of their distance.

    Attributes:
        comm: Communicator that simulates it.
        length: Distance of the clamps in m, undeformed.
        width: Width in m.
        gauge: Length in m of the middle in which the lateral stretch is measured; None takes the
            width, or half the length of a short strip.
        edges: Number of the mesh's edges across the width.

    Raises:
        ParameterError: A length is not positive, the gauge is longer than the strip, or there is
            no edge.
    """

    comm: MPI.Comm
    length: float
    width: float
    gauge: float | None = None
    edges: int = 6

    def __post_init__(self) -> None:
        require_comm(self.comm)
        require_positive(length=self.length, width=self.width)
        require_count(2, edges=self.edges)
        if self.gauge is not None:
            require_positive(gauge=self.gauge, at_most=self.length)
        if self.width > 20 * self.length or self.length > 100 * self.width:
            raise ParameterError(
                f"a strip of {self.length:g} m × {self.width:g} m is no strip: are both in m?"
            )

    def correction(
        self,
        material: Material,
        strain: Floats,
        *,
        knit_ratio: float = 1.0,
        direction: str = "wale",
    ) -> tuple[Floats, Floats]:
        """Return what the clamps change, by simulation (collective).

        Args:
            material, knit_ratio, direction: As of `uniaxial_curve`.
            strain: Strains of the clamps' distance, (n,).

        Returns:
            The factor on the stress of a free strip, (n,), and the difference of the middle's
            lateral stretch from that of a free strip, (n,).

        Raises:
            NoEquilibriumError: The strip has no equilibrium at one of the strains.
        """
        at = float(np.max(strain)) * np.array(PARTS)
        edge = min(self.length, self.width) / self.edges
        skin = sew(self.comm, rectangle(self.comm, self.length, self.width, edge, "crossed"))
        grain = 0.0 if direction == "course" else np.pi / 2
        knit = Knit(knit_ratio, grain) if knit_ratio > 1 else None
        composite = Composite(material, material, bending=None, knit=knit)
        gauge = self.gauge or min(self.width, self.length / 2)
        machine = PullMachine(skin, composite, 0, gauge)
        curve = machine.pull(np.zeros(len(skin.owned_cells)), at)
        free, lateral = uniaxial_curve(material, 1 + at, knit_ratio=knit_ratio, direction=direction)
        factor, shift = curve.stress / free, 1 - curve.contraction * at - lateral
        # At rest the factor is that of the smallest strain, and nothing is shifted.
        changes = np.array([[factor[0], *factor], [0.0, *shift]])
        found = PchipInterpolator(np.append(0.0, at), changes, axis=1)(strain)
        return found[0], found[1]
