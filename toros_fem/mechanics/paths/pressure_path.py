"""Stable equilibria of a skin through a sequence of loads, each the start of the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from toros_fem.base.array_types import Floats
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace_point import TracePoint, measured_point
from toros_fem.mechanics.skin.load import Load, Pressure

# Smallest increment between two loads, as a fraction of their difference.
LEAST_INCREMENT = 1 / 100


def follow_pressures(
    solver: EquilibriumSolver,
    density: Floats,
    loads: Sequence[Load | Pressure],
    metrics: Sequence[Metric],
    start: Floats | Equilibrium | None,
) -> Iterator[TracePoint]:
    """Yield the equilibria under one load after the other (collective); `trace` has the arguments.

    Raises:
        EquilibriumError: There is no equilibrium under one of the loads; the points before it
            have been yielded.
    """
    before: Equilibrium | None = None
    if isinstance(start, Equilibrium):
        before, start = start, None
    for load in loads:
        if before is None:
            before = solver.solve(density, load, start)
        else:
            # Of a pressure alone the rest of the load stays.
            given = load if isinstance(load, Load) else replace(before.load, pressure=load)
            before = _continue(solver, density, before, given.on(solver.model))
        yield measured_point(solver, before, metrics)


def _continue(
    solver: EquilibriumSolver, density: Floats, before: Equilibrium, load: Load
) -> Equilibrium:
    """Find the equilibrium under a load by continuation from another one."""
    begin = before.load
    last = reached = before

    def attempt(_: Floats, fraction: float) -> Attempt:
        nonlocal last, reached
        level = begin.towards(load, fraction) if fraction < 1 else load
        last = solver.solve(density, level, after=reached, raise_on_failure=False, trial=True)
        steps = last.steps
        if last.converged:
            try:
                last = reached = solver.finish(last)
            except EquilibriumError as error:  # raised by all ranks or by none
                last = error.result
            steps += last.steps
        return Attempt(last.state, 1 if last.converged else -1, steps)

    start = ContinuationResult(before.state, 0.0, 1)
    done = run_continuation(attempt, start, 1.0, 1.0, LEAST_INCREMENT)
    if done.load_factor != 1.0:
        raise EquilibriumError(
            f"the path ends between {begin} and {load}, after "
            f"{100 * (done.load_factor or 0.0):.0f} % of the change: {last.reason} Beyond a limit "
            'point a path goes on by="arc-length".',
            last,
        )
    return last
