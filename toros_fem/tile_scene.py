"""A tile and what is wanted of it: from several starts to what is printed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.chain import Evaluation
from toros_fem.errors import NoEquilibriumError
from toros_fem.filters import make_filter
from toros_fem.lattice import Periodic
from toros_fem.manufacture import PrintLimits, printed_cells
from toros_fem.meshes.skin import sew
from toros_fem.meshes.tile import Tile
from toros_fem.mma import MMAOptions
from toros_fem.newton import NewtonStep
from toros_fem.optimise import DesignResult, optimise
from toros_fem.parameters import Bending, require_between, require_count, require_positive
from toros_fem.printed import PrintedDesign, print_design
from toros_fem.profile import Profile, ProfileSolver, profiles
from toros_fem.profile_objective import ProfileObjective, ProfileTarget
from toros_fem.projection import Projection
from toros_fem.settings import DesignSettings
from toros_fem.stages import DesignOptions, Iteration, Stage
from toros_fem.tile import TileSolver
from toros_fem.tile_design import SymmetricFilter, TileProblem
from toros_fem.tile_pieces import loose_pieces

Floats = npt.NDArray[np.float64]

# A start has waves of up to so many periods a side.
WAVES = 4
# A start whose print has islands must be so many times better to be gone on with.
ISLANDS = 20.0
# Strains at which the curves of a print are measured.
LEVELS = 5
# Between the directions in which a print is measured in the end, in rad.
STEP = np.radians(7.5)
# β is doubled so often at the end, that a thresholded design does what the design does.
DOUBLINGS = 2


@dataclass(frozen=True)
class TileSettings(DesignSettings):
    """The numbers that every design of a tile needs; SI units.

    The width constraints hold from the first step on, unless `constrained` is 0.

    Attributes:
        iterations: Steps from the best start on, half as many each time β is doubled.
        strain: At which stiffness counts, λ − 1.
        starts: How many random starts are tried; the best one is gone on with.
        trial: Steps of each of them.
        correct: How often at most the aim is moved by what printing changes.
        retry: Steps each time.
        tolerance: The largest relative deviation of a printed stiffness that needs no correction.
    """

    radius: float = 0.8e-3
    iterations: int = 40
    constrained: int = 1
    island_area: float = 0.1e-6
    strain: float = 0.1
    starts: int = 8
    trial: int = 20
    correct: int = 4
    retry: int = 15
    tolerance: float = 0.02

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(1, starts=self.starts, trial=self.trial, retry=self.retry)
        require_count(0, correct=self.correct)
        require_between(-1.0, np.inf, strain=self.strain)
        require_positive(tolerance=self.tolerance)

    @property
    def limits(self) -> PrintLimits:
        """What the printer can do."""
        return PrintLimits(width=self.print_width, gap=self.print_width)


@dataclass(frozen=True, eq=False)
class TileScene:
    """What is to be designed.

    Attributes:
        tile: The tile.
        angles: Directions that count, (k,), in rad; of a symmetric design those that its symmetry
            does not repeat.
        objective: What is wanted of the profile in these directions.
        symmetry: Of the design, as for `Tile.images`.
        fine: The same tile on a finer mesh, where what is printed is simulated; None for `tile`.
    """

    tile: Tile
    angles: Floats
    objective: ProfileObjective
    symmetry: str = "none"
    fine: Tile | None = None


@dataclass(frozen=True, eq=False)
class TileOutcome:
    """What designing a tile came to.

    Attributes:
        problem: The problem, with the objective that was asked for.
        result: What the design loop arrived at.
        printed: What is printed of it.
        profile: What that does on the finer mesh, in the directions that count; None if it has no
            equilibrium.
        loose: Areas in m² of printed pieces that hang on nothing.
        trials: T of the starts after their trial, and how many loose pieces they print.
        corrections: Worst relative deviation of what is printed, after each correction.
    """

    problem: TileProblem
    result: DesignResult
    printed: PrintedDesign | None
    profile: Profile | None
    loose: Floats
    trials: tuple[tuple[float, int], ...]
    corrections: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class TileFindings:
    """What is measured of a printed tile when it is done.

    Attributes:
        profile: Of the print on the finer mesh, in all directions that are drawn.
        curves: Profiles in the directions that count, at shares of the strain, the last the whole.
        blank: Stiffness of the fabric without print, in N/m.
        buckling: Of the directions that count, those in which the flat sheet is unstable out of
            its plane at this strain, so that a real one wrinkles: (k,).
        mirrored: Whether the profile goes on by mirrors in the axes, so that a quadrant tells all;
            and whether in the diagonals too.
    """

    profile: Profile
    curves: tuple[Profile, ...]
    blank: float
    buckling: npt.NDArray[np.bool_]
    mirrored: tuple[bool, bool]


Callback = Callable[[Iteration, Evaluation[Profile]], None]


def tile_problem(
    batch: MPI.Comm,
    scene: TileScene,
    settings: TileSettings,
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
        filter=SymmetricFilter(skin, inner, tile.images(scene.symmetry)),
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


def design_tile(
    batch: MPI.Comm,
    scene: TileScene,
    settings: TileSettings,
    callback: Callback | None = None,
    log: Callable[[NewtonStep], None] | None = None,
) -> TileOutcome:
    """Design a tile from the best of several starts, and make its print do what is asked.

    Profiles have many local minima; a few steps from each of some starts tell the good ones. In
    the end β is doubled, so that little grey is left, and the target is moved by the ratio of what
    is asked to what the printed tile does, for necks lose stiffness where they are thresholded.

    Args:
        batch: Communicator whose ranks share the directions.
        scene: What is to be designed.
        settings: With which numbers.
        callback: Called after each iteration, on every rank.
        log: Called with every Newton step of the design's equilibria.

    Raises:
        NoEquilibriumError: There is no equilibrium for the start.
    """
    s = settings
    problem = tile_problem(batch, scene, s, log)
    bound = s.constrained > 0
    options = DesignOptions((Stage(s.trial, constrained=bound),), mma=MMAOptions(move=s.move))
    best, start, trials = np.inf, None, []
    cells = problem.skin.owned_cells
    for seed in range(s.seed, s.seed + s.starts):
        result = optimise(problem, wavy(scene.tile, seed)[cells], options, callback)
        filtered = problem.skin.gather_cells(result.final.filtered)
        islands = len(loose_pieces(scene.tile, filtered > s.eta))
        trials.append((result.final.objective, islands))
        harm = result.final.objective * (ISLANDS if islands else 1.0)
        if harm < best or start is None:
            best, start = harm, result
    assert start is not None
    stages = [Stage(s.iterations, s.beta, constrained=bound)]
    half = max(1, s.iterations // 2)
    stages += [Stage(half, s.beta * 2**k, constrained=bound) for k in range(1, DOUBLINGS + 1)]
    result = optimise(
        problem, start.density, replace(options, stages=tuple(stages)), callback, after=start
    )
    problem = problem.with_projection(Projection(s.beta * 2**DOUBLINGS, s.eta))
    check = _Check(batch, scene, s)
    found = check(TileOutcome(problem, result, None, None, np.zeros(0), tuple(trials), ()))
    wanted = scene.objective
    if not isinstance(wanted, ProfileTarget):
        return found
    best_yet, stage = found, Stage(s.retry, constrained=bound)
    deviations = [_deviation(wanted, found.profile)]
    while len(deviations) <= s.correct and found.profile and min(deviations) > s.tolerance:
        aim = _moved(wanted, found.result.final.equilibrium, found.profile)
        result = optimise(
            replace(problem, objective=aim),
            found.result.density,
            replace(options, stages=(stage,)),
            callback,
            after=found.result,
        )
        found = check(replace(found, result=result))
        deviations.append(_deviation(wanted, found.profile))
        if deviations[-1] == min(deviations):
            best_yet = found
    return replace(best_yet, corrections=tuple(deviations))


def measure_print(
    batch: MPI.Comm, scene: TileScene, settings: TileSettings, outcome: TileOutcome
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
    mirrored = (scene.symmetry in ("orthotropic", "tetragonal"), scene.symmetry == "tetragonal")
    reach = np.pi / (1 if not mirrored[0] else 4 if mirrored[1] else 2)
    count = round(reach / STEP)
    every: Floats = np.asarray(np.linspace(0, reach, count + 1), dtype=np.float64)
    angles = every if mirrored[0] else every[:-1]
    check, s = _Check(batch, replace(scene, angles=angles), settings), settings
    assert outcome.printed is not None
    cells = check.density(outcome.printed)
    try:
        profile = check.solver.solve(cells, gradients=False)
        plain = check.solver.solve(np.zeros_like(cells), gradients=False)
        strains = s.strain * np.linspace(0, 1, LEVELS + 1)[1:]
        curves = profiles(check.solver.tile, cells, scene.angles, strains, batch)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    buckling = _buckling(batch, scene, settings, outcome)
    blank = float(plain.stiffness[0])
    return TileFindings(profile, tuple(curves), blank, buckling, mirrored)


def _buckling(
    batch: MPI.Comm, scene: TileScene, settings: TileSettings, outcome: TileOutcome
) -> npt.NDArray[np.bool_]:
    """Whether the print, on the design's mesh, buckles in the directions that count."""
    found = np.zeros(len(scene.angles), dtype=bool)
    assert outcome.printed is not None
    made = outcome.printed.evaluation
    if made is None:
        return found
    composite = replace(settings.composite, bending=Bending())
    solver = TileSolver(outcome.problem.skin, composite, Periodic(scene.tile, flat=False))
    for k, state in enumerate(made.equilibrium.state):
        if state is not None:
            found[k] = solver.buckles(state, made.projected)
    return np.asarray(batch.allreduce(found.astype(int)) > 0)


class _Check:
    """Prints a design and simulates the print on the finer mesh."""

    def __init__(self, batch: MPI.Comm, scene: TileScene, settings: TileSettings) -> None:
        self._scene, self._settings = scene, settings
        self._tile = scene.fine or scene.tile
        skin = sew(MPI.COMM_SELF, self._tile.pattern)
        solver = TileSolver(skin, settings.composite, Periodic(self._tile))
        self.solver = ProfileSolver(solver, scene.angles, settings.strain, batch)

    def __call__(self, outcome: TileOutcome) -> TileOutcome:
        problem, s = outcome.problem, self._settings
        printed = print_design(problem, outcome.result, s.limits, s.island_area)
        profile = None
        with suppress(NoEquilibriumError):  # raised by all ranks or by none
            profile = self.solver.solve(self.density(printed), gradients=False)
        loose = loose_pieces(self._scene.tile, printed.cells)
        return replace(outcome, printed=printed, profile=profile, loose=loose)

    def density(self, printed: PrintedDesign) -> Floats:
        """What is printed of the finer mesh's owned triangles."""
        cells = printed_cells(self._tile.pattern, printed.regions)
        return cells[self.solver.tile.skin.owned_cells].astype(np.float64)


def _deviation(wanted: ProfileTarget, profile: Profile | None) -> float:
    return np.inf if profile is None else wanted.worst(profile)


def _moved(wanted: ProfileTarget, designed: Profile, printed: Profile) -> ProfileTarget:
    """The target for a design that loses as much by being printed as this one."""
    changes: dict[str, Any] = {}
    if wanted.stiffness is not None:
        changes["stiffness"] = wanted.stiffness * designed.stiffness / printed.stiffness
    if wanted.contraction is not None:
        lost = designed.contraction - printed.contraction
        changes["contraction"] = wanted.contraction + lost
    return replace(wanted, **changes)
