"""The summary of a design: all figures of summary.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table
from toros_fem.base.scene import Scene
from toros_fem.base.validation import require_kind
from toros_fem.base.versions import versions
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign


def shape_problem(result: DesignResult) -> ShapeProblem:
    """Return the problem of a result, which must be the design of a shape.

    Raises:
        ParameterError: It is the design of something else.
    """
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    if not isinstance(result.problem, ShapeProblem):
        raise ParameterError(
            f"the result is that of a {type(result.problem).__name__}; only the design of a shape "
            "has these files. For a tile use toros_fem.products.tiles."
        )
    return result.problem


def level_figures(history: Sequence[Iteration]) -> list[dict[str, float]]:
    """Return steps, cost and last objective on each mesh, the coarsest first."""
    figures = []
    for level in sorted({row.level for row in history}):
        rows = [row for row in history if row.level == level]
        figures.append(
            {
                "iterations": rows[-1].iteration - rows[0].iteration,
                "objective_first": rows[0].objective,
                "objective_last": rows[-1].objective,
                "rejected": sum(row.rejected for row in rows),
                "newton_steps": sum(row.newton_steps for row in rows),
                "factorisations": sum(row.factorisations for row in rows),
                "seconds": sum(row.seconds for row in rows),
            }
        )
    return figures


def design_summary(
    result: DesignResult,
    printed: PrintedDesign,
    *,
    config: Scene | Table | None = None,
    figures: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Return the summary of the design of a shape, equal on all ranks (collective).

    Metrics, volume and shape are those of the printed pattern, simulated again; None if it has no
    equilibrium. The figures of the design itself, with its grey borders, are under "design".

    Args:
        result: Result of the design loop.
        printed: The printed pattern, by `as_printed`.
        config: Configuration of the run, for "inputs".
        figures: Further entries.
        seconds: Further wall times in s, those of `DesignReporter.seconds` for instance.

    Raises:
        ParameterError: The result is not the design of a shape.
    """
    problem = shape_problem(result)
    skin, final, simulated = problem.skin, result.final, printed.evaluation
    first, last = result.history[0], result.history[-1]
    limits, widths = problem.length_scale, final.length_scale
    parts = len(printed.pattern.panel) // len(skin.pattern.panel)
    metrics: dict[str, float | None] = {metric.key: None for metric in problem.metrics}
    if simulated is not None:
        metrics.update(problem.metrics_of(simulated.equilibrium))
    summary = {
        **metrics,
        **{f"{m.name}_target_{m.unit}": m.target for m in problem.metrics if m.target is not None},
        **(figures or {}),
        "pressure_pa": final.equilibrium.pressure,
        "pressures_pa": list(final.equilibrium.pressures),
        "volume_m3": simulated and parts * simulated.equilibrium.volume,
        "stretch_use": simulated and simulated.equilibrium.stretch_use,
        "equilibrium": simulated and simulated.equilibrium.reason,
        "printed_objective": simulated and simulated.shape,
        "printed_failure": printed.failure or None,
        "objective_first": first.objective,
        "objective_last": last.objective,
        "design": {
            **last.metrics,
            "shape": last.shape,
            "perimeter_m": final.perimeter and parts * final.perimeter,
            "volume_m3": parts * final.equilibrium.volume,
            "kkt_residual": last.kkt if np.isfinite(last.kkt) else None,
        },
        "gradient_norm_first": first.gradient_norm,
        "gradient_norm_last": last.gradient_norm,
        "volume_fraction": last.volume_fraction,
        "grey_level": last.grey_level,
        "length_scale": None if limits is None or widths is None else limits.summary(widths),
        "manufacture": printed.after.summary(),
        "dropped": {
            "islands": len(printed.cleaned.dropped),
            "islands_mm2": 1e6 * sum(piece.area for piece in printed.cleaned.dropped),
            "islands_bridged": len(printed.cleaned.bridged),
            "holes_filled": len(printed.cleaned.filled),
            "before": printed.before.summary(),
        },
        "iterations": last.iteration,
        "levels": level_figures(result.history),
        "rejected": sum(row.rejected for row in result.history),
        "newton_steps": sum(row.newton_steps for row in result.history),
        "factorisations": sum(row.factorisations for row in result.history),
        "triangles": len(skin.pattern.panel),
        "vertices": len(skin.pattern.points),
        "parts_by_symmetry": parts,
        "ranks": skin.comm.size,
        "linear_solver": problem.solver.linear_solver,
        "reason": result.reason,
        "seconds": {**result.seconds, **(seconds or {})},
        "versions": versions(),
        "inputs": None if config is None else config.as_dict(),
    }
    # Each rank has its own clock: the first one's counts.
    return dict(skin.comm.bcast(summary, root=0))
