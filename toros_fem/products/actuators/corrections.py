"""What a print misses is asked for again: of densities, of lines (space mapping)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import free_dropped, on_first_rank, rounded
from toros_fem.base.validation import Floats, require_callable, require_count, require_kind
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.miss import Aim, Residuals
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.making.as_printed import PrintedDesign, as_printed, polished
from toros_fem.measures.cross_sections import Rod
from toros_fem.measures.figures import DEFAULT, Tolerances
from toros_fem.measures.miss import way_of_sections
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.pressure import SHARE, trimmed, worst_of_print

# Largest number of corrections; steps of each, and the largest change of a density in one.
ROUNDS, STEPS, MOVE = 4, 20, 0.05
# A print whose worst figure is off by this part of its tolerance is good enough.
GOOD = 0.25
# A print is good enough where every metric is this close to its target, over its scale.
CLOSE = 5e-3
# Below this error lines stay where they are: what is left is of the size of the mesh's error, and
# of that by which prints of like designs differ.
FINE = 5e-2
# A correction helps that leaves at most this part of the worst error.
HELPS = 0.7
# What is asked is rounded to this part of its metric's scale.
RESOLUTION = 1e-5
# Bounds on the change of a printed metric over that of the one asked.
LEAST_SLOPE, LARGEST_SLOPE = 0.4, 3.0
# Largest change of what is asked in one round, over the scale of its metric.
LARGEST_STEP = 0.4
# Least curvature, over that of an arc of 1 rad, and stretch that count as 1, and largest change of
# a strain in one round, over what counts as 1.
TURN, STRETCH, STRAIN_STEP = 1.0, 0.2, 1.0
# Weights of a strain and its neighbours: between lines the strains of a print vary.
SMOOTH = (0.25, 0.5, 0.25)


def corrected(
    result: DesignResult,
    printed: PrintedDesign,
    options: DesignOptions | None = None,
    *,
    print_again: Callable[[DesignResult], PrintedDesign] | None = None,
    rounds: int = ROUNDS,
    tolerances: Tolerances = DEFAULT,
    callback: Callback | None = None,
    journal: Journal | None = None,
) -> tuple[DesignResult, PrintedDesign]:
    """Return the design whose print is nearest to its targets, after corrections (collective).

    The design goes on towards a target that is moved, vertex by vertex, by what it has beyond its
    print (output space mapping, Bandler et al. 2004), and by what the centres of its cross-sections
    miss of the last target. Pressures that are designed are free as far as a print is trimmed.
    Where the first print has free islands, the design first goes on without them. This ends once
    the print is good, or once a round has hardly helped.

    Args:
        result: A design of a `ShapeDesign`.
        printed: Its print; without an equilibrium there is no correction.
        options: Steps of each correction; None takes 20 small ones, with the widths of the design.
        print_again: Returns the print of a design; None makes it as the first one, at the pressure
            that suits it best.
        rounds: Largest number of corrections; 0 leaves them out.
        tolerances: How far figures may be off.
        callback, journal: As of `optimize`.

    Raises:
        ParameterError: An argument has another type, or is negative.
    """
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    require_kind("its problem", result.problem, ShapeDesign, "a ShapeDesign")
    require_kind("printed", printed, PrintedDesign, "the PrintedDesign of as_printed")
    if options is None:
        widths = result.problem.length_scale is not None
        options = DesignOptions((Stage(STEPS, constrained=widths),), mma=MMAOptions(move=MOVE))
    require_kind("options", options, DesignOptions, "DesignOptions, or None")
    limits, area = printed.limits, printed.cleaned.island_area

    def as_before(again: DesignResult) -> PrintedDesign:
        made = as_printed(again.problem, again, limits, island_area=area, journal=journal)
        return trimmed(made, tolerances=tolerances)

    again_printed = as_before if print_again is None else print_again
    require_callable("print_again", again_printed, "a function of a DesignResult, or None")
    require_count(0, rounds=rounds)
    comm = result.problem.comm
    best, least = (result, printed), worst_of_print(printed, tolerances)
    assert isinstance(result.problem, ShapeDesign)
    asked = [pose.case.asks for pose in (result.problem, *result.problem.poses)]

    def helps(attempt: DesignResult, target: list[Floats]) -> bool:
        nonlocal best, least, asked
        made, before = again_printed(attempt), least
        worst = worst_of_print(made, tolerances)
        if worst < least:
            best, least, asked = (attempt, made), worst, target
        free_dropped(comm)
        return worst <= HELPS * before

    islands = on_first_rank(comm, lambda: len(printed.before.free_islands))
    with suppress(NoEquilibriumError):  # raised by all ranks or by none
        if islands and rounds and least > GOOD:
            helps(polished(result, printed, options, callback=callback, journal=journal), asked)
        for _ in range(rounds):
            if least <= GOOD or best[1].evaluation is None:
                break
            if not helps(*_again(*best, asked, options, callback, journal)):
                break
    return best


def _again(
    last: DesignResult,
    printed: PrintedDesign,
    asked: Sequence[Floats],
    options: DesignOptions,
    callback: Callback | None,
    journal: Journal | None,
) -> tuple[DesignResult, list[Floats]]:
    """Return the design that is asked for what the print of the last one missed, and its targets.

    Those of the last one were `asked`, one for each pose.
    """
    problem, pressures = last.problem, last.final.equilibrium.pressures
    made = printed.evaluation
    assert isinstance(problem, ShapeDesign)
    assert made is not None
    every = zip((problem, *problem.poses), last.final.every, made.every, asked, strict=True)
    targets = [_target(*pose) for pose in every]
    cases = [
        pose.case.asking(target)
        for pose, target in zip((problem, *problem.poses), targets, strict=True)
    ]
    bounds = [
        given and (max(given[0], (1 - SHARE) * at), min(given[1], (1 + SHARE) * at))
        for given, at in zip(problem.physics.pressure_ranges, pressures, strict=True)
    ]
    physics = replace(problem.physics, pressure=pressures, pressure_bounds=bounds)
    asking = problem.towards(replace(cases[0], poses=cases[1:])).changed(physics=physics)
    found = optimize(asking, options, callback=callback, after=last, journal=journal)
    shapes = [
        pose.objective.forward(pose.physics.observed(one.equilibrium))
        for pose, one in zip((problem, *problem.poses), found.final.every, strict=True)
    ]
    final = replace(found.final, shape=problem.mean(shapes))
    return replace(found, problem=problem, final=final), targets


def _target(
    problem: ShapeDesign,
    designed: Evaluation[Equilibrium],
    printed: Evaluation[Equilibrium],
    asked: Floats,
) -> Floats:
    """Return what to ask of a pose for what its print missed, where the last target was `asked`."""
    if problem.case.blocked is not None:
        (push,) = printed.problem.metrics_of(printed.equilibrium).values()
        # A force is asked for as a least value: what the print has beyond it is not taken away.
        return np.asarray(asked + max(float(problem.case.asks) - push, 0.0))
    mesh = make_transfer(printed.problem.skin.pattern, problem.skin.pattern)
    shape, own = (
        one.problem.skin.gather_vertices(one.equilibrium.positions) for one in (printed, designed)
    )
    whole = problem.whole
    left = way_of_sections(whole.pattern, whole.at_vertices(own), whole.at_vertices(asked))
    return np.asarray(problem.case.goal + own - mesh.positions(shape) + left[: len(own)])


def asked_next(
    got: Sequence[Mapping[str, float]],
    asked: Sequence[Mapping[str, float]],
    aims: Mapping[str, Aim],
) -> dict[str, float]:
    """Return which targets to ask for next, by `next_asked`.

    Args:
        got, asked: Metrics of all rounds, the last one last, and what was asked of them, by key.
        aims: The metrics that count.
    """
    size = np.array([aim.scale for aim in aims.values()])

    def vector(values: Mapping[str, float]) -> Floats:
        return np.array([values[key] for key in aims]) / size

    target = vector({key: aim.target for key, aim in aims.items()})
    found = next_asked([*map(vector, asked)], [*map(vector, got)], target, LARGEST_STEP)
    return dict(zip(aims, map(float, size * rounded(found, RESOLUTION)), strict=True))


@dataclass(frozen=True, eq=False)
class StrainResponse:
    """Strains of cross-sections that were asked beyond the target's, and what the print has beyond.

    Attributes:
        asked, printed: Differences from the strains of the target, (k, 6), as of `Rod.strains`.
    """

    asked: Floats
    printed: Floats


def strains_beyond(rod: Rod, goal: Rod) -> Floats:
    """Return the strains of a shape minus those of the target, smoothed along it, (k, 6)."""
    off = rod.strains - goal.strains
    ends = np.concatenate([off[:1], off, off[-1:]])
    return np.asarray(SMOOTH[0] * ends[:-2] + SMOOTH[1] * off + SMOOTH[2] * ends[2:])


def strains_to_ask(goal: Rod, answers: Sequence[StrainResponse]) -> Floats:
    """Return the strains to ask for next, beyond those of the target, (k, 6), by `next_asked`."""
    length = float(np.linalg.norm(goal.rest[-1] - goal.rest[0]))
    turn = max(TURN, length * float(np.abs(goal.strains[:, :3]).max())) / length
    size = np.repeat([turn, STRETCH], 3)
    asked, printed = (
        [(s / size).ravel() for s in of]
        for of in ([a.asked for a in answers], [a.printed for a in answers])
    )
    strains = next_asked(asked, printed, np.zeros_like(asked[0]), STRAIN_STEP)
    return size * rounded(strains, RESOLUTION).reshape(-1, 6)


def with_strains(residuals: Residuals, strains: Floats) -> Case:
    """Return the case of residuals with a target that has strains (k, 6) beyond its own."""
    assert residuals.labels is not None
    goal, whole = residuals.case.goal, residuals.case.whole
    rod = residuals.rod(goal)
    other = rod.strained(rod.strains + strains)
    moved = rod.carried(residuals.labels, whole.at_vertices(goal), other)
    return replace(residuals.case, target=moved[: len(goal)])  # those of the part come first


def next_asked(
    asked: Sequence[Floats], printed: Sequence[Floats], target: Floats, largest: float
) -> Floats:
    """Return what to ask for next: Broyden's step, whose first matrix is the identity.

    Broyden's matrix, the change of printed by that of asked numbers, also knows what one of them
    does to another.

    Args:
        asked, printed: Numbers of each round, (j,).
        target: What shall be printed.
        largest: Largest change of a number.
    """
    slope: Floats = np.eye(len(target))
    for k in range(1, len(asked)):
        step, change = asked[k] - asked[k - 1], printed[k] - printed[k - 1]
        if step @ step > 0:
            slope += np.outer(change - slope @ step, step) / (step @ step)
    left, value, right = np.linalg.svd(slope)
    value = np.clip(value, LEAST_SLOPE, LARGEST_SLOPE)
    step = right.T @ (left.T @ (target - printed[-1]) / value)
    return np.asarray(asked[-1] + np.clip(step, -largest, largest))
