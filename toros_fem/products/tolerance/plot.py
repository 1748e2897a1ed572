"""Picture of tolerances: what moves each metric, by what moves the first one most."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

from toros_fem.products.tolerance.result import Tolerances, Variant
from toros_fem.results.pictures.drawing import DPI, PRINTED

LESS, MORE, FIRST_ORDER = "#7fa6c9", PRINTED, "#cc5519"


def plot_tolerances(path: Path, found: Tolerances) -> None:
    """Write a picture of how each metric moves, a bar for each variant.

    Args:
        path: PNG file to write.
        found: The variants.
    """
    columns = len(found.metrics)
    bars = len({(v.quantity, abs(v.change)) for v in found.variants})
    figure, grid = plt.subplots(
        1,
        columns,
        figsize=(2.5 + 4.5 * columns, 1.6 + 0.38 * bars),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    pairs: dict[tuple[str, float], list[Variant]] = {}
    for variant in found.variants:
        pairs.setdefault((variant.quantity, abs(variant.change)), []).append(variant)
    first = found.metrics[0].key

    def spread(pair: list[Variant]) -> float:
        return max(abs(found.change(v, first) or 0.0) for v in pair)

    ordered = sorted(pairs.values(), key=spread)
    for axes, metric in zip(grid[0], found.metrics, strict=True):
        key, nominal = metric.key, found.nominal[metric.key]
        for row, pair in enumerate(ordered):
            for variant in pair:
                colour = LESS if variant.change < 0 else MORE
                change = found.change(variant, key)
                if change is None:
                    axes.plot(nominal, row, "x", color=FIRST_ORDER, ms=9, mew=2)
                else:
                    axes.barh(row, change, left=nominal, height=0.62, color=colour)
                axes.plot(variant.predicted[key], row, "|", color=FIRST_ORDER, ms=13, mew=2)
        axes.axvline(nominal, color="0.2", lw=0.8)
        if metric.target is not None:
            axes.axvline(metric.target, color="0.5", linestyle="--", lw=1)
        axes.set_xlabel(metric.label)
        axes.grid(axis="x", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    names = [f"{pair[0].quantity} ± {pair[0].amount}" for pair in ordered]
    grid[0, 0].set_yticks(range(len(ordered)), names)
    handles = [
        plt.Rectangle((0, 0), 1, 1, color=LESS),
        plt.Rectangle((0, 0), 1, 1, color=MORE),
        plt.Line2D([], [], color=FIRST_ORDER, marker="|", ls="", ms=13, mew=2),
    ]
    labels = ["less than drawn", "more than drawn", "first order"]
    if any(m.target is not None for m in found.metrics):
        handles.append(plt.Line2D([], [], color="0.5", ls="--", lw=1))
        labels.append("target")
    if any(not v.values for v in found.variants):
        handles.append(plt.Line2D([], [], color=FIRST_ORDER, marker="x", ls="", ms=9, mew=2))
        labels.append("no equilibrium")
    figure.legend(handles, labels, frameon=False, ncols=len(labels), loc="outside lower center")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
