"""Stable equilibria of a skin through a sequence of pressures, each the start of the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.paths.trace_point import Pressure, TracePoint, measured_point

# Smallest increment between two pressures, as a fraction of their difference.
LEAST_INCREMENT = 1 / 100


def follow_pressures(
    solver: EquilibriumSolver,
    density: Floats,
    pressures: Sequence[Pressure],
    metrics: Sequence[Metric],
    start: Floats | EquilibriumResult | None,
    force: Floats | None,
) -> Iterator[TracePoint]:
    """Yield the equilibria at one pressure after the other (collective); `trace` has the arguments.

    Raises:
        EquilibriumError: There is no equilibrium at one of the pressures; the points before it
            have been yielded.
    """
    before: EquilibriumResult | None = None
    if isinstance(start, EquilibriumResult):
        before, start = start, None
    for pressure in pressures:
        if before is None:
            before = solver.solve(density, pressure, force=force, start=start)
        else:
            before = _continue(solver, density, before, pressure, force)
        yield measured_point(solver, pressure, before, metrics)


def _continue(
    solver: EquilibriumSolver,
    density: Floats,
    before: EquilibriumResult,
    pressure: Pressure,
    force: Floats | None,
) -> EquilibriumResult:
    """Find the equilibrium at a pressure by continuation from another one."""
    begin = np.asarray(before.pressures)
    change = np.broadcast_to(pressure, begin.shape) - begin
    last = reached = before

    def attempt(_: Floats, fraction: float) -> Attempt:
        nonlocal last, reached
        level = (begin + fraction * change).tolist()
        last = solver.solve(
            density, level, force=force, start=reached, raise_on_failure=False, trial=True
        )
        steps = last.steps
        if last.converged:
            try:
                last = solver.finish(last)
            except EquilibriumError as error:  # raised by all ranks or by none
                last = error.result
            steps += last.steps
        if last.converged:
            reached = last
        return Attempt(last.state, 1 if last.converged else -1, steps)

    done = run_continuation(
        attempt, ContinuationResult(before.state, 0.0, 1), 1.0, 1.0, LEAST_INCREMENT
    )
    if done.load_factor != 1.0:
        raise EquilibriumError(
            f"the path ends between {_written(begin)} and {_written(begin + change)} Pa, after "
            f"{100 * (done.load_factor or 0.0):.0f} % of the change: {last.reason} Beyond a limit "
            'point a path goes on by="arc-length".',
            last,
        )
    return last


def _written(pressures: Floats) -> str:
    return " and ".join(f"{p:g}" for p in pressures)
