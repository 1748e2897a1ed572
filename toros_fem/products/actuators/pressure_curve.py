"""Metrics of a printed actuator over the pressure, from where the pressure fills the skin."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toros_fem.base.files import write_table, write_together
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.measures.metrics import Measurement
from toros_fem.mechanics.equilibrium.solver import EquilibriumError, EquilibriumResult
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint, measured_point
from toros_fem.results.frames.record import shown_skin, write_path
from toros_fem.results.writer import if_plotting

if TYPE_CHECKING:  # a scene's curve is followed here, and says so
    from toros_fem.products.actuators.scene import ActuatorScene

# Below its first step the pressure is halved so often, since slender skins move most there.
HALVINGS = 6
# Pressures that differ by this fraction are the same.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class PressureCurve:
    """Equilibria of a printed skin over the pressure.

    Attributes:
        points: Equilibria by rising pressure; that of the print is one of them.
        unfilled_at: Largest pressure in Pa at which the skin was found to enclose less than its
            assembled shape, which is no point any more; None if it was filled at all.
        failure_below, failure_above: Why there is no equilibrium at lower or higher pressures;
            None if the curve was followed to its end.
    """

    points: tuple[TracePoint, ...]
    unfilled_at: float | None
    failure_below: str | None
    failure_above: str | None


def trace_pressure_curve(
    problem: ShapeProblem,
    made: Evaluation[EquilibriumResult],
    largest: float,
    steps: int,
    further: Sequence[float] = (),
) -> PressureCurve:
    """Follow a print from its pressure down until the skin is not filled, and up (collective).

    The pressures are multiples of the step. Below one step they are halved, `HALVINGS` times at
    most. Several chambers keep the ratios of their pressures. A skin is filled where it encloses at
    least the volume of its assembled shape. While its equilibria are stable, the volume of a
    chamber rises with its pressure, so that this begins at one pressure.

    Args:
        problem: The design problem.
        made: Evaluation of the print, at its pressure.
        largest: Largest pressure in Pa; the curve ends at that of the print if this is larger.
        steps: Number of steps from 0 to there.
        further: Further pressures in Pa, > 0; those above the largest are left out.
    """
    solver, begin = problem.solver, made.equilibrium
    known = np.asarray(begin.pressures)
    ratios = known / begin.pressure if begin.pressure > 0 else np.ones_like(known)
    empty = float(sum(solver.model.volumes(solver.model.assembled)))
    lower, higher = _pressures(begin.pressure, largest, steps, further)

    def follow(pressures: Sequence[float]) -> tuple[list[TracePoint], str | None]:
        """Return the points as long as the skin is filled, and why there are no more."""
        levels = [[float(p) for p in pressure * ratios] for pressure in pressures]
        found: list[TracePoint] = []
        if not levels:
            return found, None
        try:
            for point in trace(solver, made.projected, levels, problem.metrics, start=begin):
                found.append(point)
                if point.result.volume < empty:
                    break
        except EquilibriumError as caught:  # raised by all ranks or by none
            return found, str(caught)
        return found, None

    below, failure_below = follow(lower)
    above, failure_above = follow(higher)
    unfilled_at = None
    if below and below[-1].result.volume < empty:
        unfilled_at = below.pop().result.pressure
    middle = measured_point(solver, begin.pressure, begin, problem.metrics)
    points = (*reversed(below), middle, *above)
    return PressureCurve(points, unfilled_at, failure_below, failure_above)


def _pressures(
    design: float, largest: float, steps: int, further: Sequence[float]
) -> tuple[list[float], list[float]]:
    """Return the pressures in Pa below that of the design, falling, and above, rising."""
    grid = largest * np.arange(1, steps + 1) / steps
    for pressure in further:
        if pressure <= largest and not np.isclose(grid, pressure, rtol=SAME, atol=0).any():
            grid = np.sort([*grid, pressure])
    lower = [float(p) for p in grid[::-1] if p < (1 - SAME) * design]
    least = lower[-1] if lower else design
    if least > 0:
        lower += [least / 2**k for k in range(1, HALVINGS + 1)]
    return lower, [float(p) for p in grid if p > (1 + SAME) * design]


def curve_figures(
    folder: str | Path,
    problem: ShapeProblem,
    printed: PrintedDesign,
    config: ActuatorScene,
    measured: Sequence[Measurement] = (),
) -> dict[str, Any]:
    """Write curve.csv and curve.png and return the entry "curve" of the summary (collective).

    Nothing is done, and nothing returned, if the configuration leaves the curve out.

    Args:
        folder: Output folder, made if missing.
        problem: The design problem.
        printed: The printed pattern.
        config: Largest pressure and number of steps.
        measured: Measured values; those of metrics with the same target are compared.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    if config.results.curve_pressure is None:
        return {}
    if printed.evaluation is None:
        return {"curve": {"failure": printed.failure}}
    begin = time.perf_counter()
    made, whole, folder = printed.evaluation, problem.whole, Path(folder)
    compared = [m for m in measured if any(m.belongs_to(metric) for metric in problem.metrics)]
    further = [m.pressure for m in compared]
    curve = trace_pressure_curve(
        problem, made, config.results.curve_pressure, config.results.curve_steps, further
    )
    parts = 1 if whole is None else len(whole.cell) // len(problem.skin.pattern.panel)
    rows = [
        {
            "pressure_pa": point.result.pressure,
            "volume_m3": parts * point.result.volume,
            "stretch_use": point.result.stretch_use,
            **point.metrics,
        }
        for point in curve.points
    ]
    figures = {
        "lowest_pa": rows[0]["pressure_pa"],
        "highest_pa": rows[-1]["pressure_pa"],
        "points": len(rows),
        "unfilled_at_pa": curve.unfilled_at,
        "failure_below": curve.failure_below,
        "failure_above": curve.failure_above,
        "measured": [
            {
                "metric": m.key,
                "pressure_pa": m.pressure,
                "measured": m.value,
                "simulated": _at(m.pressure, rows, m.key),
                "source": m.source,
            }
            for m in compared
        ],
        "seconds": time.perf_counter() - begin,
    }

    def draw() -> None:
        from toros_fem.results.pictures.curve_plot import plot_metrics_over_pressure

        broken = (curve.failure_below is not None, curve.failure_above is not None)
        plot_metrics_over_pressure(
            folder / "curve.png",
            rows,
            problem.metrics,
            made.equilibrium.pressure,
            compared,
            broken,
        )

    skin = shown_skin(problem, printed.regions)

    def write() -> None:
        write_table(folder / "curve.csv", rows)
        write_path(folder, "pressure", skin, curve.points, whole)
        if_plotting(draw)

    write_together(problem.comm, folder, write)
    return {"curve": figures}


def _at(pressure: float, rows: Sequence[Mapping[str, float]], key: str) -> float | None:
    """Return a metric at the point of a pressure; None if the curve does not reach it."""
    at = [row["pressure_pa"] for row in rows]
    found = np.flatnonzero(np.isclose(at, pressure, rtol=SAME, atol=0))
    return rows[found[0]][key] if len(found) else None
