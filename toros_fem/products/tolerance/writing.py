"""Files of tolerances: figures, table, and a picture of what moves each metric."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.files import draw_into, guarded, write_json, write_table
from toros_fem.products.tolerance.result import Tolerances, Variant

FILES = ("tolerance.json", "tolerance.csv", "tolerance.png")
LESS, FIRST_ORDER = "#7fa6c9", "#cc5519"
TICK = {"color": FIRST_ORDER, "marker": "|", "ls": "", "ms": 13, "mew": 2}
CROSS = {**TICK, "marker": "x", "ms": 9}


def write_tolerances(comm: MPI.Comm, folder: Path | str, found: Tolerances) -> None:
    """Write tolerance.json, tolerance.csv and tolerance.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / FILES[0], found.summary())
        write_table(folder / FILES[1], found.rows())
        draw_into(folder, lambda place: plot_tolerances(place / FILES[2], found))

    guarded(comm, folder, write)


def plot_tolerances(path: Path, found: Tolerances) -> None:
    """Write a picture of how each metric moves, a bar for each variant (one rank)."""
    import matplotlib.pyplot as plt

    from toros_fem.results.pictures.drawing import DPI, PRINTED

    def what(variant: Variant) -> tuple[str, str]:
        return variant.quantity, variant.amount

    def spread(pair: list[Variant]) -> float:
        return max(abs(found.change(v, found.metrics[0].key) or 0.0) for v in pair)

    pairs = [list(pair) for _, pair in groupby(sorted(found.variants, key=what), what)]
    pairs.sort(key=spread)
    columns, bars = len(found.metrics), [(k, v) for k, pair in enumerate(pairs) for v in pair]
    size = (2.5 + 4.5 * columns, 1.6 + 0.38 * len(pairs))
    options: dict[str, Any] = {"sharey": True, "squeeze": False, "layout": "constrained"}
    figure, grid = plt.subplots(1, columns, figsize=size, **options)
    for axes, metric in zip(grid[0], found.metrics, strict=True):
        key, nominal = metric.key, found.nominal[metric.key]
        for row, variant in bars:
            change = found.change(variant, key)
            if change is None:
                axes.plot(nominal, row, **CROSS)
            else:
                colour = LESS if variant.change < 0 else PRINTED
                axes.barh(row, change, left=nominal, height=0.62, color=colour)
            axes.plot(variant.predicted[key], row, **TICK)
        axes.axvline(nominal, color="0.2", lw=0.8)
        if metric.target is not None:
            axes.axvline(metric.target, color="0.5", linestyle="--", lw=1)
        axes.set_xlabel(metric.label)
        axes.grid(axis="x", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    grid[0, 0].set_yticks(range(len(pairs)), [" ± ".join(what(pair[0])) for pair in pairs])
    handles = {
        "less than drawn": plt.Rectangle((0, 0), 1, 1, color=LESS),
        "more than drawn": plt.Rectangle((0, 0), 1, 1, color=PRINTED),
        "first order": plt.Line2D([], [], **TICK),
    }
    if any(m.target is not None for m in found.metrics):
        handles["target"] = plt.Line2D([], [], color="0.5", ls="--", lw=1)
    if any(not v.values for v in found.variants):
        handles["no equilibrium"] = plt.Line2D([], [], **CROSS)
    below: dict[str, Any] = {"frameon": False, "ncols": len(handles), "loc": "outside lower center"}
    figure.legend(handles.values(), handles.keys(), **below)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
