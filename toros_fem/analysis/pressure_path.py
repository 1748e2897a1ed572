"""Equilibria of a skin through a sequence of pressures, each the start of the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats
from toros_fem.equilibrium.continuation import Attempt, ContinuationResult, run_continuation
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver
from toros_fem.objectives.metrics import Metric

Pressure = float | Sequence[float]

# Smallest increment between two pressures, as a fraction of their difference.
LEAST_INCREMENT = 1 / 100


@dataclass(frozen=True, eq=False)
class PressurePathPoint:
    """One equilibrium of a path.

    Attributes:
        pressure: Requested pressure in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3).
        metrics: Values of the metrics, by key.
        result: The equilibrium.
    """

    pressure: Pressure
    positions: Floats
    metrics: dict[str, float]
    result: EquilibriumResult


def trace_pressure_path(
    solver: EquilibriumSolver,
    density: Floats,
    pressures: Sequence[Pressure],
    metrics: Sequence[Metric] = (),
    start: Floats | EquilibriumResult | None = None,
) -> Iterator[PressurePathPoint]:
    """Yield the equilibria at one pressure after the other (collective).

    Where the skin snaps, the equilibrium depends on the path. So each is reached from the one
    before, at once or, where that fails, in smaller increments of the pressures. Only the first
    may start from the assembled skin, if no start is given.

    Args:
        solver: Equilibrium solver.
        density: Projected density of its owned triangles.
        pressures: In Pa, in the order in which they act.
        metrics: Metrics to compute at each point.
        start: As for `EquilibriumSolver.solve`; None starts from the assembled skin. From an
            equilibrium at this density the first one is reached as each from the one before.

    Raises:
        EquilibriumError: There is no equilibrium at one of the pressures; the points before it
            have been yielded.
    """
    before: EquilibriumResult | None = None
    if isinstance(start, EquilibriumResult):
        before, start = start, None
    for pressure in pressures:
        if before is None:
            before = solver.solve(density, pressure, start=start)
        else:
            before = _continue(solver, density, before, pressure)
        yield measured_point(solver, pressure, before, metrics)


def measured_point(
    solver: EquilibriumSolver,
    pressure: Pressure,
    result: EquilibriumResult,
    metrics: Sequence[Metric],
) -> PressurePathPoint:
    """Return an equilibrium with its metrics, as a point of a path (collective)."""
    skin = solver.skin
    positions = skin.gather_vertices(result.positions)
    values = {f.key: float(f.measure(skin.pattern, positions)) for f in metrics}
    return PressurePathPoint(pressure, positions, values, result)


def _continue(
    solver: EquilibriumSolver, density: Floats, before: EquilibriumResult, pressure: Pressure
) -> EquilibriumResult:
    """Find the equilibrium at a pressure by continuation from another one."""
    begin = np.asarray(before.pressures)
    change = np.broadcast_to(pressure, begin.shape) - begin
    last = before

    def attempt(state: Floats, fraction: float) -> Attempt:
        nonlocal last
        level = (begin + fraction * change).tolist()
        last = solver.solve(density, level, start=state, raise_on_failure=False, trial=True)
        steps = last.steps
        if last.converged:
            try:
                last = solver.finish(last)
            except EquilibriumError as error:  # raised by all ranks or by none
                last = error.result
            steps += last.steps
        return Attempt(last.state, 1 if last.converged else -1, steps)

    done = run_continuation(
        attempt, ContinuationResult(before.state, 0.0, 1), 1.0, 1.0, LEAST_INCREMENT
    )
    if done.load_factor != 1.0:
        raise EquilibriumError(
            f"the path ends between {_written(begin)} and {_written(begin + change)} Pa, after "
            f"{100 * (done.load_factor or 0.0):.0f} % of the change: {last.reason}",
            last,
        )
    return last


def _written(pressures: Floats) -> str:
    return " and ".join(f"{p:g}" for p in pressures)
