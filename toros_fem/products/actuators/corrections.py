"""A design goes on towards what its print misses."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.base.validation import require_callable, require_count, require_kind
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.free_islands import polished
from toros_fem.measures.figures import DEFAULT, Tolerances
from toros_fem.measures.miss import way_of_sections
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.space_mapping import HELPS
from toros_fem.products.actuators.trim import SHARE, trimmed, worst_of_print

# Largest number of corrections; steps of each, and the largest change of a density in one.
ROUNDS, STEPS, MOVE = 4, 20, 0.05
# A print whose worst figure is off by this part of its tolerance is good enough.
GOOD = 0.25


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
    asked = result.problem.case.goal

    def helps(attempt: DesignResult, target: Floats) -> bool:
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
    asked: Floats,
    options: DesignOptions,
    callback: Callback | None,
    journal: Journal | None,
) -> tuple[DesignResult, Floats]:
    """Return the design that is asked for what the print of the last one missed, and its target.

    That of the last one was `asked`.
    """
    problem, own, made = last.problem, last.final.equilibrium, printed.evaluation
    assert isinstance(problem, ShapeDesign)
    assert made is not None
    mesh = make_transfer(made.problem.skin.pattern, problem.skin.pattern)
    shape, designed = made.problem.physics.shape_of(made.equilibrium), problem.physics.shape_of(own)
    assert shape is not None
    whole = problem.whole
    left = way_of_sections(whole.pattern, whole.at_vertices(designed), whole.at_vertices(asked))
    target = problem.case.goal + designed - mesh.positions(shape) + left[: len(designed)]
    bounds = [
        given and (max(given[0], (1 - SHARE) * at), min(given[1], (1 + SHARE) * at))
        for given, at in zip(problem.physics.pressure_ranges, own.pressures, strict=True)
    ]
    physics = replace(problem.physics, pressure=own.pressures, pressure_bounds=bounds)
    asking = problem.towards(replace(problem.case, target=target)).changed(physics=physics)
    found = optimize(asking, options, callback=callback, after=last, journal=journal)
    shape_part = problem.objective.forward(found.final.equilibrium.positions)
    final = replace(found.final, shape=shape_part)
    return replace(found, problem=problem, final=final), target
