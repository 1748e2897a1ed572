"""A sheet of tiles is pulled, and beside it what is predicted of the tile that repeats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.meshes.skin import sew
from toros_fem.meshes.tile import Tile
from toros_fem.newton import NewtonStep
from toros_fem.pull_test import PullCurve, PullTest, predict, pull
from toros_fem.sample import Sheet
from toros_fem.tile_file import PrintedTile

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PulledSheet:
    """A sheet of tiles pulled in one direction.

    Attributes:
        sheet: The sheet.
        test: Its pull test.
        predicted: Of the tile that repeats, at the same strains.
        middle: The same at the last strain that the sheet has in its middle.
    """

    sheet: Sheet
    test: PullTest
    predicted: PullCurve
    middle: PullCurve

    def figures(self) -> dict[str, Any]:
        """What it comes to at the largest strain."""
        test, curve, predicted = self.test, self.test.curve, self.predicted
        return {
            "stiffness_n_per_m": float(curve.stiffness[-1]),
            "stiffness_predicted_n_per_m": float(predicted.stiffness[-1]),
            "stiffness_ratio": float(curve.stiffness[-1] / predicted.stiffness[-1]),
            "contraction": float(curve.contraction[-1]),
            "contraction_predicted": float(predicted.contraction[-1]),
            "middle": {
                "strain": float(test.middle[-1]),
                "stress_ratio": float(curve.stress[-1] / self.middle.stress[-1]),
                "contraction": float(test.poisson[-1]),
                "contraction_predicted": float(self.middle.contraction[-1]),
            },
            "ends_imbalance": test.imbalance,
            "newton_steps": curve.steps,
        }

    def rows(self) -> list[dict[str, Any]]:
        """The curve, a row for each strain."""
        curve, predicted = self.test.curve, self.predicted
        columns = {
            "strain": curve.strain,
            "stress_n_per_m": curve.stress,
            "stress_predicted_n_per_m": predicted.stress,
            "contraction": curve.contraction,
            "contraction_predicted": predicted.contraction,
            "middle_strain": self.test.middle,
        }
        return [
            {"direction": self.sheet.name, **{name: float(v[k]) for name, v in columns.items()}}
            for k in range(len(curve.strain))
        ]


def pull_sheet(
    comm: MPI.Comm,
    sheet: Sheet,
    tile: Tile,
    printed: PrintedTile,
    strains: Floats,
    log: Callable[[NewtonStep], None] | None = None,
) -> PulledSheet:
    """Pull a sheet, and the tile that it is made of (collective).

    Its middle is one or two whole tiles long.

    Args:
        comm: Communicator.
        sheet: The sheet.
        tile: The tile on its mesh, `printed.tile(comm)`.
        printed: What is printed on it, and the materials.
        strains: λ − 1, one after the other.
        log: Called with every row of the sheet's solves.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite.
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    density, composite, axis = printed.printed.astype(np.float64), printed.composite, sheet.axis
    length = printed.size[axis]
    tiles = round(np.ptp(sheet.pattern.flat_points[:, axis]) / length)
    skin, torus = sew(comm, sheet.pattern), sew(comm, tile.pattern)
    own = density[sheet.cell][skin.owned_cells]
    test = pull(skin, composite, own, axis, strains, (2 - tiles % 2) * length, log=log)
    own = density[torus.owned_cells]
    predicted, middle = (
        predict(torus, composite, tile, own, axis, at) for at in (strains, test.middle[-1:])
    )
    return PulledSheet(sheet, test, predicted, middle)
