"""Pictures of numbers: over the pressure, over the iterations, and the paths of feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle, pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from toros_fem.base.validation import Floats
from toros_fem.measures.figures import Figure as Told
from toros_fem.measures.figures import axis_label, formatted, unit_of
from toros_fem.results.pictures import style
from toros_fem.results.pictures.style import Word, write_words
from toros_fem.results.runs.stored_run import BEYOND, StoredCurve

PRESSURE = "pressure (kPa)"
UNTESTED = (0, (3, 2))
FINER = "; dots with intervals are of a finer mesh than lines"
# Feet whose paths end nearer than this, over the extent of all, have one name.
SAME = 0.01
# Of curves on the same axes, in turn.
COLOURS = (style.DARK, style.SECOND, style.SOFT, style.INK)


def draw_curve(figure: Figure, curve: StoredCurve, figures: Sequence[Told]) -> None:
    """Draw figures over the pressure on a page, those of different units below one another.

    Their intervals and targets are those at the pressure of the design.
    """
    units = list(dict.fromkeys(told.unit for told in figures))
    # Curves that share axes have their names at the right.
    right = 0.97 if len(units) == len(figures) else 0.88
    grid = figure.subplots(
        len(units), 1, sharex=True, squeeze=False,
        gridspec_kw={"left": 0.09, "right": right, "bottom": 0.11, "top": 0.88, "hspace": 0.15},
    )[:, 0]  # fmt: skip
    keys = {told.key for told in figures}
    beside = [one.pressure for one in curve.measured if one.key in keys]
    grid[-1].set_xlim(0, 1.05e-3 * max(curve.rows[-1]["pressure_pa"], *beside, 0))
    for axes, unit in zip(grid, units, strict=True):
        shown = [told for told in figures if told.unit == unit]
        axes.margins(y=0.12)
        draw_over_pressure(axes, curve, shown)
    grid[-1].set_xlabel(pressure_label(curve))


def pressure_label(curve: StoredCurve) -> str:
    """Return what stands below the axis of pressures of a curve."""
    return PRESSURE + (FINER if curve.finer else "")


def draw_over_pressure(axes: Axes, curve: StoredCurve, figures: Sequence[Told]) -> None:
    """Draw figures of one unit over the pressure in kPa, on the axes of a page."""
    rows = curve.rows
    at = [1e-3 * row["pressure_pa"] for row in rows]
    factor = unit_of(figures[0].unit).factor
    axes.grid(axis="y")
    words, lines = list[Word](), list[Floats]()
    known = last_tested(curve)
    for told, colour in zip(figures, cycle(COLOURS), strict=False):
        values = [factor * row.get(told.key, np.nan) for row in rows]
        axes.plot(at[: known + 1], values[: known + 1], "-", color=colour, lw=1.6)
        if known < len(at) - 1:
            axes.plot(at[known:], values[known:], color=colour, lw=1.6, ls=UNTESTED)
            words.append(Word("beyond the fabric's tests", (at[-1], values[-1]), style.SOFT, 8.0))
        lines.append(np.column_stack([at, values]))
        if len(figures) > 1:
            _name(axes, (at[-1], values[-1]), told.name.replace("_", " "), colour)
        of_marks, beside = _marks(axes, told, curve, colour, factor)
        words, lines = words + of_marks, lines + beside
        for k, side, is_broken in zip((0, -1), ("below", "beyond"), curve.broken, strict=True):
            if is_broken:
                axes.plot(at[k], values[k], "x", color=style.ACCENT, ms=8, mew=2)
                words.append(Word(f"no equilibrium {side}", (at[k], values[k]), style.ACCENT, 8.0))
    targets = [(told, factor * told.target) for told in figures if told.target is not None]
    for _, height in targets:
        axes.axhline(height, color=style.ACCENT, ls="--", lw=1.2, zorder=1)
    axes.autoscale_view(scalex=False)  # a target within the limits leaves them without margin
    left, right = axes.get_xlim()
    lines += [np.array([(left, height), (right, height)]) for _, height in targets]
    # Targets are named first: they have one place, where the axis of pressures begins.
    named = [
        Word(f"target {formatted(told.target, told.unit)}", (left, height), style.ACCENT, 8.0)
        for told, height in targets
    ]
    write_words(axes, [*named, *words], lines)
    axes.set_ylabel(axis_label(figures))


def last_tested(curve: StoredCurve) -> int:
    """Return the number of the last row up to which the fabric was tested; that of all if unknown.

    The pressure rises with the rows, and the stretch hardly ever falls.
    """
    if curve.tested is None:
        return len(curve.rows) - 1
    most = (1 + BEYOND) * curve.tested
    beyond = [row.get("stretch_use", 0.0) > most for row in curve.rows]
    return max(0, beyond.index(True) - 1) if True in beyond else len(beyond) - 1


def _name(axes: Axes, at: tuple[float, float], name: str, colour: str) -> None:
    look = {"va": "center", "fontweight": "bold", "annotation_clip": False}
    style.note(axes, name, at, (6, 0), colour, style.TEXT, **look)


def _marks(
    axes: Axes, told: Told, curve: StoredCurve, colour: str, factor: float
) -> tuple[list[Word], list[Floats]]:
    """Draw a figure at the pressure of the design with its error, and values that were measured.

    Returned are the words on them, and lines that these should not cover.
    """
    words, lines = list[Word](), list[Floats]()
    low, high = (curve.rows[k]["pressure_pa"] for k in (0, -1))
    if told.value is not None and curve.pressure is not None and low <= curve.pressure <= high:
        x, y = 1e-3 * curve.pressure, factor * told.value
        if told.interval is not None:
            half = factor * told.interval
            axes.errorbar(x, y, half, color=colour, capsize=4, lw=1.2, zorder=4)
            lines.append(np.array([(x, y - half), (x, y + half)]))
        axes.plot(x, y, "o", color=colour, ms=6, zorder=5)
        words.append(Word(told.shown, (x, y), colour))
    for _, pressure, figure in (one for one in curve.poses if one.key == told.key):
        x = 1e-3 * pressure
        if figure.target is not None:
            target, said = factor * figure.target, formatted(figure.target, told.unit)
            axes.plot(x, target, "_", color=style.ACCENT, ms=16, mew=1.6, zorder=3)
            words.append(Word(f"target {said}", (x, target), style.ACCENT, 8.0))
        if figure.value is not None:
            y, half = factor * figure.value, factor * (figure.interval or 0.0)
            axes.errorbar(x, y, half, fmt="o", color=colour, capsize=4, lw=1.2, ms=6, zorder=5)
            lines.append(np.array([(x, y - half), (x, y + half)]))
            words.append(Word(figure.shown, (x, y), colour))
    for one in (one for one in curve.measured if one.key == told.key):
        x, y = 1e-3 * one.pressure, factor * one.value
        axes.plot(x, y, "D", color=style.INK, mfc="none", ms=7, zorder=5)
        text = f"{formatted(one.value, told.unit, 3)} ({one.source})"
        if one.simulated is not None:  # ours at the same pressure
            text += f",\n{formatted(one.simulated, told.unit, 3)} ours"
            axes.plot([x, x], [y, factor * one.simulated], color=style.SOFT, lw=0.8, ls=":")
            lines.append(np.array([(x, y), (x, factor * one.simulated)]))
        words.append(Word(text, (x, y), style.INK, 8.0))
    return words, lines


def draw_history(axes: Axes, rows: Sequence[Mapping[str, float]], told: Told | None = None) -> None:
    """Draw the objective over the iterations, by rows of the history, and one figure at the right.

    Dotted lines mark where the next mesh begins.
    """
    count, objective = zip(*((row["iteration"], row["objective"]) for row in rows), strict=True)
    axes.plot(count, objective, color=style.DARK, lw=1.4)
    if positive := [value for value in objective if value > 0]:
        least, most = np.floor(np.log10(min(positive))), np.ceil(np.log10(max(positive)))
        axes.set(yscale="log", ylim=(10.0**least, 10.0 ** max(most, least + 1)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
    axes.set_ylabel("objective T", color=style.DARK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("iteration")
    for begin in (b["iteration"] for a, b in pairwise(rows) if b.get("level") != a.get("level")):
        axes.axvline(begin, color=style.SOFT, ls=":", lw=0.8)
        style.note(axes, "finer mesh", (begin, 1), (3, -9), xycoords=("data", "axes fraction"))
    if told is None or told.key not in rows[-1]:
        return
    right, factor = axes.twinx(), unit_of(told.unit).factor
    right.spines["right"].set_visible(True)
    values = [factor * row.get(told.key, np.nan) for row in rows]
    right.plot(count, values, color=style.SECOND, lw=1.4)
    right.set_ylabel(axis_label([told]), color=style.SECOND)
    if told.target is not None:
        height = factor * told.target
        right.axhline(height, color=style.ACCENT, ls="--", lw=1)
        lines = [np.column_stack([count, values]), np.array([(0, height), (count[-1], height)])]
        name = f"target {formatted(told.target, told.unit)}"
        write_words(right, [Word(name, (count[-1] / 2, height), style.ACCENT, 8.0)], lines)


def cycle_title(stride: Told | None, otherwise: str) -> str:
    """Return how far a cycle of a gait goes, or another title without a stride."""
    return otherwise if stride is None else f"One cycle walks {stride.shown}"


def draw_tracks(
    figure: Figure,
    feet: Floats,
    every: int,
    stride: Told | None = None,
    measured: tuple[str, float] | None = None,
) -> None:
    """Draw the paths of feet in the x-z plane, of positions (rows, feet, 3) in m.

    Every so many rows a mark shows a phase of the gait. The stride, the distance along x of a cycle
    in mm, is drawn true to scale below; so is a measured one in m, with the name of who measured
    it.
    """
    style.write_title(figure, cycle_title(stride, "Paths of the feet"))
    axes = figure.add_axes((0.09, 0.12, 0.80, 0.75))
    named: dict[tuple[float, float], tuple[list[str], str]] = {}
    for k in range(feet.shape[1]):
        x, z = 1e3 * feet[:, k, 0], 1e3 * feet[:, k, 2]
        place = float(x.max()), float(z[x.argmax()])
        near = SAME * 1e3 * float(np.ptp(feet))
        place = next((at for at in named if np.abs(np.subtract(at, place)).max() < near), place)
        colour = (style.DARK, style.SECOND, style.SOFT, style.ACCENT)[len(named) % 4]
        of_place, colour = named.setdefault(place, ([], colour))
        of_place.append(f"{k}")
        axes.plot(x, z, color=colour)
        axes.plot(x[::every], z[::every], "o", ms=4, color=colour)
        axes.plot(x[0], z[0], "s", ms=9, mfc="none", color=colour)
    for place, (feet_there, colour) in named.items():  # those of a mirror image coincide
        word = "feet" if len(feet_there) > 1 else "foot"
        _name(axes, place, f"{word} {', '.join(feet_there)}", colour)
    bars = [] if stride is None else [("simulated", stride, style.DARK)]
    if measured is not None:
        bars.append((measured[0], Told("stride", "mm", 1e3 * measured[1]), style.ACCENT))
    low, high = axes.get_ylim()
    begin = 1e3 * float(feet[:, :, 0].mean())
    for k, (name, told, colour) in enumerate(bars):
        height, end = low - (0.14 + 0.16 * k) * (high - low), begin + (told.value or 0.0)
        axes.annotate("", (end, height), (begin, height), zorder=4,
                      arrowprops={"arrowstyle": "<->", "color": colour, "lw": 2})  # fmt: skip
        style.note(
            axes, f"{name}: {told.shown}", (min(begin, end), height), (0, 5), colour, style.TEXT
        )
    if bars:
        axes.set_ylim(low - (0.14 + 0.16 * len(bars)) * (high - low), high)
    axes.set_xlabel("x (mm); a square is the start")
    axes.set_ylabel("height (mm)")
