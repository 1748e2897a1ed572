"""Pictures of numbers: over the iterations, over the pressure, and the paths of feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.options import Iteration
from toros_fem.measures.metrics import Measurement, Metric
from toros_fem.results.pictures.drawing import DPI, PRINTED

# Colour of measured values.
MEASURED = np.array([0.80, 0.33, 0.10])


def plot_convergence(path: Path, history: Sequence[Iteration], metrics: Sequence[Metric]) -> None:
    """Write a picture of objective, metrics with a target and grey level over the iterations.

    A line marks where the next mesh begins.

    Args:
        path: PNG file to write.
        history: Rows of the design loop.
        metrics: Numbers that the design is judged by.
    """
    count = [row.iteration for row in history]
    targets = [(metric, metric.target) for metric in metrics if metric.target is not None]
    rows = 2 + len(targets)
    figure, (top, *middle, bottom) = plt.subplots(
        rows, 1, figsize=(8, 2 + 2 * rows), sharex=True, layout="constrained"
    )
    top.semilogy(count, [row.objective for row in history], color=PRINTED)
    top.set_ylabel("objective T")
    for axis, (metric, target) in zip(middle, targets, strict=True):
        axis.plot(count, [row.metrics[metric.key] for row in history], color=PRINTED)
        axis.axhline(target, color="0.6", linestyle="--", label="target")
        axis.set_ylabel(metric.label)
        axis.legend(frameon=False)
    bottom.plot(count, [row.volume_fraction for row in history], label="volume fraction")
    bottom.plot(count, [row.grey_level for row in history], label="grey level")
    bottom.set_ylim(0, 1)
    bottom.legend(frameon=False)
    bottom.set_xlabel("iteration")
    bottom.xaxis.get_major_locator().set_params(integer=True)
    meshes = [b.iteration for a, b in pairwise(history) if b.level != a.level]
    for axis in (top, *middle, bottom):
        axis.grid(alpha=0.3)
        for begin in meshes:
            axis.axvline(begin, color="0.3", linestyle=":")
    for begin in meshes:
        top.annotate(
            "finer mesh",
            (begin, 1),
            (3, -12),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            fontsize=8,
        )
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_pressure_path(
    path: Path, rows: Sequence[Mapping[str, float]], metrics: Sequence[Metric]
) -> None:
    """Write a picture of metrics over the pressure.

    Args:
        path: PNG file to write.
        rows: Values by key, "pressure_pa" among them.
        metrics: Metrics to draw.
    """
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    pressure = [1e-3 * row["pressure_pa"] for row in rows]
    for metric in metrics:
        axes.plot(pressure, [row[metric.key] for row in rows], ".-", label=metric.label)
    axes.set_xlabel("pressure in kPa")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_metrics_over_pressure(
    path: Path,
    rows: Sequence[Mapping[str, float]],
    metrics: Sequence[Metric],
    pressure: float,
    measured: Sequence[Measurement] = (),
    broken: tuple[bool, bool] = (False, False),
) -> None:
    """Write a picture of each metric with a target over the pressure, below one another.

    Args:
        path: PNG file to write.
        rows: Values by key, "pressure_pa" among them, by rising pressure.
        metrics: Metrics; without any target among them all are drawn.
        pressure: Pressure of the design in Pa.
        measured: Measured values, drawn as points.
        broken: Whether the curve ends for want of an equilibrium, at its lower and upper end.
    """
    shown = [metric for metric in metrics if metric.target is not None] or list(metrics)
    figure, grid = plt.subplots(
        len(shown),
        1,
        figsize=(7.5, 1 + 3 * len(shown)),
        sharex=True,
        squeeze=False,
        layout="constrained",
    )
    at = [1e-3 * row["pressure_pa"] for row in rows]
    ends = [k for k, is_broken in zip((0, -1), broken, strict=True) if is_broken]
    for axes, metric in zip(grid[:, 0], shown, strict=True):
        values = [row[metric.key] for row in rows]
        axes.plot(at, values, ".-", color=PRINTED, label="as printed")
        if metric.target is not None:
            axes.axhline(metric.target, color="0.5", linestyle="--", label="target")
        axes.axvline(1e-3 * pressure, color="0.5", linestyle=":", label="pressure of the design")
        for one in (m for m in measured if m.key == metric.key):
            axes.plot(1e-3 * one.pressure, one.value, "D", color=MEASURED, ms=7, label=one.source)
        if ends:
            axes.plot(
                [at[k] for k in ends],
                [values[k] for k in ends],
                "x",
                color=MEASURED,
                ms=10,
                mew=2,
                label="no equilibrium beyond",
            )
        axes.set_ylabel(metric.label)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    grid[-1, 0].set_xlabel("pressure in kPa")
    grid[-1, 0].set_xlim(left=0)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_tracks(
    path: Path,
    feet: Floats,
    every: int,
    stride: float | None = None,
    measured: tuple[str, float] | None = None,
) -> None:
    """Write a picture of the paths of feet in the x-z plane, in mm.

    Args:
        path: PNG file to write.
        feet: Positions, (rows, feet, 3), in m.
        every: Number of rows between two marks, which show the phases of the gait.
        stride: Distance along x of a cycle in m, drawn true to scale below the paths; None for
            none.
        measured: The same for a measured stride, after who measured it.
    """
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    for k in range(feet.shape[1]):
        x, z = 1e3 * feet[:, k, 0], 1e3 * feet[:, k, 2]
        (line,) = axes.plot(x, z, label=f"foot {k}")
        axes.plot(x[::every], z[::every], "o", ms=4, color=line.get_color())
        axes.plot(x[0], z[0], "s", ms=9, mfc="none", color=line.get_color())
    axes.plot([], [], "s", ms=9, mfc="none", color="0.3", label="start")
    bars = [] if stride is None else [("simulated cycle", stride, PRINTED)]
    bars += [] if measured is None else [(*measured, MEASURED)]
    low, high = axes.get_ylim()
    begin = 1e3 * float(feet[:, :, 0].mean())
    for k, (name, length, colour) in enumerate(bars):
        height, end = low - (0.14 + 0.16 * k) * (high - low), begin + 1e3 * length
        axes.plot(
            (begin, end),
            (height, height),
            "|-",
            color=colour,
            lw=3,
            ms=10,
            solid_capstyle="butt",
        )
        axes.annotate(
            f"{name}: {1e3 * length:.3g} mm",
            (min(begin, end), height),
            (0, 8),
            textcoords="offset points",
            fontsize=9,
        )
    axes.set_xlabel("x in mm")
    axes.set_ylabel("height in mm")
    axes.grid(alpha=0.3)
    figure.legend(frameon=False, ncols=feet.shape[1] + 1, loc="outside lower center")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
