"""A fabric with designed stiffness: a tile that repeats (paper section 4.3, Fig. 7).

The print of a square tile of 1 cm is designed so that the fabric has the target stiffness when it
is pulled by 10 % in any direction and free across. Several random starts are tried,
families of straight and wavy lines and long waves of the density by turns, and the best is
continued; islands and lines or gaps below `--print-width` count against a start and a print. All
figures are those of the printed pattern, simulated again on a mesh along its borders.

Targets: "orthotropic" (4000 N/m along x, 1000 along y and at 45°), "tetragonal" (4000 along x and
y, 800 at 45°), "isotropic" (1500 everywhere), "anisotropic" (the largest ratio of stiffness along x
to that along y), "auxetic" (widens when pulled along x or y). `demos/tile_sheet.py` makes a sheet
of the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.keys import Count, In, Length, OneOf, Table, key
from toros_fem.base.validation import Floats
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.levels import correct, gathered
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.making.as_printed import contour_values
from toros_fem.making.contours import printed_regions
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.meshes.tiles import KINDS, SYMMETRIES, Tile
from toros_fem.meshes.triangles import require_affordable
from toros_fem.products.actuators.cost import Cost
from toros_fem.products.common.plausibility import (
    Group,
    doubts,
    sheet_groups,
    warn_of_doubts,
    with_lengths,
)
from toros_fem.products.tiles.problem import (
    Searching,
    TileCase,
    TileDesignScene,
    TilePrintability,
    TileProblem,
    TileResult,
    measure_print,
    simulated_print,
    tile_printability,
    tile_problem,
)
from toros_fem.products.tiles.report import TileRun, write_tile_results
from toros_fem.products.tiles.stiffness_profile import (
    Contrast,
    Profile,
    ProfileObjective,
    ProfileTarget,
)
from toros_fem.results.reporter import DesignReporter, print_step
from toros_fem.results.result import RunResult
from toros_fem.results.runs.open_run import journal_of

# Symmetry of the design for each target.
TARGETS = {
    "orthotropic": "orthotropic",
    "tetragonal": "tetragonal",
    "isotropic": "tetragonal",
    "anisotropic": "orthotropic",
    "auxetic": "chiral",
}
# Stiffness along x, at 45° and along y, in N/m, of the targets that prescribe it.
STIFFNESSES = {
    "orthotropic": (4000.0, 1000.0, 1000.0),
    "tetragonal": (4000.0, 800.0, 4000.0),
    "isotropic": (1500.0, 1500.0, 1500.0),
}
PRESCRIBED = tuple(STIFFNESSES)
# Cost of a Newton step of a print, whose triangles are quadratic, over one of a design.
QUADRATIC = 4.0
# Factor on T of a start or draft with places too narrow for the printer: only if its T is smaller
# by this factor, it is chosen. One with islands is the last choice: a print joins them, which makes
# it several times as stiff, and no correction mends that.
FLAW_FACTOR = 5.0
# Multiple of the tolerance; if every print has flaws or deviates by more, the other draft is tried.
# Flaws of a print are as bad as this deviation.
ACCEPTABLE = 2.5
# Part of the tolerance within which a print needs no correction: the rest is for its interval.
ENOUGH = 0.5
# Number of random pairs of families of lines, of which the one with the smallest T is a start.
PAIRS_A_START = 8
# A stage ends when T falls by a smaller fraction over ten steps.
MIN_DECREASE = 0.05
# Factor on β from the end of the trials on. A density of 0.01 in a gap makes the fabric several
# times as stiff: with more of it beside a line the print would be much softer than the design. With
# twice as much, designs freeze and corrections act no more.
STEEPER = 4
A = TypeVar("A")
# A random start has waves of 0 to WAVES − 1 periods along each side.
WAVES = 4
# Normals of the two families, in periods along the sides: along the sides, or along the diagonals.
PAIRS = (((0, 1), (1, 0)), ((1, 1), (1, -1)))
# Probabilities that the families are diagonal, and that the lines of a family are straight.
DIAGONAL, STRAIGHT = 0.25, 0.25
# Bounds of the amplitude of wavy lines in periods of the family, and of the width of lines relative
# to that of the narrowest.
AMPLITUDES, WIDTHS = (0.05, 0.15), (1.0, 2.0)
# Largest number of waves of a line in one tile.
MOST_WAVES = 2


class TileTarget(Table):
    """Shape or stiffness that is asked for."""

    target: Annotated[str, OneOf(tuple(TARGETS))] = key("tetragonal", "target of the design")
    directions: Count = key(
        3, "number of angles between directions, in 45° (tetragonal) or in each half of 90°"
    )
    contraction: Annotated[float, In(at_least=-1, at_most=1)] = key(
        -0.2, "lateral contraction of the auxetic target"
    )
    stiffness_0: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness along x; none takes that of --target"
    )
    stiffness_45: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness at 45°; none takes that of --target"
    )
    stiffness_90: Annotated[float, In("N/m", above=0)] | None = key(
        None, "target stiffness along y, if orthotropic; none takes that of --target"
    )

    NEEDS: ClassVar = {
        "contraction": ("target", ("auxetic",)),
        **dict.fromkeys(("directions", "stiffness_0", "stiffness_45"), ("target", PRESCRIBED)),
        "stiffness_90": ("target", ("orthotropic",)),
    }


class TileSizes(Table):
    """Sizes and mesh.

    Raises:
        ParameterError: Edges are too long for the tile.
    """

    size: Length = key(0.01, "side of the square tile")
    edge_length: Length = key(0.125e-3, "edge length; twice as long for the starts")
    mesh: Annotated[str, OneOf(KINDS)] = key("crossed", "kind of mesh")

    def __post_init__(self) -> None:
        if self.edge_length > self.size / 5:
            raise ParameterError(
                f"edge_length = {self.edge_length:g} m must be at most {self.size / 5:g} m, a "
                "fifth of the tile: the mesh of the starts has edges twice as long.",
                "edge_length",
            )


class TileScene(TileDesignScene):
    """Target and mesh of the tile, and its design."""

    target: TileTarget = TileTarget()
    skin: TileSizes = TileSizes()

    KIND: ClassVar = "tile"
    COARSE: ClassVar = {"edge_length": 1.6, "filter_radius": 8 / 7}
    FEW: ClassVar = (
        "target", "stiffness_0", "stiffness_45", "stiffness_90", "size", "edge_length", "seed",
    )  # fmt: skip

    def groups(self) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        return with_lengths(self, self.skin.size, self._groups())

    def _groups(self) -> Iterator[Group]:
        side, design = self.skin.size, self.design
        yield from sheet_groups(self.material.composite, side)
        constrained = ("line_width", "gap_width") if design.constrained else ()
        for name in ("print_width", "filter_radius", *constrained):
            if (width := self.value(name)) is not None:
                yield Group("width", name, width / side)

    def run_design(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Design the tile and write all results into a folder (collective)."""
        scene = self.of_first_rank(comm)
        warn_of_doubts(comm, doubts(scene))
        reporter, case = DesignReporter(comm, output), tile_case(comm, scene)
        log = print_step(comm) if verbose else None
        made = design_tile(case, scene, reporter, log, journal_of(output))
        found = TileRun(made, measure_print(made), dict(reporter.seconds))
        write_tile_results(output, found)
        return found

    def expected_cost(self, comm: MPI.Comm) -> Cost:
        """Return the cost of the design (collective)."""
        require_affordable(self.skin.size**2, self.skin.edge_length)
        own = tile_case(comm, self).tile.pattern
        return Cost(len(own.panel), len(own.panel), 3 * len(own.points), comm.size)


def linear_profile(angles: np.ndarray, along: float, diagonal: float, across: float) -> Floats:
    """Return the stiffness of a linear orthotropic sheet at angles, from that at 0°, 45° and 90°.

    1/s = cos⁴/s₀ + sin⁴/s₉₀ + (4/s₄₅ − 1/s₀ − 1/s₉₀) sin² cos².
    """
    c, s = np.cos(angles) ** 2, np.sin(angles) ** 2
    mixed = 4 / diagonal - 1 / along - 1 / across
    return np.asarray(1 / (c**2 / along + s**2 / across + mixed * c * s))


def tile_case(comm: MPI.Comm, config: TileScene) -> TileCase:
    """Return the tile with its target."""
    asked, skin, symmetry = config.target, config.skin, TARGETS[config.target.target]
    halves = 1 if symmetry == "tetragonal" else 2
    angles = np.asarray(
        np.linspace(0, halves * np.pi / 4, halves * asked.directions + 1), dtype=np.float64
    )
    objective: ProfileObjective
    if asked.target == "anisotropic":
        angles = angles[[0, -1]]
        objective = Contrast(soft=angles > 0, stiff=angles == 0)
    elif asked.target == "auxetic":
        angles = angles[:1]
        objective = ProfileTarget(contraction=np.array([asked.contraction]))
    else:
        given = (asked.stiffness_0, asked.stiffness_45, asked.stiffness_90)
        along, diagonal, across = (
            default if value is None else value
            for value, default in zip(given, STIFFNESSES[asked.target], strict=True)
        )
        if symmetry == "tetragonal":
            across = along
        objective = ProfileTarget(linear_profile(angles, along, diagonal, across))
    size = skin.size, skin.size
    return TileCase(comm, size, skin.edge_length, skin.mesh, symmetry, angles, objective)


# ----------------------------------------------------------------------------------------- search


def design_tile(
    case: TileCase,
    config: TileDesignScene,
    callback: Callback | None = None,
    log: Callable[[NewtonStep | str], None] | None = None,
    journal: Journal | None = None,
) -> TileResult:
    """Design a tile from the best of several random starts, and correct it for its print.

    Profiles have many local minima; a few steps on the coarse mesh show which starts are good. They
    are families of lines and long waves by turns. The two best are continued there, those with
    islands only where others are missing. The better draft is continued on the design's own mesh,
    with a steep projection, so that little grey is left. Then the target is corrected by the ratio
    of the design's profile to that of its print, and the design is continued. If no print without
    flaws comes near the target, the other draft is tried.

    Args:
        case, config: Tile and target, and the numbers of the design.
        callback, journal: As of `optimize`.
        log: Called with every Newton step of the design's equilibria.

    Raises:
        NoEquilibriumError: There is no equilibrium for any start, or, on the design's mesh, for
            any draft.
    """
    run = partial(optimize, callback=callback, journal=journal)
    search, design = _Search(case, config, run), config.design
    problem = tile_problem(case.coarse, config, log)
    finalists, trials = search.best_starts(problem)
    longer = [(design.draft_iterations, STEEPER)]
    drafts = [search.optimized(problem, longer, after=one) for one in finalists]
    drafts.sort(key=lambda one: search.rated(problem, one)[0])
    designs = [gathered(draft) for draft in drafts]
    del drafts, finalists
    problem, found = tile_problem(case, config, log), []
    for made in _solved(partial(search.finished, problem, one) for one in designs):
        found.append(replace(made, trials=trials))
        if made.printability.clean and made.deviation <= ACCEPTABLE * design.tolerance:
            break
    return min(found, key=search.badness)


@dataclass(frozen=True, eq=False)
class _Search:
    """The steps of a search, with what they share; all are collective."""

    case: TileCase
    config: TileDesignScene
    run: Callable[..., DesignResult]

    @property
    def design(self) -> Searching:
        """Steps, filter and start of the design."""
        return self.config.design

    @property
    def tile(self) -> Tile:
        """The tile on the mesh of the starts."""
        return self.case.coarse.tile

    @property
    def enough(self) -> float | None:
        """T that needs no further steps; None without a target."""
        return None if self.case.target is None else (self.design.tolerance / 2) ** 2

    def optimized(
        self,
        problem: TileProblem,
        steps: Sequence[tuple[int, float | None]],
        enough: float | None = None,
        **begin: Any,
    ) -> DesignResult:
        """Return a design after stages of so many steps, each with a factor on β."""
        design = self.design
        rules = DesignOptions(
            tuple(
                Stage(count, factor and factor * design.beta, constrained=design.constrained)
                for count, factor in steps
            ),
            mma=MMAOptions(move=design.move_limit),
            target_objective=enough or self.enough,
            min_relative_decrease=None if self.enough is None else MIN_DECREASE,
        )
        return self.run(problem, rules, **begin)

    def best_starts(self, problem: TileProblem) -> tuple[list[DesignResult], list[dict[str, Any]]]:
        """Return the two best starts and all trials; one that reaches the target is the last."""
        found, trials = [], []
        starts = (partial(self._tried, problem, k) for k in range(self.design.starts))
        for number, kind, result in _solved(starts):
            rating, made = self.rated(problem, result)
            found.append((rating, number, result))
            row = {"start": kind, "objective": result.final.objective}
            trials.append({**row, "islands": len(made.island_areas), "narrow": made.narrow_places})
            if rating <= (False, self.enough or -np.inf):
                return [result], trials
        return [one[-1] for one in sorted(found, key=itemgetter(0, 1))[:2]], trials

    def _tried(self, problem: TileProblem, number: int) -> tuple[int, str, DesignResult]:
        """Return the number of a start, its kind, and the design after its first steps."""
        seed, kind = self.design.seed + number, ("lines", "waves")[number % 2]
        if kind == "waves":
            start = random_waves(self.tile, seed)[problem.skin.owned_cells]
        else:
            start = self._lines(problem, seed)
        steps = [(self.design.trial_iterations, factor) for factor in (1, STEEPER)]
        return number, kind, self.optimized(problem, steps, start=start)

    def _lines(self, problem: TileProblem, seed: int) -> Floats:
        """Return the best of several random pairs of families of lines at owned triangles."""
        rng, symmetry = np.random.default_rng(seed), self.case.symmetry

        def tried() -> tuple[float, Floats]:
            every = random_lines(self.tile, rng, symmetry, problem.fields.filter.radius)
            density = every[problem.skin.owned_cells]
            return problem.simulate(density, trial=True).objective, density

        return min(_solved([tried] * PAIRS_A_START), key=itemgetter(0))[1]

    def rated(
        self, problem: TileProblem, result: DesignResult
    ) -> tuple[tuple[bool, float], TilePrintability]:
        """Return what starts and drafts are sorted by, and the printability.

        It is whether there are islands, and T, at least its target, times the factor for narrow
        places.
        """
        eta = problem.fields.projection.eta
        values = contour_values(problem, result.density)
        region = printed_regions(self.tile.pattern, *values, eta)[0]
        made = tile_printability(self.tile, region, values[1] > eta, self.config.print.limits)
        limits, widths = problem.length_scale, result.final.length_scale
        satisfied = limits is None or widths is None or bool(np.all(widths <= limits.epsilon))
        narrow = made.narrow_places > 0 or not satisfied
        rating = max(result.final.objective, self.enough or 0.0) * FLAW_FACTOR**narrow
        return (len(made.island_areas) > 0, rating), made

    def finished(self, problem: TileProblem, draft: CarriedDesign) -> TileResult:
        """Continue a draft on the design's own mesh and correct the design for its print."""
        design, target = self.design, problem.goal
        result = self.optimized(problem, [(design.finish_iterations, STEEPER)], after=draft)
        problem = problem.changed(fields=problem.fields.with_beta(STEEPER * design.beta))
        first = simulated_print(self.case, self.config, problem, result)
        if target is None:
            return first
        # No direction may deviate by more than the tolerance: a mean over them is a weaker rule.
        goal = (design.tolerance / 2) ** 2 / len(problem.physics.angles)

        def asked_again(prints: Sequence[TileResult]) -> TileResult | None:
            last = prints[-1]
            if last.profile is None:
                return None
            asked = _corrected(target, last.result.final.equilibrium, last.profile)
            asking = problem.changed(objective=asked)
            steps = [(design.correction_iterations, None)]
            found = self.optimized(asking, steps, goal, after=last.result)
            return simulated_print(self.case, self.config, problem, found)

        def enough(prints: Sequence[TileResult]) -> bool:
            return min(map(self.badness, prints)) <= ENOUGH * design.tolerance

        prints = correct(first, asked_again, enough, design.corrections)
        deviations = tuple(one.deviation for one in prints)
        return replace(min(prints, key=self.badness), deviations=deviations)

    def badness(self, made: TileResult) -> float:
        """Return the deviation of a print, more by `ACCEPTABLE` tolerances if it has flaws."""
        flaws = 0.0 if made.printability.clean else ACCEPTABLE * self.design.tolerance
        return made.deviation + flaws


def _solved(attempts: Iterable[Callable[[], A]]) -> Iterator[A]:
    """Yield what attempts with an equilibrium return; without any raise the last failure."""
    failure, found = None, False
    for attempt in attempts:
        try:
            result = attempt()
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        found = True
        yield result
    if failure is not None and not found:
        raise failure


def _corrected(target: ProfileTarget, designed: Profile, printed: Profile) -> ProfileTarget:
    """Return the target of a design that loses as much by printing as this one."""
    changes: dict[str, Any] = {}
    if target.stiffness is not None:
        changes["stiffness"] = target.stiffness * designed.stiffness / printed.stiffness
    if target.contraction is not None:
        lost = designed.contraction - printed.contraction
        changes["contraction"] = target.contraction + lost
    return replace(target, **changes)


@dataclass(frozen=True)
class LineFamily:
    """A family of equal straight or wavy lines on a periodic tile.

    With X the place in units of the sides, u = normal · X and v along the lines, the centres of its
    lines are where u + offset + amplitude cos 2π(waves v + shift) is a whole number.

    Attributes:
        normal: Normal of the lines, in periods along both sides.
        width: Width of the lines in m, across the wave.
        offset: Place of the lines in periods.
        amplitude: Amplitude of the wave in periods; 0 for straight lines.
        waves: Number of waves along a line in a tile.
        shift: Phase of the wave in periods.
    """

    normal: tuple[int, int]
    width: float
    offset: float = 0.0
    amplitude: float = 0.0
    waves: int = 1
    shift: float = 0.0

    def depth(self, tile: Tile) -> Floats:
        """Return the distance in m by which triangles' centroids are inside the lines, (t,)."""
        by_place = np.linalg.inv(tile.lattice)
        across = np.array(self.normal)
        along = np.array([-across[1], across[0]])
        place = tile.pattern.centroids @ by_place
        phase = 2 * np.pi * (self.waves * (place @ along) + self.shift)
        height = place @ across + self.offset + self.amplitude * np.cos(phase)
        slope = 2 * np.pi * self.waves * self.amplitude * np.sin(phase)
        steepness = np.linalg.norm(by_place @ across - np.outer(slope, by_place @ along), axis=1)
        return np.asarray(self.width / 2 - np.abs(height - np.rint(height)) / steepness)


def random_waves(tile: Tile, seed: int) -> Floats:
    """Return a random periodic density of long waves at all triangles, (t,), in [0.1, 0.9]."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * tile.pattern.centroids @ np.linalg.inv(tile.lattice)
    density = np.full(len(phase), 0.5)
    for i, j in np.ndindex(WAVES, WAVES):
        amplitude, x, y = rng.standard_normal(), *rng.uniform(0, 2 * np.pi, 2)
        density += 0.25 * amplitude * np.cos(i * phase[:, 0] + x) * np.cos(j * phase[:, 1] + y)
    return np.asarray(np.clip(density, 0.1, 0.9))


def random_lines(tile: Tile, rng: np.random.Generator, symmetry: str, narrowest: float) -> Floats:
    """Return the density of two random families of lines and their images, (t,), in [0.1, 0.9].

    It falls over the width in m of the narrowest lines.
    """
    depths = [family.depth(tile) for family in random_families(rng, symmetry, narrowest)]
    images = np.max(depths, axis=0)[tile.symmetry_maps(symmetry)]
    return np.asarray(np.clip(0.5 + images.max(axis=0) / narrowest, 0.1, 0.9))


def random_families(rng: np.random.Generator, symmetry: str, narrowest: float) -> list[LineFamily]:
    """Return two random families that cross each other, and not their own images."""
    normals = PAIRS[int(rng.random() < DIAGONAL)]
    return [_random_family(rng, normal, symmetry, narrowest) for normal in normals]


def _random_family(
    rng: np.random.Generator, normal: tuple[int, int], symmetry: str, narrowest: float
) -> LineFamily:
    width, straight = narrowest * rng.uniform(*WIDTHS), rng.random() < STRAIGHT
    amplitude, waves = rng.uniform(*AMPLITUDES), int(rng.integers(1, MOST_WAVES + 1))
    # A mirror along or across the lines maps a wave onto itself only if the wave has a crest or a
    # trough there, and a line beside the mirror onto another. Half a turn also maps a wave onto
    # itself if the centre of the turn is between crest and trough. Straight lines in a mirror would
    # do too, but there would be one of them in a period, and such designs came less close to their
    # targets than those with two.
    flips = [np.abs(op @ normal) for op in SYMMETRIES[symmetry] if np.linalg.det(op) < 0]
    mirrored = any(np.array_equal(flip, np.abs(normal)) for flip in flips)
    beside = mirrored or bool(rng.random() < 0.5)
    return LineFamily(
        normal,
        width,
        offset=0.25 if beside else 0.0,
        amplitude=0.0 if straight else amplitude,
        waves=waves,
        shift=0.5 * int(rng.integers(2)) + (0.0 if beside else 0.25),
    )
