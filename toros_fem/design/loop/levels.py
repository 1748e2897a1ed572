"""Design from coarse to fine: each mesh goes on from the design of the one before."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import free_dropped
from toros_fem.base.validation import require_count, require_kind
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Iteration
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.warm_start import InitialDensity, WarmStart
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import make_transfer

# Key of the wall time for meshes, problems and transfers of all levels but the first.
SETUP = "next levels"


@dataclass(frozen=True, eq=False)
class GatheredDesign:
    """A design on its whole mesh, on every rank, without the problem that it came from.

    Attributes:
        pattern: The pattern.
        density: ρ of all triangles, (t,).
        projected: ρ̄ of all triangles, (t,).
        positions: Positions of all vertices, (n, 3), in m; None where a finer mesh starts from the
            assembled shape.
        pressures: Pressure of each chamber in Pa; empty without any.
        history: Rows of the design so far.
        seconds: Wall time so far by phase.
        initial: The density that the design began with; None where it began with none.
    """

    pattern: Pattern
    density: Floats
    projected: Floats
    positions: Floats | None
    pressures: tuple[float, ...]
    history: tuple[Iteration, ...]
    seconds: Mapping[str, float]
    initial: InitialDensity | None

    def start(self, problem: DesignProblem) -> WarmStart:
        """Return the start of the same design on another mesh (collective).

        ρ̄ becomes the density to start from, so that the filter of the new mesh sees the lines of
        the print with sharp borders. On the same mesh ρ stays.

        Args:
            problem: The same problem on another mesh of the same panels.

        Raises:
            PanelError: Its panels are others.
        """
        target = problem.skin.pattern
        transfer = make_transfer(self.pattern, target)
        same = np.array_equal(self.pattern.flat_triangles, target.flat_triangles) and (
            np.array_equal(self.pattern.flat_points, target.flat_points)
        )
        carried = self.density if same else self.projected
        state = None
        if self.positions is not None:
            state = problem.physics.state_at(transfer.positions(self.positions))
        return WarmStart(
            density=transfer.at_cells(carried)[problem.skin.owned_cells],
            pressures=self.pressures,
            state=state,
            history=self.history,
            seconds=self.seconds,
            level=self.history[-1].level + 1,
            initial=self.initial,
        )


def gathered(result: DesignResult) -> GatheredDesign:
    """Gather the design of a result on every rank (collective)."""
    problem, final = result.problem, result.final
    return GatheredDesign(
        pattern=problem.skin.pattern,
        density=np.clip(problem.skin.gather_cells(final.density), 0, 1),  # rounding
        projected=np.clip(problem.skin.gather_cells(final.projected), 0, 1),
        positions=problem.physics.shape_of(final.equilibrium),
        pressures=result.pressures,
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
    after: GatheredDesign | None = None,
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
        DensityError, NoEquilibriumError, CheckpointError, RunStoppedError: As for `optimize`.
    """
    if not isinstance(options, list | tuple):
        raise ParameterError("options must be a list of DesignOptions, one for each level.")
    for rules in options:
        require_kind("options", rules, DesignOptions, "DesignOptions, one for each level")
    if not options:
        raise ParameterError("options is empty; give DesignOptions for each level.")
    remaining, finish = iter(problems), finish or (lambda result: result)
    problem = _following(remaining, 0, len(options))
    warm = None if after is None else after.start(problem)
    result = finish(
        optimize(
            problem,
            options[0],
            start=start,
            seed=seed,
            callback=callback,
            after=warm,
            journal=journal,
        )
    )
    del problem
    for level, rules in enumerate(options[1:], 1):
        begin = time.perf_counter()
        design, comm = gathered(result), result.problem.comm
        del result
        free_dropped(comm)
        problem = _following(remaining, level, len(options))
        warm = design.start(problem)
        spent = warm.seconds.get(SETUP, 0.0) + time.perf_counter() - begin
        warm = replace(warm, seconds={**warm.seconds, SETUP: spent})
        result = finish(optimize(problem, rules, callback=callback, after=warm, journal=journal))
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


def _following(problems: Iterable[DesignProblem], level: int, levels: int) -> DesignProblem:
    for problem in problems:
        return problem
    raise ParameterError(
        f"there are {level} problems for {levels} levels; options needs one entry for each problem."
    )
