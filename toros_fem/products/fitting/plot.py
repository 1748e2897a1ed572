"""Picture of a fit: stress and lateral stretch beside the data, and the residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toros_fem.products.fitting.result import Fit
from toros_fem.results.pictures.drawing import DPI

COLOURS = ("#1f3a63", "#c8571b", "#4b8b57", "#8a4f9e")


def plot_fit(path: Path, result: Fit) -> None:
    """Write a picture of the fit.

    Args:
        path: PNG file to write.
        result: The fit.
    """
    samples = result.samples
    columns = 1 if result.r2_lateral is None else 2
    figure, axes = plt.subplots(
        2, columns, figsize=(1 + 5 * columns, 6.5), sharex=True, squeeze=False,
        height_ratios=[2.4, 1], layout="constrained",
    )  # fmt: skip
    shown = [(samples.stress, result.stress, "stress in N/m", result.r2_stress)]
    if result.r2_lateral is not None:
        shown.append((samples.lateral, result.lateral, "lateral stretch", result.r2_lateral))
    for column, (measured, fitted, label, r2) in enumerate(shown):
        top, bottom = axes[:, column]
        for number, name in enumerate(dict.fromkeys(samples.direction)):
            tests = [k for k, one in enumerate(samples.direction) if one == name]
            rows = np.flatnonzero(np.isin(samples.test, tests))
            rows = rows[np.argsort(samples.strain[rows], kind="stable")]
            stretch, colour = 1 + samples.strain[rows], COLOURS[number % len(COLOURS)]
            words = f"{name}, " if name else ""
            count = f"{len(tests)} test" + ("s" if len(tests) > 1 else "")
            top.plot(
                stretch, measured[rows], ".", ms=4, color=colour, alpha=0.5,
                label=f"{words}measured ({count})",
            )  # fmt: skip
            top.plot(stretch, fitted[rows], color=colour, lw=1.8, label=f"{words}eq. (1)")
            bottom.plot(stretch, (measured - fitted)[rows], ".", ms=4, color=colour, alpha=0.5)
        bottom.axhline(0.0, color="0.5", lw=0.8)
        top.set_ylabel(label)
        bottom.set_ylabel("measured − fitted")
        bottom.set_xlabel("stretch")
        top.set_title(f"{label.partition(' in ')[0]}, R² = {r2:.4f}")
        for axis in (top, bottom):
            axis.grid(alpha=0.3)
            _mark(axis, result)
        top.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _mark(axis: Any, result: Fit) -> None:
    """Shade the stretches beyond which the fit is not to be trusted."""
    if result.trusted_to < result.measured_to:
        axis.axvspan(result.trusted_to, result.measured_to, color="0.85", zorder=0)
