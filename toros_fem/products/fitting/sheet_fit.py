"""Moduli of fabric and reinforcement from pull tests of a sheet of printed tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.interpolate import make_interp_spline
from scipy.optimize import least_squares
from scipy.stats import t as student

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import MeasurementError
from toros_fem.base.mpi import on_first_rank, require_alike
from toros_fem.base.validation import require_kind
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.skin import sew
from toros_fem.products.fitting.fitting import (
    EXACT,
    LOSS,
    TUNING,
    FitOptions,
    Samples,
    influence,
    samples_of,
)
from toros_fem.products.fitting.intervals import CONFIDENCE
from toros_fem.products.fitting.printed_sheet import PrintedSheet, scaled
from toros_fem.products.fitting.result import Estimate, Fit
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.tiles.printed_tile import PrintedTile
from toros_fem.products.tiles.sheet import DIRECTIONS, tile_sheet

NAMES = ("fabric", "reinforcement")
# Moduli are searched within this factor of those that the tile has.
FARTHEST = 1000.0
# Strains at which a sheet is simulated, as parts of the largest; a spline goes through them.
PARTS = (0.06, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
ROUNDS = 3


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
            for name in NAMES
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
        options: Branch and loss; the intervals are those of the curvature of the loss.

    Raises:
        MeasurementError: There is no test, or one in another direction.
        NoEquilibriumError: The sheet has no equilibrium at one of the strains.
    """
    options = FitOptions(intervals="hessian") if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    require_alike(comm, along=along, across=across)
    samples = on_first_rank(comm, lambda: _samples(tests, options))
    model = _SheetModel(comm, samples, printed_tile, along, across)
    sigma = np.where(samples.is_stress, 0.05 * np.abs(samples.stress).max(), 0.02)
    theta, bound = np.zeros(2), np.log(FARTHEST)
    measured = samples.measured
    for _ in range(ROUNDS):
        found = least_squares(
            lambda x, sigma=sigma: (model.at(x)[0] - measured) / sigma,
            theta,
            lambda x, sigma=sigma: model.at(x)[1] / sigma[:, None],
            (-bound, bound),
            loss=LOSS[options.loss],
            f_scale=TUNING,
            xtol=1e-8,
            ftol=1e-8,
        )
        theta = found.x
        sigma = _spread(measured - model.at(theta)[0], samples)
    values, slopes = model.at(theta)
    half, identified = _half_widths((measured - values) / sigma, slopes, sigma, options, bound)
    composite = scaled(printed_tile.composite, np.exp(theta))
    stress, lateral = model.curve(theta)
    return SheetFit(
        estimates={
            name: Estimate(
                getattr(composite, name).young,
                getattr(composite, name).young * float(np.exp(-width)),
                getattr(composite, name).young * float(np.exp(width)),
                known,
                "Pa",
            )
            for name, width, known in zip(NAMES, half, identified, strict=True)
        },
        samples=samples,
        stress=stress,
        lateral=lateral,
        specimens=tuple(test.specimen for test in tests),
        options=options,
        composite=composite,
        evaluations=model.evaluations,
    )


def _samples(tests: Sequence[TensileTest], options: FitOptions) -> Samples:
    if not isinstance(tests, list | tuple) or not tests:
        raise MeasurementError("there is no test of the sheet.")
    for test in tests:
        require_kind("tests", test, TensileTest, "a list of TensileTest")
        if test.direction not in DIRECTIONS:
            raise MeasurementError(
                f"specimen {test.specimen!r} was pulled along {test.direction!r}: a sheet of tiles "
                "is pulled along 'x' or 'y' of the tile. Name the direction so."
            )
    return samples_of(tests, options)


class _SheetModel:
    """Stress and lateral stretch at all points, by the logarithms of both factors."""

    def __init__(
        self, comm: MPI.Comm, samples: Samples, printed: PrintedTile, along: int, across: int
    ) -> None:
        self.samples, self.evaluations = samples, 0
        meshed = printed.tile(comm)
        names = np.array(samples.direction)[samples.test]
        self.parts: list[tuple[PrintedSheet, Ints, Floats]] = []
        for direction in dict.fromkeys(samples.direction):
            rows = np.flatnonzero(names == direction)
            sheet = tile_sheet(meshed, direction, along, across)
            strains = float(samples.strain[rows].max()) * np.array(PARTS)
            gauge = (2 - along % 2) * printed.size[sheet.axis]
            skin = sew(comm, sheet.pattern)
            density = printed.printed.astype(np.float64)[sheet.cell][skin.owned_cells]
            pulled = PrintedSheet(skin, printed.composite, density, sheet.axis, gauge)
            self.parts.append((pulled, rows, strains))
        self._known: dict[bytes, tuple[Floats, Floats]] = {}

    def _solve(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return values (n, 2) and derivatives (n, 2, 2) of stress and lateral stretch."""
        key = theta.tobytes()
        if key not in self._known:
            samples = self.samples
            values = np.empty((len(samples.strain), 2))
            slopes = np.empty((len(samples.strain), 2, 2))
            for sheet, rows, strains in self.parts:
                # Equal to the last bit on all ranks, so that they take the same steps.
                found = sheet.skin.comm.bcast(sheet.curve(np.exp(theta), strains), root=0)
                self.evaluations += 1
                table = np.column_stack(
                    [found.stress, found.lateral - 1, found.stress_by, found.lateral_by]
                )
                spline = make_interp_spline(
                    np.append(0.0, strains), np.vstack([np.zeros(6), table]), k=3
                )
                at = spline(samples.strain[rows])
                values[rows] = at[:, :2] + [0.0, 1.0]
                slopes[rows] = at[:, 2:].reshape(-1, 2, 2)
            self._known[key] = values, slopes
        return self._known[key]

    def curve(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return stress and lateral stretch at all points (collective)."""
        values, _ = self._solve(theta)
        return values[:, 0], values[:, 1]

    def at(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the values of `Samples.measured` and their derivatives (collective)."""
        values, slopes = self._solve(theta)
        seen = self.samples.has_lateral
        return (
            np.concatenate([values[:, 0], values[seen, 1]]),
            np.concatenate([slopes[:, 0], slopes[seen, 1]]),
        )


def _spread(residuals: Floats, samples: Samples) -> Floats:
    """Return the standard deviation of stresses and of lateral stretches."""
    top = float(np.abs(samples.stress).max())
    sigma = np.empty(len(residuals))
    for own, least in ((samples.is_stress, EXACT * top), (~samples.is_stress, EXACT)):
        if own.any():
            count = int(own.sum())
            spread = np.sqrt(float(residuals[own] @ residuals[own]) / max(count - 1, 1))
            sigma[own] = max(float(spread), least)
    return sigma


def _half_widths(
    residuals: Floats, slopes: Floats, sigma: Floats, options: FitOptions, bound: float
) -> tuple[Floats, list[bool]]:
    """Return half the width of each interval of ln E, and whether it is within the bounds."""
    J = slopes / sigma[:, None]
    psi, bend = influence(residuals, LOSS[options.loss])
    degrees = max(len(residuals) - 2, 1)
    variance = float(psi @ psi) / degrees / max(float(bend.mean()), 0.1) ** 2
    precision = J.T @ J / max(variance, 1e-12) + np.eye(2) / bound**2
    deviation = np.sqrt(np.diagonal(np.linalg.inv(precision)))
    half = student.ppf(0.5 + CONFIDENCE / 2, degrees) * deviation
    return half, [bool(width < np.log(3.0)) for width in half]
