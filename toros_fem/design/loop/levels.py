"""Designs one after the other: from coarse to fine, from several starts, and again for a miss."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import free_dropped, on_first_rank, raise_together, together
from toros_fem.base.validation import Floats, require_count, require_kind
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import SETUP, Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.design.loop.shape_design import ShapeDesign

# What was asked, the design that answers it, and its print: whatever the caller makes of them.
A = TypeVar("A")


def gathered(result: DesignResult) -> CarriedDesign:
    """Return the design of a result as the next mesh takes it over (collective)."""
    problem, final = result.problem, result.final
    return CarriedDesign(
        pattern=problem.skin.pattern,
        density=np.clip(problem.skin.gather_cells(final.density), 0, 1),  # rounding
        pressures=result.pressures,
        positions=problem.physics.shape_of(final.equilibrium),
        poses=tuple(one.problem.physics.shape_of(one.equilibrium) for one in final.poses),
        projected=np.clip(problem.skin.gather_cells(final.projected), 0, 1),
        level=result.history[-1].level + 1,
        history=result.history,
        seconds=result.seconds,
        initial=result.initial,
    )


def optimize_levels(
    problems: Iterable[DesignProblem],
    options: Sequence[DesignOptions],
    *,
    start: Floats | None = None,
    seed: int = 0,
    callback: Callback | None = None,
    finish: Callable[[DesignResult], DesignResult] | None = None,
    after: CarriedDesign | None = None,
    journal: Journal | None = None,
) -> DesignResult:
    """Minimise T on one mesh after the other, from coarse to fine (collective).

    Density, pressures and deformed shape are carried over, so that the first solve on a mesh is
    warm. Only one problem is kept at a time.

    Args:
        problems: The same problem on each mesh, the coarsest first. Each is asked for when it is
            reached: a generator makes it then.
        options: Stages and stop rules on each mesh.
        start: ρ to start from at owned triangles of the coarsest mesh, in [0, 1]; None takes the
            problem's own start with random noise.
        seed: Seed of that noise.
        callback: Called after each iteration, on every rank; the row says which level it is of.
        finish: Returns what is carried over, or returned at the end, from the result on each mesh;
            None leaves it as it is.
        after: A design that goes before the first mesh, of `best_start` for instance; it takes the
            place of `start` and `seed`.
        journal: As of `optimize`.

    Returns:
        The result on the finest mesh; its history and times are those of all.

    Raises:
        ParameterError: There are no options, or fewer problems than options.
        PanelError: Two problems have other panels.
        ParameterError, NoEquilibriumError, CheckpointError, RunStoppedError: As for `optimize`.
    """
    require_kind("problems", problems, Iterable, "DesignProblems, one for each level")
    remaining, finish = iter(problems), finish or (lambda result: result)
    problem = next(remaining, None)
    check = partial(_rules, options)
    if isinstance(problem, DesignProblem):  # else `optimize` refuses it
        options = on_first_rank(problem.comm, check)
    else:
        check()
    if problem is None:
        raise _too_few(0, len(options))
    run = partial(optimize, callback=callback, journal=journal)
    result = finish(run(problem, options[0], start=start, seed=seed, after=after))
    del problem
    for level, rules in enumerate(options[1:], 1):
        begin = time.perf_counter()
        design, comm = gathered(result), result.problem.comm
        del result
        free_dropped(comm)
        if (problem := next(remaining, None)) is None:
            raise _too_few(level, len(options))
        spent = design.seconds.get(SETUP, 0.0) + time.perf_counter() - begin
        design = replace(design, seconds={**design.seconds, SETUP: spent})
        result = finish(run(problem, rules, after=design))
        del problem
    return result


def refinements(design: ShapeDesign, levels: int) -> Iterator[ShapeDesign]:
    """Yield a design on its own mesh, then on meshes that are refined uniformly (collective).

    The filter radius halves with the edges: give the coarsest. Each is made from the one before
    when it is asked for, so that two are kept at that moment.

    Args:
        design: The design on the coarsest mesh.
        levels: Number of meshes.

    Raises:
        ParameterError: The number is not whole or less than 1, or as for `ShapeDesign.refined`.
    """
    require_kind("design", design, ShapeDesign, "a ShapeDesign")
    require_count(1, levels=levels)
    yield design
    for _ in range(levels - 1):
        design = design.refined()
        yield design


def _rules(options: Sequence[DesignOptions]) -> Sequence[DesignOptions]:
    """Return the options of all levels, checked."""
    require_kind("options", options, (list, tuple), "a list of DesignOptions, one for each level")
    for rules in options:
        require_kind("options", rules, DesignOptions, "DesignOptions, one for each level")
    if not options:
        raise ParameterError("options is empty; give DesignOptions for each level.")
    return options


def _too_few(level: int, levels: int) -> ParameterError:
    return ParameterError(
        f"there are {level} problems for {levels} levels; options needs one entry for each problem."
    )


@dataclass(frozen=True, eq=False)
class BestStart:
    """The best of several starts.

    Attributes:
        design: Its design, on every rank.
        seed: Its seed.
        objectives: Final T of each seed; infinite without an equilibrium.
    """

    design: CarriedDesign
    seed: int
    objectives: dict[int, float]


def best_start(
    comm: MPI.Comm,
    make: Callable[[MPI.Comm], DesignProblem],
    options: DesignOptions,
    seeds: Sequence[int],
    journal: Journal | None = None,
) -> BestStart:
    """Design each of several random starts on one rank alone; return the best (collective).

    The ranks share out the seeds. A design whose widths are satisfied is better than one whose are
    not; of these the one with the lower T is, and of equals the one that comes first. The result
    does not depend on the number of ranks, where each has as many threads.

    Args:
        make: Makes the problem on a communicator of one rank.
        seeds: Seeds of the noise, none of them twice.
        journal: Each seed has a branch of its own.

    Raises:
        NoEquilibriumError: No start has an equilibrium.
    """
    found: dict[int, tuple[bool, float]] = {}
    best: CarriedDesign | None = None
    failure: NoEquilibriumError | None = None
    with together(comm):
        mine = seeds[comm.rank :: comm.size]
        problem = make(MPI.COMM_SELF) if mine else None
        for seed in mine:
            assert problem is not None
            try:
                part = (journal or Journal()).branch(f"seed-{seed}")
                result = optimize(problem, options, seed=seed, journal=part)
            except NoEquilibriumError as caught:
                failure = caught
                continue
            score = _score(result, options)
            if not found or score < min(found.values()):
                best = gathered(result)
            found[seed] = score
    every: dict[int, tuple[bool, float]] = {}
    for part in comm.allgather(found):
        every.update(part)
    if not every:
        raise_together(comm, failure)
    seed = min((s for s in seeds if s in every), key=lambda s: every[s])
    owner = list(seeds).index(seed) % comm.size
    design = comm.bcast(best if comm.rank == owner else None, root=owner)
    assert design is not None
    return BestStart(design, seed, {s: every[s][1] if s in every else np.inf for s in seeds})


def _score(result: DesignResult, options: DesignOptions) -> tuple[bool, float]:
    """Return whether the widths are violated, and T: smaller is better."""
    limits, widths = result.problem.length_scale, result.final.length_scale
    violated = False
    if options.stages[-1].constrained and limits is not None and widths is not None:
        violated = bool(np.any(widths > limits.epsilon))
    return violated, result.final.objective


def correct(
    first: A,
    again: Callable[[Sequence[A]], A | None],
    enough: Callable[[Sequence[A]], bool],
    rounds: int,
) -> list[A]:
    """Return the attempts to hit a target, the first and those that correct it (collective).

    Args:
        first: The first attempt.
        again: Returns the next attempt, from all before it; None where no more can be asked.
        enough: Whether these attempts are enough.
        rounds: Largest number of corrections.
    """
    attempts = [first]
    while len(attempts) <= rounds and not enough(attempts):
        attempt = again(attempts)
        if attempt is None:
            break
        attempts.append(attempt)
    return attempts
