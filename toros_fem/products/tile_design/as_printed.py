"""The print of a tile, simulated and measured on a finer mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import together
from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.print.printability import printed_cells
from toros_fem.materials.sheet import Bending
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.meshes.skin import sew
from toros_fem.products.tile_design.case import TileCase, TileDesignScene, TileResult
from toros_fem.products.tile_design.problem import TileProblem
from toros_fem.products.tiles.printability import RepeatedTile, tile_printability
from toros_fem.products.tiles.solver import TileSolver
from toros_fem.products.tiles.stiffness_profile import (
    Profile,
    ProfileSolver,
    merge_profiles,
    profiles,
)

# Number of strains at which the stress curves of a print are computed.
CURVE_POINTS = 4
# Angle in rad between the directions of a print's whole profile.
ANGLE_STEP = np.radians(7.5)
# Directions closer than this, in rad, are the same.
SAME_ANGLE = 1e-9


@dataclass(frozen=True, eq=False)
class PrintMeasurement:
    """The response of a printed tile over directions and strains.

    Attributes:
        profile: Profile of the print on the finer mesh, at all angles that are not repeated by
            the symmetry of the case.
        curves: Profiles in the directions of the objective at increasing strains; the last one is
            at the strain of the design.
        fabric_stiffness: Stiffness of the fabric without print, in N/m.
        buckling: For each direction of the objective, whether the flat sheet is unstable out of
            its plane at this strain, so that a real one wrinkles: (k,). None if the print has no
            equilibrium on the design's mesh, where this is computed.
    """

    profile: Profile
    curves: tuple[Profile, ...]
    fabric_stiffness: float
    buckling: Bools | None


class PrintSimulation:
    """Print of a tile's design and its simulation on the finer mesh.

    Attributes:
        solver: Solver of the tile on that mesh, in the directions of the objective.

    Args:
        batch: Communicator whose ranks share the directions.
        case: The tile and its target.
        config: Numbers of the design.
    """

    def __init__(self, batch: MPI.Comm, case: TileCase, config: TileDesignScene) -> None:
        self._case, self._tile, self._config = case, case.tile, config
        self._fine = case.fine or case.tile
        skin = sew(MPI.COMM_SELF, self._fine.pattern)
        solver = TileSolver(skin, config.material.composite, Periodic(self._fine))
        self.solver = ProfileSolver(solver, case.angles, config.pull.strain, batch)

    def simulate(self, problem: TileProblem, result: DesignResult) -> TileResult:
        """Print a design and simulate the print (collective)."""
        c = self._config
        printed = as_printed(
            problem,
            result,
            c.print.limits,
            island_area=c.print.island_area,
            domain=RepeatedTile(self._tile, self._case.symmetry),
        )
        profile, failure = None, ""
        try:
            profile = self.solver.solve(self.density(printed), gradients=False)
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = str(caught)
        widths = tile_printability(self._tile, printed.regions[0], printed.cells, printed.limits)
        return TileResult(problem, result, printed, profile, failure, widths)

    def density(self, printed: PrintedDesign) -> Floats:
        """Return the print's density, 0 or 1, at owned triangles of the finer mesh."""
        cells = printed_cells(self._fine.pattern, printed.regions)
        return cells[self.solver.tile.skin.owned_cells].astype(np.float64)


def measure_print(
    batch: MPI.Comm, case: TileCase, config: TileDesignScene, result: TileResult
) -> PrintMeasurement | None:
    """Compute profile, stress curves and buckling of a print (collective).

    Args:
        batch: Communicator whose ranks share the directions.
        case: The tile and its target.
        config: Numbers of the design.
        result: Result of the design.

    Returns:
        None if the print has no equilibrium in one of the directions.
    """
    designed = profile = result.profile
    if designed is None or profile is None:
        return None
    known = np.abs(_angles(case.symmetry)[:, None] - profile.angles).min(axis=1) < SAME_ANGLE
    others = _angles(case.symmetry)[~known]
    simulation = PrintSimulation(batch, case, config)
    tile, density = simulation.solver.tile, simulation.density(result.printed)
    try:
        if len(others):
            solver = ProfileSolver(tile, others, config.pull.strain, batch)
            profile = merge_profiles(profile, solver.solve(density, gradients=False))
        fabric = ProfileSolver(tile, [0.0], config.pull.strain, batch)
        unprinted = fabric.solve(np.zeros_like(density), gradients=False)
        strains = config.pull.strain * np.arange(1, CURVE_POINTS) / CURVE_POINTS
        curves = profiles(tile, density, case.angles, strains, batch)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    return PrintMeasurement(
        profile=profile,
        curves=(*curves, designed),
        fabric_stiffness=float(unprinted.stiffness[0]),
        buckling=_buckling(batch, case, config, result),
    )


def _angles(symmetry: str) -> Floats:
    """Return directions in rad that the symmetry does not repeat; mirrors are included."""
    period = {"tetragonal": np.pi / 4, "orthotropic": np.pi / 2}.get(symmetry, np.pi)
    angles: Floats = np.asarray(np.linspace(0, period, round(period / ANGLE_STEP) + 1))
    return angles if period < np.pi else angles[:-1]


def _buckling(
    batch: MPI.Comm, case: TileCase, config: TileDesignScene, result: TileResult
) -> Bools | None:
    """Return whether the print, on the design's mesh, buckles in each direction."""
    evaluation = result.printed.evaluation
    if evaluation is None:
        return None
    found = np.zeros(len(case.angles), dtype=bool)
    with together(batch):
        composite = replace(config.material.composite, bending=Bending())
        solver = TileSolver(result.problem.skin, composite, Periodic(case.tile, flat=False))
        for k, state in enumerate(evaluation.equilibrium.state):
            if state is not None:
                found[k] = solver.buckles(state, evaluation.projected)
    return np.asarray(batch.allreduce(found.astype(int)) > 0)
