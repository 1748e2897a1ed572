"""Results of actuators in one sentence, from their summaries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from toros_fem.measures.metrics import UNITS


def summary_sentence(summary: Mapping[str, Any]) -> str:
    """Return the result of a design in one sentence, from its summary."""
    # Where a relaxed design is laid as lines, no design by densities stands beside the print.
    laid = "lines" in summary and not summary["densities_kept"]
    metrics = []
    for key in (key for key in summary if "_target_" in key):
        name, unit = key.split("_target_")
        word, _ = UNITS.get(unit, (unit, ""))
        value, error = (summary.get(f"{name}_{kind}{unit}") for kind in ("", "error_"))
        digits = 3 if unit == "ratio" else 1
        printed = "no equilibrium" if value is None else f"{value:.{digits}f}"
        if error is not None:
            printed += f" ± {error:.{digits}f}"
        designed = f"{summary['design'][f'{name}_{unit}']:.{digits}f}"
        beside = "" if laid else f" ({designed} as designed)"
        metrics.append(f"{name} {printed} of {summary[key]:g} {word} as printed{beside}")
    if "length_ratio" in summary and "length_target_ratio" not in summary:
        length = summary["length_ratio"]
        if length is not None:
            metrics.append(f"length {length:.3f} times the rest value")
    first, last = summary["objective_first"], summary["objective_last"]
    metrics.extend(
        f"nothing to compare with on a {mesh} mesh, so that its error is unknown"
        for mesh in ("refined", "coarser")
        if mesh in summary
    )
    steps = f"objective down {first / last:.0f} times" if last > 0 else f"objective {last:g}"
    if laid:
        rounds = summary["lines"]["rounds"]
        steps = f"lines laid {len(rounds)} times"
    return (
        f"{', '.join(metrics)} at {summary['pressure_pa'] / 1e3:.2f} kPa, {steps}, "
        f"{summary['manufacture']['islands']} islands, {summary['seconds']['total']:.0f} s"
    )


def simulation_sentence(summary: Mapping[str, Any]) -> str:
    """Return the result of a simulation in one sentence, from its summary."""
    found = []
    for key, value in summary.items():
        name, _, unit = key.rpartition("_")
        if unit not in UNITS or name.endswith(("_refined", "_error")):
            continue
        error = summary.get(f"{name}_error_{unit}")
        digits = 3 if unit == "ratio" else 1
        shown = f"{name} {value:.{digits}f}"
        found.append(shown + ("" if error is None else f" ± {error:.{digits}f}"))
        found[-1] += f" {UNITS[unit][0]}"
    what = "plain skin" if summary["pattern"] is None else "as printed"
    ended = "" if summary["failure"] is None else f"; it ends there: {summary['failure']}"
    return f"{', '.join(found)} at {summary['pressure_pa'] / 1e3:.2f} kPa, {what}{ended}"
