"""Figures of a study over the values that vary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from toros_fem.measures.figures import Figure, Unit, split_key, unit_of
from toros_fem.results.pictures.style import INK, SERIES, SOFT, page, write_title
from toros_fem.results.runs.stored_run import Summary

# Charts at most, and curves with labels of their own.
MOST, CURVES = 4, 8
COLOURS = (*SERIES, SOFT)


def draw_study(
    path: Path,
    rows: Sequence[Mapping[str, Any]],
    columns: Sequence[str],
    summaries: Sequence[Summary],
) -> None:
    """Draw each figure over the first value that varies, a curve for each of the others.

    Rows are those of the study's table, columns those of the values that vary.
    """
    figures = shown_figures(summaries)
    if not figures:
        return
    with page(path, size=(8.0, 1.2 + 2.2 * len(figures))) as canvas:
        write_title(canvas, f"{len(summaries)} runs over {' and '.join(map(_named, columns))}")
        charts = canvas.subplots(
            len(figures), 1, sharex=True, squeeze=False,
            gridspec_kw={"left": 0.1, "right": 0.78, "bottom": 0.16 / len(figures) + 0.03,
                         "top": 0.98 - 0.12 / len(figures), "hspace": 0.18},
        )[:, 0]  # fmt: skip
        for axes, figure in zip(charts, figures, strict=True):
            targets = {s.figures[figure.key].target for s in summaries if figure.key in s.figures}
            # One line stands for the targets of all runs, or none is drawn.
            shown = figure if len(targets) == 1 else replace(figure, target=None)
            _draw(axes, rows, columns, shown)
        charts[-1].set_xlabel(_named(columns[0]))
        if len(columns) > 1:
            charts[0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)


def shown_figures(summaries: Sequence[Summary]) -> list[Figure]:
    """Return the figures that decide, or else those whose error is known, or else all."""
    every = {key: one for summary in summaries for key, one in summary.figures.items()}.values()
    asked = [one for one in every if one.target is not None]
    known = [one for one in every if one.interval is not None]
    return (asked or known or list(every))[:MOST]


def _draw(
    axes: Axes, rows: Sequence[Mapping[str, Any]], columns: Sequence[str], figure: Figure
) -> None:
    factor, sign = unit_of(figure.unit).factor, unit_of(figure.unit).sign
    curves: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row.get(figure.key) is not None:
            curves.setdefault(tuple(row[one] for one in columns[1:]), []).append(row)
    places = _places(columns[0], [row[columns[0]] for row in rows])
    for number, (others, own) in enumerate(curves.items()):
        x = np.array([places[row[columns[0]]] for row in own])
        y, error = (
            factor * np.array([row.get(key) or 0.0 for row in own], dtype=float)
            for key in (figure.key, f"{figure.name}_error_{figure.unit}")
        )
        words = ", ".join(
            f"{_named(one, value)}" for one, value in zip(columns[1:], others, strict=True)
        )
        label = words if number < CURVES else None
        colour = COLOURS[number % len(COLOURS)]
        order = np.argsort(x)
        axes.errorbar(
            x[order], y[order], error[order], color=colour, label=label, marker="o",
            markersize=4, linewidth=1.2, capsize=2,
        )  # fmt: skip
    if figure.target is not None:
        axes.axhline(factor * figure.target, color=INK, linestyle="--", linewidth=0.8)
    axes.set_ylabel(f"{figure.label} ({sign.strip() or '1'})")
    if any(isinstance(value, str) for value in places):
        axes.set_xticks(list(places.values()), [str(value) for value in places])
    axes.grid(axis="y")


def _places(column: str, values: Sequence[Any]) -> dict[Any, float]:
    """Return where values stand on an axis: numbers where they are, words side by side."""
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in values)
    factor = _unit(column).factor
    words = dict.fromkeys(values)
    return {one: factor * float(one) if numbers else float(k) for k, one in enumerate(words)}


def _named(column: str, value: Any = None) -> str:
    """Return a column in words, with a value if one is given."""
    name, _ = split_key(column) or (column, "")
    words, unit = name.replace("_", " "), _unit(column)
    if value is None:
        return f"{words} ({unit.sign.strip()})" if unit.sign else words
    text = f"{unit.factor * value:.4g}{unit.sign}" if isinstance(value, float) else f"{value}"
    return f"{words} {text}"


def _unit(column: str) -> Unit:
    found = split_key(column)
    return Unit("", "") if found is None else unit_of(found[1])
