"""A tile and what is wanted of it, as a design problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem._validate import require_between, require_count, require_positive
from toros_fem.density.filters import make_filter
from toros_fem.density.projection import Projection
from toros_fem.density.symmetric import SymmetricFilter
from toros_fem.design.config import DesignConfig
from toros_fem.design.loop import DesignResult
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.fabrication.as_printed import PrintedDesign
from toros_fem.fabrication.printability import PrintLimits
from toros_fem.mechanics.periodicity import Periodic
from toros_fem.meshes.skin import sew
from toros_fem.meshes.tile import Tile
from toros_fem.tiles.objectives import ProfileObjective
from toros_fem.tiles.problem import TileProblem
from toros_fem.tiles.solver import TileSolver
from toros_fem.tiles.stiffness_profile import Profile, ProfileSolver

# A start has waves of up to so many periods a side.
WAVES = 4


@dataclass(frozen=True)
class TileConfig(DesignConfig):
    """The numbers that every design of a tile needs; SI units.

    The width constraints hold from the first step on, unless `constrained` is 0.

    Attributes:
        iterations: Steps at most from each of the two best starts on, on the coarse mesh.
        strain: At which stiffness counts, λ − 1.
        starts: How many random starts are tried at most; the two best are gone on with.
        trial: Steps of each of them at most, and as many again with β raised.
        finish: Steps at most on the design's own mesh, each time β is raised.
        correct: How often at most the aim is moved by what printing changes.
        retry: Steps at most each time.
        tolerance: The largest relative deviation of a printed stiffness that needs no correction.
            A design is good enough when T is at most the square of half of it.
    """

    radius: float = 0.7e-3
    iterations: int = 40
    constrained: int = 1
    island_area: float = 0.1e-6
    strain: float = 0.1
    starts: int = 8
    trial: int = 12
    finish: int = 15
    correct: int = 3
    retry: int = 15
    tolerance: float = 0.02

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, starts=self.starts, trial=self.trial, finish=self.finish)
        require_count(1, retry=self.retry)
        require_count(0, correct=self.correct)
        require_between(-1.0, np.inf, strain=self.strain)
        require_positive(tolerance=self.tolerance)

    @property
    def limits(self) -> PrintLimits:
        """What the printer can do."""
        return PrintLimits(width=self.print_width, gap=self.print_width)


@dataclass(frozen=True, eq=False)
class TileCase:
    """What is to be designed.

    Attributes:
        tile: The tile, as it is designed and filed.
        angles: Directions that count, (k,), in rad; of a symmetric design those that its symmetry
            does not repeat.
        objective: What is wanted of the profile in these directions.
        symmetry: Of the design, as for `Tile.symmetry_maps`.
        coarse: The same tile on a coarser mesh, where starts are tried; None for `tile`.
        fine: The same tile on a finer mesh, where what is printed is simulated; None for `tile`.
    """

    tile: Tile
    angles: Floats
    objective: ProfileObjective
    symmetry: str = "none"
    coarse: Tile | None = None
    fine: Tile | None = None


@dataclass(frozen=True, eq=False)
class TileResult:
    """What designing a tile came to.

    Attributes:
        problem: The problem, with the objective that was asked for.
        result: What the design loop arrived at.
        printed: What is printed of it.
        profile: What that does on the finer mesh, in the directions that count; None if it has no
            equilibrium.
        failure: Why it has none.
        loose: Areas in m² of printed pieces that hang on nothing.
        trials: T of the starts after their trial, and how many loose pieces they print.
        corrections: Worst relative deviation of what is printed, after each correction.
    """

    problem: TileProblem
    result: DesignResult
    printed: PrintedDesign | None
    profile: Profile | None
    failure: str
    loose: Floats
    trials: tuple[tuple[float, int], ...]
    corrections: tuple[float, ...]


def tile_problem(
    batch: MPI.Comm,
    scene: TileCase,
    settings: TileConfig,
    log: Callable[[NewtonStep], None] | None = None,
) -> TileProblem:
    """The design problem of a tile, which each rank sews for itself (collective).

    Args:
        batch: Communicator whose ranks share the directions.
        scene: What is to be designed.
        settings: With which numbers.
        log: As for `TileSolver`.

    Raises:
        TorosError: A number or the scene itself is out of bounds.
    """
    s, tile = settings, scene.tile
    skin = sew(MPI.COMM_SELF, tile.pattern)
    lattice = tile.lattice
    inner = make_filter(s.filter, skin, s.radius, lattice=lattice)
    problem = TileProblem(
        solver=ProfileSolver(
            TileSolver(skin, s.composite, Periodic(tile), log=log), scene.angles, s.strain, batch
        ),
        objective=scene.objective,
        filter=SymmetricFilter(skin, inner, tile.symmetry_maps(scene.symmetry)),
        projection=Projection(s.beta, s.eta),
        weight=s.perimeter,
    )
    s.penalise(problem, lattice)
    return problem


def wavy(tile: Tile, seed: int) -> Floats:
    """A random periodic density of long waves, of all triangles, (t,), in [0.1, 0.9]."""
    rng = np.random.default_rng(seed)
    place = 2 * np.pi * tile.pattern.centroids @ np.linalg.inv(tile.lattice)
    density = np.full(len(place), 0.5)
    for i in range(WAVES):
        for j in range(WAVES):
            size, x, y = rng.standard_normal(), *rng.uniform(0, 2 * np.pi, 2)
            density += 0.25 * size * np.cos(i * place[:, 0] + x) * np.cos(j * place[:, 1] + y)
    return np.asarray(np.clip(density, 0.1, 0.9))
