"""Files of tolerances: figures, table, and a picture of what moves each metric."""

from __future__ import annotations

import math
from itertools import groupby
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting, write_json, write_table
from toros_fem.products.tolerance.result import Tolerances, Variant

FILES = ("tolerance.json", "tolerance.csv", "tolerance.png")
LESS = "#7FA6C9"


def write_tolerances(comm: MPI.Comm, folder: Path | str, found: Tolerances) -> None:
    """Write tolerance.json, tolerance.csv and tolerance.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / FILES[0], found.summary())
        write_table(folder / FILES[1], found.rows())
        if_plotting(lambda: plot_tolerances(folder / FILES[2], found))

    guarded(comm, folder, write)


def by_size(found: Tolerances) -> list[list[Variant]]:
    """Return the variants of each quantity and amount, those that move the first metric most last.

    A variant without an equilibrium counts as the largest.
    """

    def what(variant: Variant) -> tuple[str, str]:
        return variant.quantity, variant.amount

    def size(pair: list[Variant]) -> float:
        changes = [found.change(v, found.metrics[0].key) for v in pair]
        return max(math.inf if change is None else abs(change) for change in changes)

    pairs = [list(pair) for _, pair in groupby(sorted(found.variants, key=what), what)]
    return sorted(pairs, key=size)


def plot_tolerances(path: Path, found: Tolerances) -> None:
    """Write a picture of how each metric moves, a bar for each variant (one rank)."""
    from toros_fem.results.pictures.style import ACCENT, DARK, INK, note, page

    pairs = by_size(found)
    bars = [(k, v) for k, pair in enumerate(pairs) for v in pair]
    height = 1.9 + 0.34 * len(pairs)
    where = {"left": 0.24, "right": 0.97, "bottom": 0.75 / height, "top": 1 - 0.85 / height}
    title = next(iter(found.worst_sentences), "What a skin does that is not made as drawn")
    with page(path, title.rstrip("."), (8.0, height)) as figure:
        grid = figure.subplots(
            1, len(found.metrics), sharey=True, squeeze=False, gridspec_kw={**where, "wspace": 0.1}
        )
        for axes, metric in zip(grid[0], found.metrics, strict=True):
            key, nominal = metric.key, found.nominal[metric.key]
            for row, variant in bars:
                change = found.change(variant, key)
                if change is None:
                    axes.plot(nominal, row, color=ACCENT, marker="x", ls="", ms=9, mew=2)
                else:
                    colour = LESS if variant.change < 0 else DARK
                    axes.barh(row, change, left=nominal, height=0.62, color=colour)
            axes.axvline(nominal, color=INK, lw=0.8)
            if metric.target is not None:
                axes.axvline(metric.target, color=ACCENT, linestyle="--", lw=1)
                above = ("data", "axes fraction")
                note(axes, "target", (metric.target, 1), (3, 2), ACCENT, xycoords=above)
            axes.set_xlabel(metric.label)
            axes.grid(axis="x")
        names = [f"{pair[0].quantity} ± {pair[0].amount}" for pair in pairs]
        grid[0, 0].set_yticks(range(len(pairs)), names)
        words = [("■ less than drawn", LESS), ("■ more than drawn", DARK)]
        if any(not variant.values for variant in found.variants):
            words.append(("× no equilibrium", ACCENT))
        for k, (text, colour) in enumerate(words):
            figure.text(0.02 + 0.22 * k, 1 - 0.52 / height, text, color=colour)
