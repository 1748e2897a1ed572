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
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin, sew
from toros_fem.products.tiles.printed_tile import TileSheet
from toros_fem.products.tiles.stiffness_profile import profiles, tile_solver

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
class PullTest(PullCurve):
    """The result of a pull test, over the strain of the clamps' distance.

    The stress is that of the forces at the clamps, the contraction that of the middle.

    Attributes:
        middle_strain: Strain along the pull in the middle, (k,).
        forces: Forces on the near and on the far end, (k, 2, 3), in N.
        positions: Positions of all vertices at the last strain, (n, 3), in m.
    """

    middle_strain: Floats
    forces: Floats
    positions: Floats

    @property
    def middle_contraction(self) -> Floats:
        """Lateral contraction of the middle over the strain of the middle, (k,)."""
        return np.asarray(self.contraction * self.strain / self.middle_strain)

    @property
    def imbalance(self) -> float:
        """Largest sum of the forces on both ends, relative to the force on one."""
        pull = np.linalg.norm(self.forces[:, 1], axis=1)
        return float(np.max(np.linalg.norm(self.forces.sum(axis=1), axis=1) / pull))


class PullMachine:
    """A sheet between two clamps, one of which moves in the sheet's plane.

    The vertices of two opposite borders are fixed in all components, all others in z. The part of a
    real sheet inside the clamps of a machine does not stretch, so it is not modelled. All methods
    are collective.

    Attributes:
        solver: Solver of its equilibria.
        length, width: Sides of the sheet along the pull and across it, in m.
        near, far: Whether each vertex is in the clamp at rest, and in the moving one, (n,).
        stretch_weights: Factors (n, 2) of the vertices' x and y in the mean stretches of the middle
            along x and y, which are linear in them.

    Args:
        skin: The sewn skin of a flat rectangle along x and y.
        composite: Materials; bending is left out, since the sheet stays in its plane.
        axis: 0 for a pull along x, 1 along y.
        gauge: Length in m of the middle part that strains are averaged over. A whole number of
            tiles averages out the variation within one.
        options: Options of the equilibrium solver.
        log: Called with every row of the solver's history.
        quadratic: As of `EquilibriumSolver`.

    Raises:
        ParameterError: The gauge is longer than the sheet, or the axis is neither 0 nor 1.
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
        quadratic: Bools | None = None,
    ) -> None:
        if axis not in (0, 1):
            raise ParameterError(f"axis = {axis!r} must be 0 or 1, for x or y.")
        pattern = skin.pattern
        size, area = np.ptp(pattern.points, axis=0), float(pattern.areas.sum())
        if size[2] > FLAT * pattern.size or abs(area - size[0] * size[1]) > FLAT * area:
            raise PatternError(
                f"a sheet to pull must be a flat rectangle along x and y; this skin of {area:.6g} "
                f"m² spans {size[0]:.6g} m × {size[1]:.6g} m × {size[2]:.6g} m. Make it by "
                "`Tile.sheet` or `rectangle`."
            )
        self.axis, self.length, self.width = axis, float(size[axis]), float(size[1 - axis])
        require_positive(gauge=gauge, at_most=self.length * (1 + FLAT))
        place, tolerance = pattern.points[:, axis], FLAT * pattern.size
        self.near, self.far = place < place.min() + tolerance, place > place.max() - tolerance
        self.stretch_weights = _stretch_weights(pattern, axis, gauge)
        fixed = np.zeros(pattern.points.shape, dtype=bool)
        fixed[:, 2], fixed[self.near | self.far] = True, True
        self.solver = EquilibriumSolver(
            skin, replace(composite, bending=None), Supports(fixed), options, log,
            quadratic=quadratic,
        )  # fmt: skip

    def pull(self, density: Floats, strains: Sequence[float] | Floats) -> PullTest:
        """Pull the sheet from one strain to the next.

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            strains: Values of λ − 1 of the clamps' distance, (k,), in the order of the pull, none
                of them 0.

        Raises:
            ParameterError: A strain is 0, −1 or less, or not finite. The density does not fit, or
                leaves [0, 1].
            NoEquilibriumError: There is no equilibrium at one of the strains.
        """
        given = np.array(strains, dtype=np.float64)
        good = np.isfinite(given) & (given > -1) & (given != 0)
        if given.ndim != 1 or not len(given) or not good.all():
            raise ParameterError(
                f"strains = {strains} must be at least one finite number above -1, none of them 0."
            )
        result, positions, steps = None, self.solver.skin.pattern.points, 0
        forces: Floats = np.empty((len(given), 2, 3))
        stretch: Floats = np.empty((len(given), 2))
        for k, strain in enumerate(given):
            result = self.solve(density, strain, result)
            positions = self.solver.skin.gather_vertices(result.positions)
            forces[k], stretch[k] = self.forces(result), self.middle_stretch(positions)
            steps += result.steps
        along, across = stretch[:, self.axis], stretch[:, 1 - self.axis]
        stress = np.asarray((forces[:, 1] - forces[:, 0])[:, self.axis] / (2 * self.width))
        contraction = (1 - across) / given
        return PullTest(given, stress, contraction, steps, along - 1, forces, positions)

    def solve(self, density: Floats, strain: float, start: Equilibrium | None) -> Equilibrium:
        """Return the equilibrium at a strain of the clamps' distance."""
        along = np.eye(3)[self.axis]
        displacement = np.where(self.far[:, None], strain * self.length * along, 0.0)
        return self.solver.solve(density, Load(displacement=displacement), start)

    def forces(self, result: Equilibrium) -> Floats:
        """Return the forces in N on the near and on the far end, (2, 3)."""
        reactions = self.solver.reactions(result)
        return np.stack([reactions[end].sum(axis=0) for end in (self.near, self.far)])

    def middle_stretch(self, positions: Floats) -> Floats:
        """Return the mean stretches of the middle along x and y, (2,), of all positions (n, 3)."""
        return np.asarray(np.sum(self.stretch_weights * positions[:, :2], axis=0))


def _stretch_weights(pattern: Pattern, axis: int, gauge: float) -> Floats:
    """Return the factors of all vertices' x and y in the mean stretches of the middle, (n, 2)."""
    place = pattern.centroids[:, axis] - pattern.flat_points[:, axis].min()
    middle = np.abs(place - np.ptp(pattern.flat_points[:, axis]) / 2) < gauge / 2
    corners, areas = pattern.corners[middle], pattern.areas[middle]
    # The gradients of the shape functions of the second and third corner, and so of the first.
    slopes = np.swapaxes(np.linalg.inv(corners[:, 1:] - corners[:, :1]), 1, 2)
    slopes = np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)
    weights: Floats = np.zeros((len(pattern.points), 2))
    np.add.at(weights, pattern.triangles[middle], slopes * (areas / areas.sum())[:, None, None])
    return weights


def predict(
    solver: EquilibriumSolver, density: Floats, axis: int, strains: Sequence[float] | Floats
) -> PullCurve:
    """Predict the pull of an unlimited sheet along x or y by the periodic tile (collective)."""
    found = profiles(solver, density, [axis * np.pi / 2], strains)
    strain, stress, contraction = np.transpose(
        [(one.strain, one.stress[0], one.contraction[0]) for one in found]
    )
    return PullCurve(strain, stress, contraction, sum(one.steps for one in found))


@dataclass(frozen=True, eq=False)
class PulledSheet:
    """A pulled sheet of tiles beside predictions by the periodic tile.

    They are at the strains of the clamps, and at the last strain of the middle.
    """

    sheet: TileSheet
    test: PullTest
    predicted: PullCurve
    predicted_middle: PullCurve

    @property
    def stiffness(self) -> tuple[float, float]:
        """Stiffness of the middle at the last strain, and that predicted at its strain, in N/m."""
        pulled = float(self.test.stress[-1] / self.test.middle_strain[-1])
        return pulled, float(self.predicted_middle.stiffness[-1])

    @property
    def contraction(self) -> tuple[float, float]:
        """Contraction of the middle at the last strain, and that predicted at its strain."""
        return float(self.test.middle_contraction[-1]), float(self.predicted_middle.contraction[-1])

    def summary(self) -> dict[str, Any]:
        """Return test and prediction at the largest strain, as summaries hold them."""
        (stiffness, predicted), contraction = self.stiffness, self.contraction
        clamped, last = float(self.test.stiffness[-1]), self.rows()[-1]
        return {
            "strain": last["middle_strain"],
            "stiffness_n_per_m": stiffness,
            "stiffness_predicted_n_per_m": predicted,
            "stiffness_ratio": stiffness / predicted,
            "contraction": contraction[0],
            "contraction_predicted": contraction[1],
            "between_clamps": {
                "strain": last["strain"],
                "stiffness_n_per_m": clamped,
                "stiffness_predicted_n_per_m": float(self.predicted.stiffness[-1]),
                "contraction": last["contraction"],
                "contraction_predicted": last["contraction_predicted"],
            },
            "ends_imbalance": self.test.imbalance,
            "newton_steps": self.test.steps,
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return the curves as rows of a table, one for each strain."""
        test, predicted = self.test, self.predicted
        columns = {
            "strain": test.strain,
            "stress_n_per_m": test.stress,
            "stress_predicted_n_per_m": predicted.stress,
            "contraction": test.contraction,
            "contraction_predicted": predicted.contraction,
            "middle_strain": test.middle_strain,
        }
        return [
            {"direction": self.sheet.direction, **dict(zip(columns, map(float, row), strict=True))}
            for row in zip(*columns.values(), strict=True)
        ]


def pull_sheet(
    comm: MPI.Comm,
    sheet: TileSheet,
    printed: Bools,
    composite: Composite,
    strains: Floats,
    log: Log | None = None,
) -> PulledSheet:
    """Pull a sheet, and the periodic tile that it is made of (collective).

    Strains of the middle are averaged over one tile, or over two where the number of tiles is even.

    Args:
        comm: Communicator.
        sheet: The sheet of tiles.
        printed: Whether each triangle of the tile is printed, (t,).
        composite: Materials of the tile.
        strains: As of `PullMachine.pull`.
        log: As of `PullMachine`.
    """
    density, axis, tile = printed.astype(np.float64), sheet.axis, sheet.tile
    gauge = (2 - sheet.counts[axis] % 2) * tile.lattice[axis, axis]
    skin, torus = sew(comm, sheet.pattern), sew(comm, tile.pattern)
    machine = PullMachine(skin, composite, axis, gauge, log=log, quadratic=printed[sheet.cell])
    test = machine.pull(density[sheet.cell][skin.owned_cells], strains)
    solver = tile_solver(torus, composite, Periodic(tile), quadratic=printed)
    owned = density[torus.owned_cells]
    predicted, middle = (
        predict(solver, owned, axis, at) for at in (strains, test.middle_strain[-1:])
    )
    return PulledSheet(sheet, test, predicted, middle)
