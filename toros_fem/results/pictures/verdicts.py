"""What is written beside a shape: whether it is what was asked for, and each of its figures."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from toros_fem.measures.figures import Figure as Told
from toros_fem.measures.figures import State, overall, worst_of
from toros_fem.measures.miss import DIRECTION, DISTANCE, Miss, is_of_shape, shape_figures
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.pictures.style import ACCENT, DARK, EDGE, INK, SOFT, TEXT

COLOURS = {State.REACHED: DARK, State.MISSED: ACCENT, State.NOT_CERTAIN: SOFT}
MARKS = {State.REACHED: "✓", State.MISSED: "✗", State.NOT_CERTAIN: "?"}
# What the deciding figures of a shape are called, and what comes after their values.
NAMES = {"_".join(DISTANCE): "shape", "_".join(DIRECTION): "direction of the tip"}
AFTER = {"_".join(DISTANCE): " of the length"}
# Figures that are told at most beside those of the shape; heights of rows and lines in inches.
MOST_FIGURES = 3
ROW, LINE = 0.40, 0.155
# Space above the legend, in inches.
LEGEND = 0.05
# Letters of a line of notes in an inch, and the size of notes in points.
LETTERS_PER_INCH, NOTE = 17.5, 7.5
BY_SECTIONS = (
    "Shape: root mean square distance of the centres of 12 cross-sections from the target, in % "
    "of the skin's length. Bulging does not count."
)
GUIDE = "The outline is a guide: only the numbers above are asked for, no place."
BY_POINTS = (
    "Shape: root mean square distance of all points from the target, in % of the skin's length."
)
# Half-width over the target beyond which a figure tells little.
TELLS_LITTLE = 0.5


Verdict = tuple[str, str, str, str]
"""Whether a shape is what was asked for: a word, its colour, the figure that decides, and how far
off it may be; the last is empty if that is known."""


def name_of(figure: Told) -> str:
    """Return what a figure is called in pictures."""
    return NAMES.get(figure.key, figure.label)


def with_shape(figures: Sequence[Told], miss: Miss | None) -> list[Told]:
    """Return figures that decide, with those of a shape that a summary does not tell."""
    found = [figure for figure in figures if figure.target is not None]
    if miss is not None and not any(map(is_of_shape, found)):
        found += shape_figures(miss.values())
    return [figure for figure in found if not is_of_shape(figure) or figure.state]


def verdict(figures: Sequence[Told], miss: Miss | None = None) -> Verdict | None:
    """Return whether all targets of figures are reached; None without any.

    A miss, the distance from the target shape, is given where the figures do not tell it.
    """
    found = with_shape(figures, miss)
    state, worst = overall(found), worst_of(found)
    if state is None or worst is None:
        return None
    if worst.value is None:
        return "No equilibrium", ACCENT, "", ""
    within = f"within {worst.allowed} would be reached"
    known = "its error is not estimated; " if worst.interval is None else ""
    by = "off by " if is_of_shape(worst) else ""
    reason = f"{name_of(worst)} {by}{worst.off(with_error=True)}{AFTER.get(worst.key, '')}"
    if state is State.REACHED:
        reason = ", ".join(
            f"{name_of(figure)} {figure.shown}{AFTER.get(figure.key, '')}" for figure in found[:2]
        )
        return "Reached", DARK, reason, ""
    return state.capitalize(), COLOURS[state], reason, f"{known}{within}"


def write_verdict(figure: Figure, found: Verdict | None, tail: str, otherwise: str) -> None:
    """Write the verdict, or a title without one, and the figure that decides at the top of a page.

    The tail, such as the pressure, ends the second line.
    """
    height = figure.get_size_inches()[1]
    if found is None:
        figure.text(0.02, 1 - 0.12 / height, otherwise, fontsize=11, fontweight="bold", va="top")
        return
    word, colour, reason, bound = found
    large = figure.text(0.02, 1 - 0.36 / height, word, fontsize=17, fontweight="bold", color=colour)
    right = large.get_window_extent(FigureCanvasAgg(figure).get_renderer()).x1
    left = figure.transFigure.inverted().transform((right, 0))[0] + 0.012
    figure.text(left, 1 - 0.36 / height, reason, fontsize=12, fontweight="bold", color=INK)
    second = ". ".join(filter(None, (bound[:1].upper() + bound[1:], tail)))
    figure.text(0.02, 1 - 0.58 / height, second, fontsize=TEXT, color=SOFT)


def write_rows(axes: Axes, figures: Sequence[Told], miss: Miss | None, top: float) -> float:
    """Write what was found and wanted of each figure, and its state; return where it ends.

    The axes are in inches, without a frame, as is the height of the first line. Figures of the
    shape come last.
    """
    right = axes.get_xlim()[1]
    shape = [figure for figure in figures if is_of_shape(figure)]
    own = [figure for figure in figures if not is_of_shape(figure)][:MOST_FIGURES]
    for told in (*own, *shape):
        axes.text(0, top, name_of(told), fontweight="bold", va="top")
        if told.state is not None:
            said = f"{MARKS[told.state]} {told.state}"
            axes.text(
                right, top, said, color=COLOURS[told.state], fontweight="bold", va="top", ha="right"
            )
        value = told.shown
        if told.key == "_".join(DISTANCE) and miss is not None:
            value += f" ({1e3 * miss.rms:.2g} mm)"
        axes.text(0, top - LINE, value, va="top", fontsize=8)
        if told.asked:
            wanted = f"wanted: {told.asked.replace('at most ', '≤ ')}"
            axes.text(
                right, top - LINE, wanted, color=SOFT, va="top", ha="right",
                fontsize=8,
            )  # fmt: skip
        top -= ROW
    return top


def write_notes(axes: Axes, notes: Sequence[str], top: float, colour: str = SOFT) -> float:
    """Write sentences below each other, as `write_rows` does, and return where they end."""
    letters = int(LETTERS_PER_INCH * axes.get_xlim()[1])
    for note in notes:
        text = fill(note, letters)
        axes.text(0, top, text, fontsize=NOTE, color=colour, va="top", linespacing=1.25)
        top -= 0.135 * (text.count("\n") + 1) + 0.03
    return top


def write_legend(axes: Axes, lines: bool, top: float) -> float:
    """Say what the lines of a view are, also those on the skin; return where it ends."""
    top -= LEGEND
    entries = [("outline of the target", [(ACCENT, "--")])]
    if lines:
        entries.append(("line along the skin: as wanted, as found", [(ACCENT, ":"), (EDGE, "-")]))
    for words, looks in entries:
        for k, (colour, style) in enumerate(looks):
            height = top - 0.05 + 0.045 * (len(looks) - 1 - 2 * k)
            axes.plot([0, 0.3], [height] * 2, color=colour, ls=style, lw=1.3)
        axes.text(0.38, top - 0.05, words, fontsize=NOTE, color=SOFT, va="center")
        top -= 0.16
    return top


def notes_of(figures: Sequence[Told], miss: Miss | None, skin: ShownSkin) -> list[str]:
    """Return what a reader of the rows must know."""
    found = []
    if miss is not None:
        found.append(BY_SECTIONS if miss.by_sections else BY_POINTS)
        free = [name for name, one in zip("xyz", skin.compared, strict=True) if not one]
        if free:
            axes = " and ".join(free)
            found.append(f"The target leaves {axes} free: there the outline follows the skin.")
    elif skin.target is not None:
        found.append(GUIDE)
    if any(figure.interval is not None for figure in figures):
        found.append("±: how far the mesh of the simulation may put a number off.")
    if any((f.interval or 0.0) > TELLS_LITTLE * abs(f.target or np.inf) for f in figures):
        found.append("Where ± is over half of the target, the mesh is too coarse to tell.")
    return found
