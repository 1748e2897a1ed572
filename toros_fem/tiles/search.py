"""A tile from several random starts to a print that does what is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem.density.projection import Projection
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import DesignOptions, Iteration, Stage
from toros_fem.design.problem import Evaluation
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.errors import NoEquilibriumError
from toros_fem.meshes.tile import Tile
from toros_fem.mma.optimizer import MMAOptions
from toros_fem.tiles.as_printed import TileCheck
from toros_fem.tiles.case import TileCase, TileConfig, TileResult, tile_problem, wavy
from toros_fem.tiles.islands import loose_pieces
from toros_fem.tiles.objectives import ProfileTarget
from toros_fem.tiles.problem import TileProblem
from toros_fem.tiles.stiffness_profile import Profile

# A start that has islands or breaks the width constraints must be so many times better to be gone
# on with.
SPOILT = 5.0
# What is printed is near what is asked if it is off by so many tolerances.
FAIR = 2.5
# A stage in which T falls by a smaller share over ten steps is over.
PROGRESS = 0.05
# By how much β is raised in the trials, and then on the design's own mesh. In a gap a
# density of 0.01 makes fabric several times as stiff: little of it may be left beside a line, or
# the print is much softer.
STEEPER, STEEPEST = 4, (4, 8)


Callback = Callable[[Iteration, Evaluation[Profile]], None]


def design_tile(
    batch: MPI.Comm,
    scene: TileCase,
    settings: TileConfig,
    callback: Callback | None = None,
    log: Callable[[NewtonStep], None] | None = None,
) -> TileResult:
    """Design a tile from the best of several starts, and make its print do what is asked.

    Profiles have many local minima; a few steps from each of some starts, on the coarse mesh, tell
    the good ones. The two best are gone on with there, one of them without islands if there is such
    a one, and then the better one on the design's own mesh with β raised, so that little grey is
    left. At last the target is moved by the ratio of what is designed to what its print does on the
    finer mesh, and the design goes on from there. Where that leads nowhere near, the other one gets
    its turn.

    Args:
        batch: Communicator whose ranks share the directions.
        scene: What is to be designed.
        settings: With which numbers.
        callback: Called after each iteration, on every rank.
        log: Called with every Newton step of the design's equilibria.

    Raises:
        NoEquilibriumError: There is no equilibrium for any start, or none on the design's mesh for
            any of what was found on the coarse one.
    """
    s = settings
    draft = replace(scene, tile=scene.coarse or scene.tile)
    problem = tile_problem(batch, draft, s, log)
    bound, exact = s.constrained > 0, isinstance(scene.objective, ProfileTarget)
    options = DesignOptions(
        tuple(Stage(s.trial, k * s.beta, constrained=bound) for k in (1, STEEPER)),
        target_objective=(s.tolerance / 2) ** 2 if exact else 0.0,
        min_relative_decrease=PROGRESS if exact else 0.0,
        mma=MMAOptions(move=s.move),
    )
    finalists, trials = _best_starts(problem, draft.tile, s, options, callback)
    whole = replace(options, stages=(Stage(s.iterations, STEEPER * s.beta, constrained=bound),))
    drafts = [
        optimize(problem, whole, start=one.density, callback=callback, after=one)
        for one in finalists
    ]
    drafts.sort(key=lambda one: _judged(problem, draft.tile, options, one)[0])
    densities = [problem.skin.gather_cells(one.density) for one in drafts]
    near, _ = draft.tile.nearest(scene.tile.pattern.centroids)
    problem = tile_problem(batch, scene, s, log)
    mine = near[problem.skin.owned_cells]
    check = TileCheck(batch, scene, s)
    found: list[TileResult] = []
    failure: NoEquilibriumError | None = None
    for drafted, density in zip(drafts, densities, strict=True):
        try:
            made = _made(problem, drafted, density[mine], s, options, check, callback)
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        found.append(replace(made, trials=trials))
        if not exact or min(made.corrections) <= FAIR * s.tolerance:
            break
    if not found:
        assert failure is not None
        raise failure
    return min(found, key=lambda one: min(one.corrections, default=0.0))


def _made(
    problem: TileProblem,
    drafted: DesignResult,
    density: Floats,
    settings: TileConfig,
    options: DesignOptions,
    check: TileCheck,
    callback: Callback | None,
) -> TileResult:
    """What comes of a draft on the design's own mesh, its print made to do what is asked."""
    s, wanted, bound = settings, problem.objective, settings.constrained > 0
    last = tuple(Stage(s.finish, k * s.beta, constrained=bound) for k in STEEPEST)
    result = optimize(
        problem,
        replace(options, stages=last),
        start=density,
        callback=callback,
        after=drafted,
        new_mesh=True,
    )
    problem = problem.with_projection(Projection(STEEPEST[-1] * s.beta, s.eta))
    found = check(TileResult(problem, result, None, None, "", np.zeros(0), (), ()))
    if not isinstance(wanted, ProfileTarget):
        return found
    best_yet = found
    # No direction may be off by more than the tolerance: a mean over them tells less.
    again = replace(
        options,
        stages=(Stage(s.retry, constrained=bound),),
        target_objective=options.target_objective / len(problem.solver.angles),
    )
    deviations = [_deviation(wanted, found.profile)]
    while len(deviations) <= s.correct and found.profile and min(deviations) > s.tolerance:
        aim = _moved(wanted, found.result.final.equilibrium, found.profile)
        result = optimize(
            replace(problem, objective=aim),
            again,
            start=found.result.density,
            callback=callback,
            after=found.result,
        )
        found = check(replace(found, result=result))
        deviations.append(_deviation(wanted, found.profile))
        if deviations[-1] == min(deviations):
            best_yet = found
    return replace(best_yet, corrections=tuple(deviations))


def _best_starts(
    problem: TileProblem,
    tile: Tile,
    settings: TileConfig,
    options: DesignOptions,
    callback: Callback | None,
) -> tuple[list[DesignResult], tuple[tuple[float, int], ...]]:
    """What the best starts came to, T and islands of all; one that does all ends the search."""
    found: list[tuple[float, int, bool, DesignResult]] = []
    trials: list[tuple[float, int]] = []
    failure: NoEquilibriumError | None = None
    skin, first = problem.skin, settings.seed
    for seed in range(first, first + settings.starts):
        try:
            result = optimize(
                problem, options, start=wavy(tile, seed)[skin.owned_cells], callback=callback
            )
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        harm, islands = _judged(problem, tile, options, result)
        found.append((harm, seed, islands == 0, result))
        trials.append((result.final.objective, islands))
        if harm <= options.target_objective:
            return [result], tuple(trials)
    if not found:
        assert failure is not None
        raise failure
    best, *others = sorted(found, key=lambda one: one[:2])
    # Blocks on fabric hang on what narrow gaps do: if they fail, something else is wanted.
    others.sort(key=lambda one: not one[2])
    return [one[-1] for one in (best, *others[:1])], tuple(trials)


def _judged(
    problem: TileProblem, tile: Tile, options: DesignOptions, result: DesignResult
) -> tuple[float, int]:
    """T, enough if it is less, times what islands and forbidden widths cost; and the islands."""
    filtered = problem.skin.gather_cells(result.final.filtered)
    islands = len(loose_pieces(tile, filtered > problem.projection.eta))
    limits, widths = problem.length_scale, result.final.length_scale
    kept = limits is None or widths is None or bool(np.all(widths <= limits.epsilon))
    harm = max(result.final.objective, options.target_objective) * (
        1.0 if kept and not islands else SPOILT
    )
    return harm, islands


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
