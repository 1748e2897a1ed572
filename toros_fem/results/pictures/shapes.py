"""Pictures of skins in space: over their target, by their miss, and several states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from toros_fem.base.array_types import Floats
from toros_fem.measures.figures import TOLERANCE, formatted
from toros_fem.measures.figures import Figure as Told
from toros_fem.measures.miss import Miss, miss_of
from toros_fem.results.pictures.raster import Surface
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.stage import Stage
from toros_fem.results.pictures.style import (
    ACCENT,
    DARK,
    EDGE,
    INK,
    LARGE,
    SEQUENTIAL,
    SIZE,
    SOFT,
    page,
    write_title,
)
from toros_fem.results.pictures.view import View

# Left, bottom, width and height of both views and of the numbers, over the page.
SIDE_BOX = (0.01, 0.02, 0.60, 0.87)
OBLIQUE_BOX = (0.63, 0.44, 0.36, 0.46)
NUMBERS_BOX = (0.62, 0.03, 0.375, 0.39)
SCALE_BOX = (0.66, 0.20, 0.30, 0.035)
# Columns of the numbers, and the side that they are aligned at.
COLUMNS = ((0.0, "left"), (0.225, "left"), (0.645, "left"), (1.0, "right"))
# Figures that are told at most.
MOST_FIGURES = 3
# What colours of a miss mean: for all points, and beside the mean of cross-sections.
WHAT_IS_SHOWN = (
    "distance of each point from its target{} in mm",
    "distance of each point{} in mm; the average\nis that of the centres of cross-sections",
)


def _miss(drawn: DrawnSkin, positions: Floats) -> Miss | None:
    """Return how far placed positions, (n, 3), are from the target.

    None without one, and where the design does not compare positions with it.
    """
    target, compared = drawn.skin.target, drawn.skin.compared
    if target is None or not any(compared):
        return None
    return miss_of(drawn.pattern, positions, target, compared)


@dataclass(frozen=True)
class Verdict:
    """Whether a shape is what was asked for.

    Attributes:
        word: In a word.
        colour: Its colour.
        reason: Why it is not certain; empty if it is.
    """

    word: str
    colour: str
    reason: str = ""


def verdict(figures: Sequence[Told], miss: Miss | None) -> Verdict | None:
    """Return whether all targets are reached; None without any.

    Args:
        figures: Figures with a target.
        miss: Distance from the target shape; None without one.
    """
    if not figures and miss is None:
        return None
    if any(figure.value is None for figure in figures):
        return Verdict("No equilibrium", ACCENT)
    shape_missed = miss is not None and not miss.reached
    if shape_missed or any(figure.reached is False for figure in figures):
        return Verdict("Missed", ACCENT)
    if any(figure.interval is None for figure in figures):
        missed = any(figure.misses for figure in figures)
        word, colour = ("Missed", ACCENT) if missed else ("Reached", DARK)
        return Verdict(word, colour, "error by the mesh not estimated")
    if all(figure.reached for figure in figures):
        return Verdict("Reached", DARK)
    return Verdict("Not certain", SOFT, "the error is too large to tell")


def draw_shape(
    figure: Figure,
    drawn: DrawnSkin,
    positions: Floats,
    figures: Sequence[Told],
    warning: str = "",
) -> None:
    """Draw the inflated skin with the dashed outline of its target, and of its miss.

    Args:
        figure: The page.
        drawn: The skin.
        positions: Positions of all vertices, (n, 3), in m.
        figures: The figures to tell, those with a target first.
        warning: What is not as usual, such as that the print has no equilibrium; empty for nothing.
    """
    positions, target = drawn.skin.placed(positions), drawn.skin.target
    side, oblique = drawn.views(positions)
    framed = framed_with(drawn, positions, [] if target is None else [target])
    for box, view in ((SIDE_BOX, side), (OBLIQUE_BOX, oblique)):
        stage = Stage(figure, box, view, framed)
        image = stage.draw(drawn.surfaces(positions))
        if target is not None:
            stage.lines(drawn, positions, image, EDGE)
            stage.outline(drawn, target, 1.6 if view == side else 1.0)
        if view == side:
            stage.bar()
    _tell(figure, figures, _miss(drawn, positions), warning)


def framed_with(drawn: DrawnSkin, positions: Floats, others: Sequence[Floats]) -> Floats:
    """Return all points that a view must hold: of the skin, of others, and of bodies, (m, 3)."""
    body = [] if drawn.skin.body is None else [drawn.skin.body[0]]
    return np.concatenate([positions, *others, *body])


def _tell(figure: Figure, figures: Sequence[Told], miss: Miss | None, warning: str) -> None:
    """Write the verdict and a table of what was reached, asked for and missed."""
    axes = figure.add_axes(NUMBERS_BOX)
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    asked = [told for told in figures if told.target is not None]
    found = verdict(asked, miss)
    top = 0.98
    if found is not None:
        axes.text(
            0, top, found.word, color=found.colour, fontsize=LARGE, fontweight="bold", va="top"
        )
        top -= 0.24
        if found.reason:
            axes.text(0, top, found.reason, color=SOFT, va="top")
        top -= 0.15
    heads = ("", "as printed", "target" if asked else "", "miss" if asked else "")
    for (x, side), head in zip(COLUMNS, heads, strict=True):
        axes.text(x, top, head, color=SOFT, fontsize=8, va="top", ha=side)
    rows = [_row(told) for told in figures[:MOST_FIGURES]]
    if miss is not None:
        rows.append(
            _Row(
                "shape",
                f"{1e3 * miss.rms:.2g} mm, {100 * miss.rms / miss.length:.1f} %",
                f"≤ {100 * TOLERANCE:.0f} %",
                "" if miss.reached else f"+{100 * (miss.rms / miss.length - TOLERANCE):.1f} %",
                not miss.reached,
            )
        )
    for row in rows:
        top -= 0.13
        cells = (row.name, row.value, row.target, row.miss)
        for (x, side), cell in zip(COLUMNS, cells, strict=True):
            loud = row.is_off and cell is row.miss
            axes.text(x, top, cell, color=ACCENT if loud else INK, va="top", ha=side,
                      fontweight="bold" if loud or cell is row.value else "normal")  # fmt: skip
    if warning:
        axes.text(0, top - 0.15, warning, color=ACCENT, va="top", fontsize=8, wrap=True)


class _Row(NamedTuple):
    """A row of the numbers beside a shape."""

    name: str
    value: str
    target: str = ""
    miss: str = ""
    is_off: bool = False


def _row(told: Told) -> _Row:
    name = told.name.replace("_", " ")
    if told.miss is None:
        return _Row(name, told.shown)
    miss = formatted(told.miss, told.unit, 2, sign=True)
    return _Row(name, told.shown, formatted(told.target, told.unit), miss, told.misses)


def draw_miss(figure: Figure, drawn: DrawnSkin, positions: Floats) -> None:
    """Draw the inflated skin, coloured by its distance from the target.

    Args:
        figure: The page.
        drawn: The skin, with a target.
        positions: Positions of all vertices, (n, 3), in m.
    """
    positions, target = drawn.skin.placed(positions), drawn.skin.target
    miss = _miss(drawn, positions)
    assert miss is not None
    assert target is not None
    most = max(float(miss.each.max()), 1e-6)
    colours = matplotlib.colormaps[SEQUENTIAL](miss.each / most)[:, :3][drawn.pattern.triangles]
    side, oblique = drawn.views(positions)
    write_title(
        figure,
        f"{1e3 * miss.rms:.2g} mm from the target on average, "
        f"{100 * miss.rms / miss.length:.1f} % of the length",
    )
    for box, view in ((SIDE_BOX, side), (OBLIQUE_BOX, oblique)):
        stage = Stage(figure, box, view, framed_with(drawn, positions, [target]))
        stage.draw(drawn.surfaces(positions, colours))
        stage.outline(drawn, target)
        if view == side:
            stage.bar()
    scale = ScalarMappable(Normalize(0, 1e3 * most), SEQUENTIAL)
    bar = figure.colorbar(scale, cax=figure.add_axes(SCALE_BOX), orientation="horizontal")
    axes_named = " and ".join(np.array(list("xyz"))[list(drawn.skin.compared)])
    along = "" if all(drawn.skin.compared) else f" along {axes_named}"
    bar.set_label(WHAT_IS_SHOWN[miss.by_sections].format(along))


def plot_states(
    path: Path,
    rows: Sequence[Sequence[tuple[str, Sequence[Surface]]]],
    view: View,
    title: str = "",
    ground: float | None = None,
    facts: Mapping[str, str] | None = None,
) -> None:
    """Write a picture of states beside and below one another, in the same scale.

    Args:
        path: PNG file to write.
        rows: For each state its name and surfaces, in rows of equal length.
        view: Where the viewer is.
        title: A sentence with the result.
        ground: Height of the ground in m; None for none.
        facts: As of `page`.
    """
    every = np.concatenate([s.points for row in rows for _, surfaces in row for s in surfaces])
    across, down = max(map(len, rows)), len(rows)
    extent = np.ptp(view.project(every), axis=0)
    # As high as the states need, between a strip and a square.
    height = float(np.clip(SIZE[0] / across * extent[1] / extent[0] * down + 0.8, 2.2, 8.0))
    top = 1 - (0.45 if title else 0.08) / height
    with page(path, title, (SIZE[0], height), facts) as figure:
        for j, row in enumerate(rows):
            for i, (name, surfaces) in enumerate(row):
                box = (i / across, top - (j + 1) * top / down, 1 / across, top / down)
                stage = Stage(figure, box, view, every, (0.0, 0.0, 0.0, 0.08))
                if ground is not None:
                    stage.ground(ground, every)
                stage.draw(surfaces)
                stage.axes.annotate(name, (0.5, 1.0), (0, -4), xycoords="axes fraction",
                                    textcoords="offset points", ha="center", va="top",
                                    fontsize=8, color=SOFT)  # fmt: skip
                if i == 0 and j == down - 1:
                    stage.bar()
