"""The print of a tile, simulated and measured on a finer mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import Distributed, collective, together
from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.print.printability import printed_cells
from toros_fem.materials.sheet import Bending
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.meshes.skin import sew
from toros_fem.products.tile_design.problem import TileCase, TileDesignScene, TileProblem
from toros_fem.products.tiles.printability import RepeatedTile, TilePrintability, tile_printability
from toros_fem.products.tiles.solver import TileSolver
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileSolver, profiles

# Number of strains at which the stress curves of a print are computed.
CURVE_POINTS = 4
# Angle in degrees between the directions of a print's whole profile, and for each symmetry that
# after which it repeats them, and whether mirrored.
ANGLE_STEP = 7.5
PERIODS = {
    "none": (180, False),
    "orthotropic": (90, True),
    "chiral": (90, False),
    "tetragonal": (45, True),
}
# Directions closer than this, in rad, are the same.
SAME_ANGLE = 1e-9


@dataclass(frozen=True)
class Trial:
    """A start, "lines" or "waves", after its first steps: T, islands and narrow places."""

    start: str
    objective: float
    islands: int
    narrow: int


@dataclass(frozen=True, eq=False)
class TileResult(Distributed):
    """A design of a tile and its print.

    Attributes:
        simulation: What simulated the print.
        problem: The design problem, with the objective of the case.
        result: Density, history and the reason why the loop ended.
        printed: The print of this density.
        profile: Profile of the print on the finer mesh; None if it has no equilibrium.
        failure: Why there is no profile; empty if there is one.
        printability: Islands, lines and gaps of the print in the endless sheet.
        trials: The random starts after their trial.
        deviations: That of each print, before and after each correction; empty without a target.
    """

    simulation: PrintSimulation
    problem: TileProblem
    result: DesignResult
    printed: PrintedDesign
    profile: Profile | None
    failure: str
    printability: TilePrintability
    trials: tuple[Trial, ...] = ()
    deviations: tuple[float, ...] = ()

    @property
    def deviation(self) -> float:
        """Largest relative deviation of this print from the target, 0 without one.

        Without an equilibrium it is infinite.
        """
        goal, profile = self.problem.goal, self.profile
        if profile is None:
            return np.inf
        return 0.0 if goal is None else goal.largest_deviation(profile)


class PrintSimulation:
    """Prints designs of a tile and simulates them on its finer mesh; all methods are collective.

    The ranks of the case share the directions of the objective.
    """

    @collective("case.comm")
    def __init__(self, case: TileCase, config: TileDesignScene) -> None:
        self.case, self.config, fine = case, config, case.fine.tile
        skin = sew(MPI.COMM_SELF, fine.pattern)
        solver = TileSolver(skin, config.material.composite, Periodic(fine))
        self.solver = ProfileSolver(solver, case.angles, config.pull.strain, case.comm)

    def simulate(self, problem: TileProblem, result: DesignResult) -> TileResult:
        """Print a design and simulate the print."""
        tile, print_ = self.case.tile, self.config.print
        domain = RepeatedTile(tile, self.case.symmetry)
        printed = as_printed(
            problem, result, print_.limits, island_area=print_.island_area, domain=domain
        )
        profile, failure = None, ""
        try:
            profile = self.solver.solve(self.density(printed), gradients=False)
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = str(caught)
        widths = tile_printability(tile, printed.regions[0], printed.cells, printed.limits)
        return TileResult(self, problem, result, printed, profile, failure, widths)

    def density(self, printed: PrintedDesign) -> Floats:
        """Return the print's density, 0 or 1, at owned triangles of the finer mesh."""
        skin = self.solver.tile.skin
        return printed_cells(skin.pattern, printed.regions)[skin.owned_cells].astype(np.float64)


@dataclass(frozen=True, eq=False)
class PrintMeasurement:
    """The response of a printed tile over directions and strains.

    Attributes:
        profile: Profile on the finer mesh, at all angles that the case's symmetry does not repeat.
        curves: Profiles in the directions of the objective at increasing strains, the design's
            strain last.
        fabric_stiffness: Stiffness of the fabric without print, in N/m.
        buckling: Whether the flat sheet buckles at this strain in each direction of the objective,
            so that a real one wrinkles, (k,); None without equilibrium on the design's mesh.
    """

    profile: Profile
    curves: tuple[Profile, ...]
    fabric_stiffness: float
    buckling: Bools | None


def measure_print(made: TileResult) -> PrintMeasurement | None:
    """Compute profile, stress curves and buckling of a print (collective).

    The result is None if the print has no equilibrium in one of the directions.
    """
    designed, simulation = made.profile, made.simulation
    if designed is None:
        return None
    tile, batch, strain = simulation.solver.tile, simulation.solver.batch, designed.strain
    density, angles = simulation.density(made.printed), directions(simulation.case.symmetry)
    others = angles[np.abs(angles[:, None] - designed.angles).min(axis=1) >= SAME_ANGLE]
    try:
        profile = designed
        if len(others):
            more = ProfileSolver(tile, others, strain, batch).solve(density, gradients=False)
            profile = merged(designed, more)
        fabric = ProfileSolver(tile, [0.0], strain, batch)
        unprinted = fabric.solve(np.zeros_like(density), gradients=False)
        strains = strain * np.arange(1, CURVE_POINTS) / CURVE_POINTS
        curves = profiles(tile, density, designed.angles, strains, batch)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    stiffness = float(unprinted.stiffness[0])
    return PrintMeasurement(profile, (*curves, designed), stiffness, _buckling(made))


def directions(symmetry: str) -> Floats:
    """Return directions in rad that a symmetry does not repeat."""
    period, mirrored = PERIODS[symmetry]
    return np.radians(ANGLE_STEP * np.arange(round(period / ANGLE_STEP) + mirrored))


def merged(one: Profile, other: Profile) -> Profile:
    """Return the values of two profiles of one tile and strain, sorted by direction, no states."""
    order = np.argsort(np.concatenate([one.angles, other.angles]))
    values: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])[order]
        for name in ("angles", "stress", "tangent", "contraction", "shear")
    }
    values["steps"] = one.steps + other.steps
    values["factorisations"] = one.factorisations + other.factorisations
    return Profile(strain=one.strain, states=(), gradients=(), **values)


def _buckling(made: TileResult) -> Bools | None:
    """Return whether the print, on the design's mesh, buckles in each direction."""
    evaluation, simulation = made.printed.evaluation, made.simulation
    if evaluation is None:
        return None
    case, batch = simulation.case, simulation.solver.batch
    found = np.zeros(len(case.angles), dtype=bool)
    with together(batch):
        composite = replace(simulation.config.material.composite, bending=Bending())
        solver = TileSolver(made.problem.skin, composite, Periodic(case.tile, flat=False))
        for k, state in enumerate(evaluation.equilibrium.states):
            found[k] = state is not None and solver.buckles(state, evaluation.projected)
    return np.asarray(batch.allreduce(found.astype(int)) > 0)
