"""Design of a tile from random lines and waves, with corrections for its print."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.corrections import correct
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.levels import gathered
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.warm_start import WarmStart
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.making.as_printed.as_printed import contour_values
from toros_fem.making.print.contours import printed_regions
from toros_fem.mechanics.equilibrium.newton_step import NewtonStep
from toros_fem.meshes.makers.tile import Tile
from toros_fem.products.tile_design.as_printed import PrintSimulation
from toros_fem.products.tile_design.case import (
    TileCase,
    TileDesignScene,
    TileResult,
    Trial,
    tile_problem,
)
from toros_fem.products.tile_design.problem import TileProblem
from toros_fem.products.tile_design.starts import random_lines
from toros_fem.products.tiles.objectives import ProfileTarget
from toros_fem.products.tiles.printability import TilePrintability, tile_printability
from toros_fem.products.tiles.stiffness_profile import Profile

# Factor on T of a start or draft for each kind of flaw, islands and places too narrow for the
# printer: only if its T is smaller by this factor, it is chosen.
FLAW_FACTOR = 5.0
# Multiple of the tolerance; if every print has flaws or deviates by more, the other draft is tried.
# Flaws of a print are as bad as this deviation.
ACCEPTABLE = 2.5
# Number of random pairs of families of lines, of which the one with the smallest T is a start.
PAIRS_A_START = 8
# A stage ends when T falls by a smaller fraction over ten steps.
MIN_DECREASE = 0.05
# Factors on β at the end of the trials, and on the design's own mesh. A density of 0.01 in a gap
# makes the fabric several times as stiff: with more of it beside a line the print would be much
# softer than the design.
DRAFT_BETA, FINAL_BETAS = 4, (4, 8)


def design_tile(
    batch: MPI.Comm,
    case: TileCase,
    config: TileDesignScene,
    callback: Callback | None = None,
    log: Callable[[NewtonStep | str], None] | None = None,
    journal: Journal | None = None,
) -> TileResult:
    """Design a tile from the best of several random starts, and correct it for its print.

    Profiles have many local minima; a few steps on the coarse mesh show which starts are good. They
    are families of lines and long waves by turns. The two best are continued there; one of them has
    no flaws, islands or narrow places, if there is such a start. The better draft is continued on
    the design's own mesh, with β raised so that little grey is left. Then the target is corrected
    by the ratio of the design's profile to that of its print on the finer mesh, and the design is
    continued. If no print without flaws comes near the target, the other draft is tried.

    Args:
        batch: Communicator whose ranks share the directions.
        case: The tile and its target.
        config: Numbers of the design.
        callback: Called after each iteration, on every rank.
        log: Called with every Newton step of the design's equilibria.
        journal: As of `optimize`.

    Raises:
        NoEquilibriumError: There is no equilibrium for any start, or, on the design's mesh, for
            any draft.
    """
    c = config
    coarse = replace(case, tile=case.coarse or case.tile)
    problem = tile_problem(batch, coarse, c, log)
    rules = _rules(case, config)
    trial = tuple(
        Stage(c.design.trial_iterations, k * c.design.beta, constrained=c.design.constrained)
        for k in (1, DRAFT_BETA)
    )
    options = replace(rules, stages=trial)
    finalists, trials = _best_starts(problem, coarse, c, options, callback, journal)
    longer = Stage(
        c.design.draft_iterations, DRAFT_BETA * c.design.beta, constrained=c.design.constrained
    )
    options = replace(rules, stages=(longer,))
    drafts = [
        optimize(problem, options, callback=callback, after=one, journal=journal)
        for one in finalists
    ]
    drafts.sort(key=lambda one: _rated(problem, coarse.tile, c, rules, one)[0])
    designs = [gathered(draft) for draft in drafts]
    del drafts, finalists
    problem = tile_problem(batch, case, c, log)
    simulation = PrintSimulation(batch, case, c)
    found: list[TileResult] = []
    failure: NoEquilibriumError | None = None
    for design in designs:
        try:
            result = _finished(
                problem, design.start(problem), c, rules, simulation, callback, journal
            )
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        found.append(replace(result, trials=trials))
        if result.printability.clean and result.deviation <= ACCEPTABLE * c.design.tolerance:
            break
    if not found:
        assert failure is not None
        raise failure
    return min(found, key=lambda one: _badness(one, c))


def _rules(case: TileCase, config: TileDesignScene) -> DesignOptions:
    """Return the stop rules and the step control of all stages."""
    mma = MMAOptions(move=config.design.move_limit)
    if case.target is None:
        return DesignOptions(mma=mma)
    return DesignOptions(
        target_objective=(config.design.tolerance / 2) ** 2,
        min_relative_decrease=MIN_DECREASE,
        mma=mma,
    )


def _finished(
    problem: TileProblem,
    draft: WarmStart,
    config: TileDesignScene,
    rules: DesignOptions,
    simulation: PrintSimulation,
    callback: Callback | None,
    journal: Journal | None,
) -> TileResult:
    """Continue a draft on the design's own mesh and correct the design for its print."""
    c, target = config, problem.target
    last = tuple(
        Stage(c.design.finish_iterations, k * c.design.beta, constrained=c.design.constrained)
        for k in FINAL_BETAS
    )
    result = optimize(
        problem, replace(rules, stages=last), callback=callback, after=draft, journal=journal
    )
    problem = problem.with_projection(Projection(FINAL_BETAS[-1] * c.design.beta, c.design.eta))
    if target is None:
        return simulation.simulate(problem, result)
    assert rules.target_objective is not None
    # No direction may deviate by more than the tolerance: a mean over directions is a weaker rule.
    again = replace(
        rules,
        stages=(Stage(c.design.correction_iterations, constrained=c.design.constrained),),
        target_objective=rules.target_objective / len(problem.solver.angles),
    )

    def asked_again(prints: Sequence[TileResult]) -> TileResult | None:
        last = prints[-1]
        if last.profile is None:
            return None
        objective = _corrected(target, last.result.final.equilibrium, last.profile)
        asking = replace(problem, objective=objective)
        found = optimize(asking, again, callback=callback, after=last.result, journal=journal)
        return simulation.simulate(problem, found)

    def badness(print_: TileResult) -> float:
        return _badness(print_, c)

    def enough(prints: Sequence[TileResult]) -> bool:
        return min(map(badness, prints)) <= c.design.tolerance

    prints = correct(
        simulation.simulate(problem, result), asked_again, enough, c.design.corrections
    )
    return replace(min(prints, key=badness), deviations=tuple(one.deviation for one in prints))


def _best_starts(
    problem: TileProblem,
    case: TileCase,
    config: TileDesignScene,
    options: DesignOptions,
    callback: Callback | None,
    journal: Journal | None,
) -> tuple[list[DesignResult], tuple[Trial, ...]]:
    """Return the two best starts and all trials; one that reaches the target ends the search."""
    found: list[tuple[float, int, bool, DesignResult]] = []
    trials: list[Trial] = []
    failure: NoEquilibriumError | None = None
    for seed in range(config.design.seed, config.design.seed + config.design.starts):
        of_lines = (seed - config.design.seed) % 2 == 0
        try:
            start = _lines(problem, case, seed) if of_lines else None
            result = optimize(
                problem, options, start=start, seed=seed, callback=callback, journal=journal
            )
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        rating, made = _rated(problem, case.tile, config, options, result)
        found.append((rating, seed, made.clean, result))
        trials.append(
            Trial(
                "lines" if of_lines else "waves",
                result.final.objective,
                len(made.island_areas),
                len(made.narrow_lines) + len(made.narrow_gaps),
            )
        )
        if options.target_objective is not None and rating <= options.target_objective:
            return [result], tuple(trials)
    if not found:
        assert failure is not None
        raise failure
    best, *others = sorted(found, key=lambda one: one[:2])
    # The profile of islands depends on narrow gaps. If that fails, a design without them is needed.
    others.sort(key=lambda one: not one[2])
    return [one[-1] for one in (best, *others[:1])], tuple(trials)


def _lines(problem: TileProblem, case: TileCase, seed: int) -> Floats:
    """Return the best of several random pairs of families of lines at owned triangles.

    Raises:
        NoEquilibriumError: There is no equilibrium for any pair.
    """
    best, least = None, np.inf
    failure: NoEquilibriumError | None = None
    rng = np.random.default_rng(seed)
    for _ in range(PAIRS_A_START):
        every = random_lines(case.tile, rng, case.symmetry, problem.filter.radius)
        density = every[problem.skin.owned_cells]
        try:
            objective = problem.simulate(density, trial=True).objective
        except NoEquilibriumError as caught:  # raised by all ranks or by none
            failure = caught
            continue
        if objective < least:
            best, least = density, objective
    if best is None:
        assert failure is not None
        raise failure
    return best


def _rated(
    problem: TileProblem,
    tile: Tile,
    config: TileDesignScene,
    rules: DesignOptions,
    result: DesignResult,
) -> tuple[float, TilePrintability]:
    """Return T, at least its target, times the factors for flaws; and the printability."""
    eta = problem.projection.eta
    values = contour_values(problem, result.density)
    region = printed_regions(tile.pattern, *values, eta)[0]
    made = tile_printability(tile, region, values[1] > eta, config.print.limits)
    limits, widths = problem.length_scale, result.final.length_scale
    satisfied = limits is None or widths is None or bool(np.all(widths <= limits.epsilon))
    narrow = bool(made.narrow_lines or made.narrow_gaps) or not satisfied
    rating = max(result.final.objective, rules.target_objective or 0.0)
    return rating * FLAW_FACTOR ** (narrow + (len(made.island_areas) > 0)), made


def _badness(print_: TileResult, config: TileDesignScene) -> float:
    """Return the deviation of a print, more by `ACCEPTABLE` tolerances if it has flaws."""
    flaws = 0.0 if print_.printability.clean else ACCEPTABLE * config.design.tolerance
    return print_.deviation + flaws


def _corrected(target: ProfileTarget, designed: Profile, printed: Profile) -> ProfileTarget:
    """Return the target of a design that loses as much by printing as this one."""
    changes: dict[str, Any] = {}
    if target.stiffness is not None:
        changes["stiffness"] = target.stiffness * designed.stiffness / printed.stiffness
    if target.contraction is not None:
        lost = designed.contraction - printed.contraction
        changes["contraction"] = target.contraction + lost
    return replace(target, **changes)
