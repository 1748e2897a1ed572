"""A sheet between two clamps, pulled further and further; and a tile that repeats, likewise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._types import Bools, Floats
from toros_fem._validate import require_positive
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.errors import ParameterError, PatternError
from toros_fem.materials import Composite
from toros_fem.mechanics.periodicity import Periodic
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.tile import Tile
from toros_fem.tiles.printed_tile import PrintedTile
from toros_fem.tiles.sheet import TileSheet
from toros_fem.tiles.solver import TileSolver
from toros_fem.tiles.stiffness_profile import profiles

Log = Callable[[NewtonStep], None]


@dataclass(frozen=True, eq=False)
class PullCurve:
    """What a pull at several strains comes to.

    Attributes:
        strain: λ − 1, (k,).
        stress: Nominal stress in N/m, (k,): force over undeformed width.
        contraction: Lateral contraction (1 − λ_across)/strain, (k,).
        steps: Newton steps in all.
    """

    strain: Floats
    stress: Floats
    contraction: Floats
    steps: int

    @property
    def stiffness(self) -> Floats:
        """Secant stiffness stress/strain in N/m, (k,)."""
        return np.asarray(self.stress / self.strain)


@dataclass(frozen=True, eq=False)
class PullTest:
    """A sheet pulled at its clamps.

    Attributes:
        curve: Stress by the clamps' forces; the strain is that of their distance, the contraction
            that of the middle over it.
        middle: Strain along the pull in the middle, (k,).
        forces: By which the clamps pull at the near and at the far end, (k, 2, 3), in N.
        positions: Of all vertices at the last strain, (n, 3), in m.
    """

    curve: PullCurve
    middle: Floats
    forces: Floats
    positions: Floats

    @property
    def poisson(self) -> Floats:
        """Contraction in the middle over the strain in the middle, (k,)."""
        return np.asarray(self.curve.contraction * self.curve.strain / self.middle)

    @property
    def imbalance(self) -> float:
        """Largest sum of both ends' forces, over the pull."""
        pull = np.linalg.norm(self.forces[:, 1], axis=1)
        return float(np.max(np.linalg.norm(self.forces.sum(axis=1), axis=1) / pull))


def pull(
    skin: Skin,
    composite: Composite,
    density: Floats,
    axis: int,
    strains: Sequence[float] | Floats,
    gauge: float,
    options: NewtonOptions | None = None,
    log: Log | None = None,
) -> PullTest:
    """Pull a sheet in its plane, both ends clamped, one of them moved (collective).

    The vertices of two opposite borders are held in all components, all others in z alone. What
    reaches into a clamp of a machine does not stretch, so that it need not be there.

    Args:
        skin: The sewn skin of a flat rectangle along x and y.
        composite: Materials; in its plane the sheet does not bend.
        density: Projected density of the owned triangles, in [0, 1].
        axis: 0 to pull along x, 1 along y.
        strains: λ − 1 of the clamps' distance, one after the other, none of them 0.
        gauge: Length in m along the pull, in the middle, over which strains are averaged. Whole
            tiles leave out what waves within one.
        options: How hard to try.
        log: Called with every row of the solves' history.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite; the gauge is no part of the
            length, or the axis neither 0 nor 1.
        PatternError: The skin is not a flat rectangle along x and y.
        DensityError: The density does not fit, or leaves [0, 1].
        EquilibriumError: There is no equilibrium at one of the strains.
    """
    wanted = _checked(axis, strains)
    pattern = skin.pattern
    size = _sides(pattern)
    length, width = size[axis], size[1 - axis]
    require_positive(gauge=gauge, at_most=length * (1 + FLAT))
    near, far = _borders(pattern, axis)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[:, 2] = True
    fixed[near | far] = True
    solver = EquilibriumSolver(
        skin, replace(composite, bending=None), Supports(fixed), options, log
    )
    along = np.eye(3)[axis]
    forces, middle, steps = [], [], 0
    state, positions = None, pattern.points
    for strain in wanted:
        way = np.where(far[:, None], strain * length * along, 0.0)
        result = solver.solve(density, 0.0, displacement=way, start=state)
        state, steps = result.state, steps + result.steps
        reactions = solver.reactions(result)
        forces.append([reactions[near].sum(axis=0), reactions[far].sum(axis=0)])
        positions = skin.gather_vertices(result.positions)
        middle.append(np.diagonal(_mean_gradient(pattern, positions, axis, gauge)))
    ends, stretch = np.array(forces), np.array(middle)
    stress = (ends[:, 1] - ends[:, 0]) @ along / (2 * width)
    contraction = (1 - stretch[:, 1 - axis]) / wanted
    curve = PullCurve(wanted, stress, contraction, steps)
    return PullTest(curve, stretch[:, axis] - 1, ends, positions)


def predict(
    skin: Skin,
    composite: Composite,
    tile: Tile,
    density: Floats,
    axis: int,
    strains: Sequence[float] | Floats,
) -> PullCurve:
    """What a sheet without borders would do, of the tile that repeats (collective).

    Args:
        skin: The tile's sewn skin.
        composite: Materials.
        tile: The tile.
        density: Projected density of the owned triangles, in [0, 1].
        axis: 0 to pull along x, 1 along y.
        strains: λ − 1, one after the other.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite, or the axis neither 0 nor 1.
        DensityError: The density does not fit, or leaves [0, 1].
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    wanted = _checked(axis, strains)
    solver = TileSolver(skin, composite, Periodic(tile))
    found = profiles(solver, density, [axis * np.pi / 2], wanted)
    return PullCurve(
        wanted,
        np.array([profile.stress[0] for profile in found]),
        np.array([profile.contraction[0] for profile in found]),
        sum(profile.steps for profile in found),
    )


def _checked(axis: int, strains: Sequence[float] | Floats) -> Floats:
    wanted = np.array(strains, dtype=np.float64)
    if axis not in (0, 1):
        raise ParameterError(f"axis = {axis!r} must be 0 or 1, for x or y.")
    good = np.isfinite(wanted) & (wanted > -1) & (wanted != 0)
    if wanted.ndim != 1 or not len(wanted) or not good.all():
        raise ParameterError(
            f"strains = {strains} must be at least one finite number over -1, none of them 0."
        )
    return wanted


def _sides(pattern: Pattern) -> Floats:
    """Sides of a flat rectangle along x and y, in m."""
    size = np.ptp(pattern.points, axis=0)
    area = float(pattern.areas.sum())
    if size[2] > FLAT * pattern.size or abs(area - size[0] * size[1]) > FLAT * area:
        raise PatternError(
            f"a sheet to pull must be a flat rectangle along x and y; this skin of {area:.6g} m² "
            f"spans {size[0]:.6g} m × {size[1]:.6g} m × {size[2]:.6g} m. Take `Tile.sheet` or "
            "`rectangle`."
        )
    return size


def _borders(pattern: Pattern, axis: int) -> tuple[Bools, Bools]:
    """Vertices of the near and of the far border along an axis, (n,) each."""
    place = pattern.points[:, axis]
    near = FLAT * pattern.size
    return place < place.min() + near, place > place.max() - near


def _mean_gradient(pattern: Pattern, positions: Floats, axis: int, gauge: float) -> Floats:
    """Mean deformation gradient of the middle, (2, 2): of triangles whose centroid lies there."""
    place = pattern.centroids[:, axis] - pattern.flat_points[:, axis].min()
    length = np.ptp(pattern.flat_points[:, axis])
    middle = np.abs(place - length / 2) < gauge / 2
    flat, there = (
        np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        for corners in (pattern.corners[middle], positions[pattern.triangles[middle], :2])
    )
    return np.asarray(
        np.average(there @ np.linalg.inv(flat), axis=0, weights=pattern.areas[middle])
    )


@dataclass(frozen=True, eq=False)
class PulledSheet:
    """A sheet of tiles pulled in one direction.

    Attributes:
        sheet: The sheet.
        test: Its pull test.
        predicted: Of the tile that repeats, at the same strains.
        middle: The same at the last strain that the sheet has in its middle.
    """

    sheet: TileSheet
    test: PullTest
    predicted: PullCurve
    middle: PullCurve

    def metrics(self) -> dict[str, Any]:
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
    sheet: TileSheet,
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
