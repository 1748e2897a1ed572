"""A skin through a sequence of pressures, each equilibrium the start of the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats
from toros_fem.equilibrium.continuation import ContinuationResult, run_continuation
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver
from toros_fem.objectives.metrics import Metric

Pressure = float | Sequence[float]

# Smallest step between two pressures, as a share of the way.
LEAST_SHARE = 1 / 100


@dataclass(frozen=True, eq=False)
class PressurePathPoint:
    """One equilibrium of a path.

    Attributes:
        pressure: What was asked for, in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3).
        figures: What was measured, by key.
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
    start: Floats | None = None,
) -> Iterator[PressurePathPoint]:
    """Equilibria at pressures one after the other (collective).

    What is found depends on the way where the skin snaps. So each is reached from the one before,
    at once or, where that fails, in smaller steps of the pressures, and never anew from the
    assembled skin; only the first may be, if no start is given.

    Args:
        solver: Equilibrium solver.
        density: Projected density of its owned triangles.
        pressures: In Pa, in the order in which they act.
        figures: What to measure of each.
        start: As for `EquilibriumSolver.solve`; None starts from the assembled skin.

    Raises:
        EquilibriumError: There is no equilibrium at one of them; those before have been given out.
    """
    skin, before = solver.skin, None
    for pressure in pressures:
        if before is None:
            result = solver.solve(density, pressure, start=start)
        else:
            result = _reached(solver, density, before, pressure)
        positions = skin.gather_vertices(result.positions)
        measured = {f.key: float(f.measure(skin.pattern, positions)) for f in metrics}
        yield PressurePathPoint(pressure, positions, measured, result)
        before = result


def _reached(
    solver: EquilibriumSolver, density: Floats, before: EquilibriumResult, pressure: Pressure
) -> EquilibriumResult:
    """The equilibrium at a pressure, by steps from another one."""
    begin = np.asarray(before.pressures)
    way = np.broadcast_to(pressure, begin.shape) - begin
    last = before

    def attempt(state: Floats, share: float) -> tuple[Floats, int, int]:
        nonlocal last
        level = (begin + share * way).tolist()
        last = solver.solve(
            density, level, start=state, raise_on_failure=False, allow_continuation=False
        )  # fmt: skip
        return last.state, 1 if last.converged else -1, last.steps

    done = run_continuation(
        attempt, ContinuationResult(before.state, 0.0, 1), 1.0, 1.0, LEAST_SHARE
    )
    if done.load_factor != 1.0:
        raise EquilibriumError(
            f"the path ends on the way from {_written(begin)} to {_written(begin + way)} Pa, "
            f"{100 * (done.load_factor or 0.0):.0f} % of it done: {last.reason}",
            last,
        )
    return last


def _written(pressures: Floats) -> str:
    return " and ".join(f"{p:g}" for p in pressures)
