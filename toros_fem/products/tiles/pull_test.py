"""Simulated pull test of a clamped sheet, and the prediction by the periodic tile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.validation import require_positive
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton_step import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.makers.tile import Tile
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin, sew
from toros_fem.products.tiles.printed_tile import PrintedTile
from toros_fem.products.tiles.sheet import TileSheet
from toros_fem.products.tiles.solver import TileSolver
from toros_fem.products.tiles.stiffness_profile import profiles

Log = Callable[[NewtonStep | str], None]


@dataclass(frozen=True, eq=False)
class PullCurve:
    """Stress and lateral contraction over strain.

    Attributes:
        strain: λ − 1, (k,).
        stress: Nominal stress in N/m, (k,): force over undeformed width.
        contraction: Lateral contraction (1 − λ_across)/strain, (k,).
        steps: Number of Newton steps of all solves.
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
    """The result of a pull test.

    Attributes:
        curve: Stress from the forces at the clamps over the strain of their distance; contraction
            is the lateral one of the middle over this strain.
        middle_strain: Strain along the pull in the middle, (k,).
        forces: Forces on the near and on the far end, (k, 2, 3), in N.
        positions: Positions of all vertices at the last strain, (n, 3), in m.
    """

    curve: PullCurve
    middle_strain: Floats
    forces: Floats
    positions: Floats

    @property
    def middle_contraction(self) -> Floats:
        """Lateral contraction of the middle over the strain of the middle, (k,)."""
        return np.asarray(self.curve.contraction * self.curve.strain / self.middle_strain)

    @property
    def imbalance(self) -> float:
        """Largest sum of the forces on both ends, relative to the force on one."""
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
    """Pull a sheet in its plane: both ends are clamped, one of them moves (collective).

    The vertices of two opposite borders are fixed in all components, all others in z. The part of a
    real sheet inside the clamps of a machine does not stretch, so it is not modelled.

    Args:
        skin: The sewn skin of a flat rectangle along x and y.
        composite: Materials; bending is left out, since the sheet stays in its plane.
        density: Projected density of the owned triangles, in [0, 1].
        axis: 0 to pull along x, 1 along y.
        strains: Values of λ − 1 of the clamps' distance, in the order of the pull, none of them 0.
        gauge: Length in m of the middle part that strains are averaged over. A whole number of
            tiles averages out the variation within one.
        options: Options of the equilibrium solver.
        log: Called with every row of the solver's history.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite; the gauge is longer than the
            sheet; or the axis is neither 0 nor 1.
        PatternError: The skin is not a flat rectangle along x and y.
        DensityError: The density does not fit, or leaves [0, 1].
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    given = _checked_strains(axis, strains)
    machine = PullMachine(skin, composite, axis, gauge, options, log)
    forces, middle, steps = [], [], 0
    result, positions = None, skin.pattern.points
    for strain in given:
        result = machine.solve(density, strain, result)
        steps += result.steps
        forces.append(machine.forces(result))
        positions = skin.gather_vertices(result.positions)
        middle.append(machine.middle_stretch(positions))
    ends, stretch = np.array(forces), np.array(middle)
    along = np.eye(3)[axis]
    stress = (ends[:, 1] - ends[:, 0]) @ along / (2 * machine.width)
    contraction = (1 - stretch[:, 1 - axis]) / given
    curve = PullCurve(given, stress, contraction, steps)
    return PullTest(curve, stretch[:, axis] - 1, ends, positions)


class PullMachine:
    """A sheet between two clamps, one of which moves.

    Attributes:
        solver: Solver of its equilibria.
        axis: 0 for a pull along x, 1 along y.
        length, width: Sides of the sheet along the pull and across it, in m.
        near, far: Whether each vertex is in the clamp at rest, and in the moving one, (n,).

    Args:
        skin, composite, axis, gauge, options, log: As for `pull`.

    Raises:
        ParameterError: The gauge is longer than the sheet.
        PatternError: The skin is not a flat rectangle along x and y.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        axis: int,
        gauge: float,
        options: NewtonOptions | None = None,
        log: Log | None = None,
    ) -> None:
        pattern = skin.pattern
        size = _sides(pattern)
        self.axis, self.length, self.width = axis, float(size[axis]), float(size[1 - axis])
        require_positive(gauge=gauge, at_most=self.length * (1 + FLAT))
        self.gauge = gauge
        self.near, self.far = _borders(pattern, axis)
        fixed = np.zeros(pattern.points.shape, dtype=bool)
        fixed[:, 2] = True
        fixed[self.near | self.far] = True
        self.solver = EquilibriumSolver(
            skin, replace(composite, bending=None), Supports(fixed), options, log
        )

    def solve(self, density: Floats, strain: float, start: Equilibrium | None) -> Equilibrium:
        """Return the equilibrium at a strain of the clamps' distance (collective)."""
        along = np.eye(3)[self.axis]
        displacement = np.where(self.far[:, None], strain * self.length * along, 0.0)
        return self.solver.solve(density, Load(displacement=displacement), start)

    def forces(self, result: Equilibrium) -> Floats:
        """Return the forces in N on the near and on the far end, (2, 3) (collective)."""
        reactions = self.solver.reactions(result)
        return np.stack([reactions[end].sum(axis=0) for end in (self.near, self.far)])

    def middle_stretch(self, positions: Floats) -> Floats:
        """Return the mean stretches of the middle along x and y, (2,).

        Args:
            positions: Positions of all vertices in m, (n, 3).
        """
        pattern = self.solver.skin.pattern
        return np.diagonal(_mean_gradient(pattern, positions, self.axis, self.gauge))

    def lateral_weights(self) -> Floats:
        """Return the derivative of the middle's mean lateral stretch by all positions, (n, 3)."""
        pattern, across = self.solver.skin.pattern, 1 - self.axis
        middle, flat = _middle(pattern, self.axis, self.gauge)
        areas = pattern.areas[middle]
        # Of F = D G, with the edges D of a triangle and the inverse G of its flat ones.
        inverse = np.linalg.inv(flat)[:, :, across] * (areas / areas.sum())[:, None]
        out = np.zeros(pattern.points.shape)
        corners = pattern.triangles[middle]
        np.add.at(out[:, across], corners[:, 1], inverse[:, 0])
        np.add.at(out[:, across], corners[:, 2], inverse[:, 1])
        np.add.at(out[:, across], corners[:, 0], -inverse.sum(axis=1))
        return out


def predict(
    skin: Skin,
    composite: Composite,
    tile: Tile,
    density: Floats,
    axis: int,
    strains: Sequence[float] | Floats,
) -> PullCurve:
    """Predict the pull of an unlimited sheet by the periodic tile (collective).

    Args:
        skin: The tile's sewn skin.
        composite: Materials.
        tile: The tile.
        density: Projected density of the owned triangles, in [0, 1].
        axis: 0 to pull along x, 1 along y.
        strains: Values of λ − 1, in the order of the pull.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite; or the axis is neither 0 nor 1.
        DensityError: The density does not fit, or leaves [0, 1].
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    given = _checked_strains(axis, strains)
    solver = TileSolver(skin, composite, Periodic(tile))
    found = profiles(solver, density, [axis * np.pi / 2], given)
    return PullCurve(
        given,
        np.array([profile.stress[0] for profile in found]),
        np.array([profile.contraction[0] for profile in found]),
        sum(profile.steps for profile in found),
    )


def _checked_strains(axis: int, strains: Sequence[float] | Floats) -> Floats:
    given = np.array(strains, dtype=np.float64)
    if axis not in (0, 1):
        raise ParameterError(f"axis = {axis!r} must be 0 or 1, for x or y.")
    good = np.isfinite(given) & (given > -1) & (given != 0)
    if given.ndim != 1 or not len(given) or not good.all():
        raise ParameterError(
            f"strains = {strains} must be at least one finite number above -1, none of them 0."
        )
    return given


def _sides(pattern: Pattern) -> Floats:
    """Return the sides of a flat rectangle along x and y, in m."""
    size = np.ptp(pattern.points, axis=0)
    area = float(pattern.areas.sum())
    if size[2] > FLAT * pattern.size or abs(area - size[0] * size[1]) > FLAT * area:
        raise PatternError(
            f"a sheet to pull must be a flat rectangle along x and y; this skin of {area:.6g} m² "
            f"spans {size[0]:.6g} m × {size[1]:.6g} m × {size[2]:.6g} m. Make it by `Tile.sheet` "
            "or `rectangle`."
        )
    return size


def _borders(pattern: Pattern, axis: int) -> tuple[Bools, Bools]:
    """Return which vertices lie on the near and on the far border along an axis, (n,) each."""
    place = pattern.points[:, axis]
    tolerance = FLAT * pattern.size
    return place < place.min() + tolerance, place > place.max() - tolerance


def _middle(pattern: Pattern, axis: int, gauge: float) -> tuple[Bools, Floats]:
    """Return which triangles lie within the gauge by centroids, and their flat edges, (m, 2, 2)."""
    place = pattern.centroids[:, axis] - pattern.flat_points[:, axis].min()
    length = np.ptp(pattern.flat_points[:, axis])
    middle = np.abs(place - length / 2) < gauge / 2
    return middle, _edges(pattern.corners[middle])


def _edges(corners: Floats) -> Floats:
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)


def _mean_gradient(pattern: Pattern, positions: Floats, axis: int, gauge: float) -> Floats:
    """Return the mean deformation gradient of the middle, (2, 2)."""
    middle, flat = _middle(pattern, axis, gauge)
    deformed = _edges(positions[pattern.triangles[middle], :2])
    return np.asarray(
        np.average(deformed @ np.linalg.inv(flat), axis=0, weights=pattern.areas[middle])
    )


@dataclass(frozen=True, eq=False)
class PulledSheet:
    """A pulled sheet of tiles beside the prediction by the periodic tile.

    Attributes:
        sheet: The sheet.
        test: Its pull test.
        predicted: Prediction at the strains of the clamps.
        predicted_middle: Prediction at the last strain of the middle.
    """

    sheet: TileSheet
    test: PullTest
    predicted: PullCurve
    predicted_middle: PullCurve

    def summary(self) -> dict[str, Any]:
        """Return test and prediction at the largest strain, as summaries hold them."""
        test, curve, predicted = self.test, self.test.curve, self.predicted
        return {
            "stiffness_n_per_m": float(curve.stiffness[-1]),
            "stiffness_predicted_n_per_m": float(predicted.stiffness[-1]),
            "stiffness_ratio": float(curve.stiffness[-1] / predicted.stiffness[-1]),
            "contraction": float(curve.contraction[-1]),
            "contraction_predicted": float(predicted.contraction[-1]),
            "middle": {
                "strain": float(test.middle_strain[-1]),
                "stress_ratio": float(curve.stress[-1] / self.predicted_middle.stress[-1]),
                "contraction": float(test.middle_contraction[-1]),
                "contraction_predicted": float(self.predicted_middle.contraction[-1]),
            },
            "ends_imbalance": test.imbalance,
            "newton_steps": curve.steps,
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return the curves as rows of a table, one for each strain."""
        curve, predicted = self.test.curve, self.predicted
        columns = {
            "strain": curve.strain,
            "stress_n_per_m": curve.stress,
            "stress_predicted_n_per_m": predicted.stress,
            "contraction": curve.contraction,
            "contraction_predicted": predicted.contraction,
            "middle_strain": self.test.middle_strain,
        }
        direction = self.sheet.direction
        return [
            {"direction": direction, **{name: float(v[k]) for name, v in columns.items()}}
            for k in range(len(curve.strain))
        ]


def pull_sheet(
    comm: MPI.Comm,
    sheet: TileSheet,
    tile: Tile,
    printed_tile: PrintedTile,
    strains: Floats,
    log: Log | None = None,
) -> PulledSheet:
    """Pull a sheet, and the periodic tile that it is made of (collective).

    Strains of the middle are averaged over one tile, or over two where the number of tiles is even.

    Args:
        comm: Communicator.
        sheet: The sheet.
        tile: The tile on its mesh, `printed_tile.tile(comm)`.
        printed_tile: Its print and its materials.
        strains: Values of λ − 1, in the order of the pull.
        log: Called with every row of the sheet's solves.

    Raises:
        ParameterError: A strain is 0, −1 or less, or not finite.
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    density, axis = printed_tile.printed.astype(np.float64), sheet.axis
    composite, length = printed_tile.composite, printed_tile.size[axis]
    tiles = round(np.ptp(sheet.pattern.flat_points[:, axis]) / length)
    skin, torus = sew(comm, sheet.pattern), sew(comm, tile.pattern)
    owned = density[sheet.cell][skin.owned_cells]
    test = pull(skin, composite, owned, axis, strains, (2 - tiles % 2) * length, log=log)
    owned = density[torus.owned_cells]
    predicted, predicted_middle = (
        predict(torus, composite, tile, owned, axis, at)
        for at in (strains, test.middle_strain[-1:])
    )
    return PulledSheet(sheet, test, predicted, predicted_middle)
