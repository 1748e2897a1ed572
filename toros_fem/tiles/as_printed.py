"""What the print of a tile does, simulated on a finer mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._mpi import raise_together
from toros_fem._types import Floats
from toros_fem.errors import NoEquilibriumError
from toros_fem.fabrication.as_printed import PrintedDesign, as_printed
from toros_fem.fabrication.printability import printed_cells
from toros_fem.materials import Bending
from toros_fem.mechanics.periodicity import Periodic
from toros_fem.meshes.skin import sew
from toros_fem.tiles.case import TileCase, TileConfig, TileResult
from toros_fem.tiles.islands import loose_pieces
from toros_fem.tiles.solver import TileSolver
from toros_fem.tiles.stiffness_profile import Profile, ProfileSolver, merge_profiles, profiles

# Strains at which the curves of a print are measured.
LEVELS = 4
# Between the directions in which a print is measured in the end, in rad.
STEP = np.radians(7.5)
# Directions as near to each other are one, in rad.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class TileFindings:
    """What is measured of a printed tile when it is done.

    Attributes:
        profile: Of the print on the finer mesh, in all directions that are drawn.
        curves: Profiles in the directions that count, at shares of the strain, the last the whole.
        blank: Stiffness of the fabric without print, in N/m.
        buckling: Of the directions that count, those in which the flat sheet is unstable out of
            its plane at this strain, so that a real one wrinkles: (k,); None if the print has no
            equilibrium on the design's mesh, where this is asked.
        mirrored: Whether the profile goes on by mirrors in the axes, so that a quadrant tells all;
            and whether in the diagonals too.
    """

    profile: Profile
    curves: tuple[Profile, ...]
    blank: float
    buckling: npt.NDArray[np.bool_] | None
    mirrored: tuple[bool, bool]


class TileCheck:
    """Prints designs of a tile and simulates the prints on the finer mesh.

    Attributes:
        solver: Pulls the tile on that mesh.

    Args:
        batch: Communicator whose ranks share the directions.
        scene: What is designed.
        settings: With which numbers.
    """

    def __init__(self, batch: MPI.Comm, scene: TileCase, settings: TileConfig) -> None:
        self._scene, self._settings = scene, settings
        self._tile = scene.fine or scene.tile
        skin = sew(MPI.COMM_SELF, self._tile.pattern)
        solver = TileSolver(skin, settings.composite, Periodic(self._tile))
        self.solver = ProfileSolver(solver, scene.angles, settings.strain, batch)

    def __call__(self, outcome: TileResult) -> TileResult:
        """The outcome with its print and what that does (collective)."""
        problem, s = outcome.problem, self._settings
        printed = as_printed(problem, outcome.result, s.limits, island_area=s.island_area)
        profile, failure = None, ""
        try:
            profile = self.solver.solve(self.density(printed), gradients=False)
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = str(caught)
        loose = loose_pieces(self._scene.tile, printed.cells)
        return replace(outcome, printed=printed, profile=profile, failure=failure, loose=loose)

    def density(self, printed: PrintedDesign) -> Floats:
        """What is printed of the finer mesh's owned triangles."""
        cells = printed_cells(self._tile.pattern, printed.regions)
        return cells[self.solver.tile.skin.owned_cells].astype(np.float64)


def measure_print(
    batch: MPI.Comm, scene: TileCase, settings: TileConfig, outcome: TileResult
) -> TileFindings | None:
    """The whole profile of what is printed, on the finer mesh (collective).

    Args:
        batch: Communicator whose ranks share the directions.
        scene: What was designed.
        settings: With which numbers.
        outcome: What it came to.

    Returns:
        None if the print has no equilibrium in one of the directions.
    """
    if outcome.profile is None:
        return None
    mirrored = (scene.symmetry in ("orthotropic", "tetragonal"), scene.symmetry == "tetragonal")
    reach = np.pi / (1 if not mirrored[0] else 4 if mirrored[1] else 2)
    count = round(reach / STEP)
    every: Floats = np.asarray(np.linspace(0, reach, count + 1), dtype=np.float64)
    angles = every if mirrored[0] else every[:-1]
    known = np.abs(angles[:, None] - outcome.profile.angles).min(axis=1) < SAME
    check, s = TileCheck(batch, scene, settings), settings
    tile, profile = check.solver.tile, outcome.profile
    assert outcome.printed is not None
    cells = check.density(outcome.printed)
    try:
        if not known.all():
            others = ProfileSolver(tile, angles[~known], s.strain, batch)
            profile = merge_profiles(profile, others.solve(cells, gradients=False))
        fabric = ProfileSolver(tile, angles[:1], s.strain, batch)
        plain = fabric.solve(np.zeros_like(cells), gradients=False)
        strains = s.strain * np.arange(1, LEVELS) / LEVELS
        curves = profiles(tile, cells, scene.angles, strains, batch)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    buckling = _buckling(batch, scene, settings, outcome)
    blank = float(plain.stiffness[0])
    return TileFindings(profile, (*curves, outcome.profile), blank, buckling, mirrored)


def _buckling(
    batch: MPI.Comm, scene: TileCase, settings: TileConfig, outcome: TileResult
) -> npt.NDArray[np.bool_] | None:
    """Whether the print, on the design's mesh, buckles in the directions that count."""
    found = np.zeros(len(scene.angles), dtype=bool)
    assert outcome.printed is not None
    made = outcome.printed.evaluation
    if made is None:
        return None
    error: Exception | None = None
    try:
        composite = replace(settings.composite, bending=Bending())
        solver = TileSolver(outcome.problem.skin, composite, Periodic(scene.tile, flat=False))
        for k, state in enumerate(made.equilibrium.state):
            if state is not None:
                found[k] = solver.buckles(state, made.projected)
    except Exception as caught:  # whatever it is, the others wait at the end
        error = caught
    raise_together(batch, error)
    return np.asarray(batch.allreduce(found.astype(int)) > 0)
