"""Moduli of fabric and reinforcement from pull tests of a sheet of printed tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from scipy.interpolate import make_interp_spline

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import FileError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.skin import sew
from toros_fem.products.fitting.intervals import half_widths
from toros_fem.products.fitting.printed_sheet import MATERIALS, PrintedSheet, scaled
from toros_fem.products.fitting.result import Estimate, Fit
from toros_fem.products.fitting.robust_fit import remembered, robust_fit
from toros_fem.products.fitting.samples import Samples, samples_of
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.options import FitOptions
from toros_fem.products.tiles.printed_tile import DIRECTIONS, PrintedTile, tile_sheet

# Moduli are searched within this factor of those that the tile has.
FARTHEST = 1000.0
# An interval that reaches beyond this factor of its modulus tells nothing.
WIDE = 3.0
# Strains at which a sheet is simulated, as parts of the largest; a spline goes through them.
PARTS = (0.06, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
# Relative change at which a minimum is found, and rounds: each simulation takes long.
TOLERANCE, ROUNDS = 1e-8, 2


@dataclass(frozen=True, eq=False, kw_only=True)
class SheetFit(Fit):
    """Moduli of both materials, fitted to pull tests of a printed sheet.

    The estimates are fabric and reinforcement: Young's moduli in Pa.

    Attributes:
        composite: The tile's materials with the moduli found.
        evaluations: Number of simulated sheets.
    """

    composite: Composite
    evaluations: int

    @property
    def sizes(self) -> list[str]:
        """Further lines of the table."""
        return [
            f"{f'E h of the {name}':24}{getattr(self.composite, name).membrane_stiffness:12.4g} N/m"
            for name in MATERIALS
        ]


def fit_printed_sheet(
    comm: MPI.Comm,
    tests: Sequence[TensileTest],
    printed_tile: PrintedTile,
    along: int,
    across: int,
    options: FitOptions | None = None,
) -> SheetFit:
    """Fit the moduli of fabric and reinforcement to pull tests of a printed sheet (collective).

    The sheet is simulated between its clamps, with Poisson's ratios, thicknesses and bounds of the
    tile's materials. Stress and lateral stretch of the middle are differentiated by the adjoint.
    The stress alone tells the moduli apart only as far as their shares change with the stretch; the
    lateral stretch depends on their ratio, and tells it at once.

    Args:
        comm: Communicator.
        tests: Tests along "x" and "y" of the tile; the stretch is that of the clamps' distance.
        printed_tile: The tile, with materials to start from.
        along, across: Numbers of tiles along the pull and across it. The lateral stretch is the
            mean over one tile in the middle, or over two where the number along is even.
        options: Branch and loss. The intervals are those of the curvature of the loss, whatever is
            asked for; the options of the result say so.

    Raises:
        ParameterError: There is no test.
        FileError: A test is along another direction, or has too few points.
        NoEquilibriumError: The sheet has no equilibrium at one of the strains.
    """
    options = FitOptions() if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    options = replace(options, intervals="hessian")
    samples = on_first_rank(comm, lambda: _samples(tests, options))
    model = _SheetModel(comm, samples, printed_tile, along, across)
    curve, bound = remembered(model), np.full(2, np.log(FARTHEST))
    problem = replace(samples.problem(curve, (-bound, bound), options.loss), tolerance=TOLERANCE)
    solution = robust_fit(problem, [np.zeros(2)], ROUNDS)
    (stress, lateral), _ = curve(solution.theta)
    composite = scaled(printed_tile.composite, np.exp(solution.theta))
    estimates = {}
    for name, half in zip(MATERIALS, half_widths(problem, solution), strict=True):
        young, wider = getattr(composite, name).young, float(np.exp(half))
        estimates[name] = Estimate(young, young / wider, young * wider, wider < WIDE, "Pa")
    return SheetFit(
        estimates=estimates,
        samples=samples,
        stress=stress,
        lateral=lateral,
        options=options,
        composite=composite,
        evaluations=model.evaluations,
    )


def _samples(tests: Sequence[TensileTest], options: FitOptions) -> Samples:
    samples = samples_of(tests, options)
    for specimen, direction in zip(samples.specimen, samples.direction, strict=True):
        if direction not in DIRECTIONS:
            raise FileError(
                f"specimen {specimen!r} was pulled along {direction!r}: a sheet of tiles is pulled "
                "along 'x' or 'y' of the tile. Name the direction so."
            )
    return samples


class _SheetModel:
    """Stress and lateral stretch at all points, by the logarithms of both factors."""

    def __init__(
        self, comm: MPI.Comm, samples: Samples, printed: PrintedTile, along: int, across: int
    ) -> None:
        self.samples, self.evaluations = samples, 0
        meshed, inside = printed.tile(comm)
        self._sheets = {}
        for direction in dict.fromkeys(samples.direction):
            sheet = tile_sheet(meshed, direction, along, across)
            gauge = (2 - along % 2) * printed.size[sheet.axis]
            skin = sew(comm, sheet.pattern)
            cells = inside[sheet.cell]
            density = cells[skin.owned_cells].astype(np.float64)
            self._sheets[direction] = PrintedSheet(
                skin, printed.composite, density, sheet.axis, gauge, quadratic=cells
            )

    def __call__(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the values, (2, n), and their derivatives, (2, n, 2) (collective)."""
        samples, rest = self.samples, np.array([[0.0], [1.0]])
        values, slopes = np.empty((2, len(samples.strain))), np.empty((2, len(samples.strain), 2))
        for direction, sheet in self._sheets.items():
            rows = samples.along(direction)
            strains = float(samples.strain[rows].max()) * np.array(PARTS)
            # Equal to the last bit on all ranks, so that they take the same steps.
            found, changes = sheet.skin.comm.bcast(sheet.curve(np.exp(theta), strains), root=0)
            self.evaluations += 1
            table = np.insert(np.dstack([found - rest, changes]), 0, 0.0, axis=1)
            spline = make_interp_spline(np.append(0.0, strains), table, k=3, axis=1)
            at = spline(samples.strain[rows])
            values[:, rows], slopes[:, rows] = at[..., 0] + rest, at[..., 1:]
        return values, slopes
