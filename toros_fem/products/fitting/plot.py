"""Picture of a fit: stress and lateral stretch beside the data, and the residuals."""

from __future__ import annotations

from pathlib import Path

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
    shown = [("stress in N/m", samples.stress, result.stress, result.r2_stress)]
    if result.r2_lateral is not None:
        shown.append(("lateral stretch", samples.lateral, result.lateral, result.r2_lateral))
    figure, axes = plt.subplots(
        2, len(shown), figsize=(1 + 5 * len(shown), 6.5), sharex=True, squeeze=False,
        height_ratios=[2.4, 1], layout="constrained",
    )  # fmt: skip
    for (top, bottom), (label, measured, fitted, r2) in zip(axes.T, shown, strict=True):
        for number, name in enumerate(dict.fromkeys(samples.direction)):
            rows = np.flatnonzero(samples.along(name))
            rows = rows[np.argsort(samples.strain[rows], kind="stable")]
            stretch, colour = 1 + samples.strain[rows], COLOURS[number % len(COLOURS)]
            tests, words = samples.direction.count(name), f"{name}, " if name else ""
            count = f"{words}measured ({tests} test{'s' if tests > 1 else ''})"
            dots = {"ls": "", "marker": ".", "ms": 4, "color": colour, "alpha": 0.5}
            top.plot(stretch, measured[rows], label=count, **dots)
            top.plot(stretch, fitted[rows], color=colour, lw=1.8, label=f"{words}eq. (1)")
            bottom.plot(stretch, (measured - fitted)[rows], **dots)
        bottom.axhline(0.0, color="0.5", lw=0.8)
        bottom.set(xlabel="stretch", ylabel="measured − fitted")
        top.set(ylabel=label, title=f"{label.partition(' in ')[0]}, R² = {r2:.4f}")
        top.legend(frameon=False, fontsize=8)
        for axis in (top, bottom):
            axis.grid(alpha=0.3)
            if result.trusted_to < result.measured_to:  # the fit is not to be trusted there
                axis.axvspan(result.trusted_to, result.measured_to, color="0.85", zorder=0)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
