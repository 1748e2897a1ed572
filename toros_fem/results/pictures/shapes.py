"""Pictures of skins in space: over their target, by their miss, and several states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from toros_fem.base.validation import Bools, Floats
from toros_fem.measures.figures import Figure as Told
from toros_fem.measures.figures import State, overall, worst_of
from toros_fem.measures.miss import DIRECTION, DISTANCE, Miss, Tip, is_of_shape, shape_figures
from toros_fem.results.pictures import style
from toros_fem.results.pictures.raster import MARGIN, DrawnSurface, View
from toros_fem.results.pictures.shown import Axonometry, DrawnSkin, ground_below
from toros_fem.results.pictures.style import ACCENT, DARK, EDGE, INK, SOFT, TEXT, Word, write_words
from toros_fem.results.runs.frames import ShownSkin

# Inches: what the verdict takes at the top, the words at the right, and the border.
HEAD, WORDS, BORDER = 0.72, 2.72, 0.12
# Width over height of views: of a slender upright body, whose end is enlarged instead of seen from
# above; and the least width and height in inches of what stands beside and below.
SLENDER, LEAST_BESIDE, LEAST_BELOW = 0.5, 1.55, 1.1
# Part of a slender body at its free end that is enlarged.
ENLARGED = 0.25
# Room for captions below a view, in inches, and at its four sides, over its extent.
CAPTION, ROOM = 0.24, (0.06, 0.06, 0.12, 0.03)
# Over the length: a tip this far off gets an arrow, and its directions are lines so long.
ARROW, RAY = 0.02, 0.13
# Degrees from which on both directions of a tip are drawn.
SEEN = 2.0
# Distances in points from a tip at which its words are tried.
NEAR_TIP = (7.0, 12.0, 20.0, 32.0, 48.0, 70.0, 100.0)
# Vertices that moved less than this over the size of the skin are held, and are flat so far.
HELD, FLAT = 1e-4, 0.1
# The word for it is tried below its mark first; height of the mark, and distances, in points.
BELOW = ((0, -1), (1, -1), (-1, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (0, 1))
HATCH, NEAR_HELD = 6.0, (12.0, 20.0, 32.0, 48.0, 70.0)
# Left, bottom, width and height of the views of a miss and of its colours, over the page.
SIDE_BOX = (0.01, 0.02, 0.60, 0.87)
OBLIQUE_BOX = (0.63, 0.44, 0.36, 0.46)
SCALE_BOX = (0.66, 0.20, 0.30, 0.035)
# Inches of a picture of states: a name above a state, that with the space below the state, and a
# bar of the scale below all.
NAMED, OVER, BAR = 0.26, 0.34, 0.36
# Letters in a line below its colours.
LETTERS = 44
# What colours of a miss mean.
WHAT_IS_SHOWN = "distance of each point from its target{} (mm)"


@dataclass(frozen=True, eq=False)
class Scenery:
    """A skin and its target, placed to be drawn.

    Attributes:
        positions: Placed positions of all vertices, (n, 3), in m.
        target: Those of the target, moved along axes that do not count; None without one.
        miss: How far they are apart; None where the design does not compare positions.
    """

    drawn: DrawnSkin
    positions: Floats
    target: Floats | None
    miss: Miss | None

    @property
    def framed(self) -> Floats:
        """All points that a view must hold, (m, 3), in m."""
        target, body = self.target, self.drawn.skin.body
        others = [*([] if target is None else [target]), *([] if body is None else [body[0]])]
        return np.concatenate([self.positions, self.rays, *others])

    @property
    def rays(self) -> Floats:
        """Ends of the directions of a tip, (k, 3), in m, where they differ enough to be drawn."""
        tip = None if self.miss is None else self.miss.tip
        if self.miss is None or tip is None or np.degrees(tip.direction) < SEEN:
            return np.empty((0, 3))
        return tip.at + RAY * self.miss.length * np.stack([tip.along, tip.asked_along])

    def show(self, figure: Figure, box: style.Box, view: View, framed: Floats) -> Axonometry:
        """Draw it in a box in inches, so that points (m, 3), in m, are seen."""
        size = np.tile(figure.get_size_inches(), 2)
        left, bottom, width, height = (np.array(box) / size).tolist()
        stage = Axonometry(figure, (left, bottom, width, height), view, framed, ROOM)
        image = stage.draw(self.drawn.surfaces(self.positions))
        if self.target is not None:
            stage.lines(self.drawn, self.positions, image, style.EDGE)
            stage.outline(self.drawn, self.target)
        return stage


def scenery(drawn: DrawnSkin, positions: Floats) -> Scenery:
    """Return a skin with its target, from positions of all vertices, (n, 3), in m."""
    placed, skin = drawn.skin.placed(positions), drawn.skin
    return Scenery(drawn, placed, skin.wanted(placed), skin.miss(placed))


def draw_shape(
    figure: Figure,
    drawn: DrawnSkin,
    positions: Floats,
    figures: Sequence[Told],
    title: str = "",
    state: str = "",
    notes: Sequence[str] = (),
    warning: str = "",
) -> None:
    """Draw the inflated skin with the dashed outline of its target, and its miss in words.

    Positions of all vertices, (n, 3), are in m. Figures with a target come first; where there is
    none the title is the result. `state` says what is shown, as "The print at 10 kPa", `notes` what
    a reader of the figures must know, and `warning` what is not as usual.
    """
    shown = scenery(drawn, positions)
    told = with_shape(figures, shown.miss) or list(figures)
    write_verdict(figure, verdict(figures, shown.miss), state, title)
    width, height = figure.get_size_inches()
    top = height - HEAD - BORDER
    axes = figure.add_axes((1 - WORDS / width, 0, (WORDS - BORDER) / width, top / height))
    axes.set_axis_off()
    axes.set_xlim(0, WORDS - BORDER)
    axes.set_ylim(0, top)
    said = [*notes_of(told, shown.miss, drawn.skin), *notes]
    end = write_notes(axes, said, write_rows(axes, told, shown.miss, top) - 0.04)
    end = write_notes(axes, [warning] if warning else [], end, style.ACCENT)
    if shown.target is not None:
        end = write_legend(axes, bool(drawn.lines), end)
    main, beside, labelled = _views(figure, shown, end)
    main.bar()
    if shown.miss is not None and shown.miss.tip is not None:
        for stage in (main, beside):
            words, lines = _mark_tip(stage, shown.miss, shown.miss.tip)
            if stage is labelled:
                write_words(stage.axes, words, lines, NEAR_TIP, stage.covered)
    _mark_held(main, drawn, shown.positions)


def _views(
    figure: Figure, shown: Scenery, free: float
) -> tuple[Axonometry, Axonometry, Axonometry]:
    """Draw two views: from the side, and obliquely or, of a slender upright body, its free end.

    An oblique view of such a body shows no more. The second view stands beside the first, or below
    the words at the right, where a height in inches is free, if the first one needs the place.
    Returned are both, and the one of them that has the labels.
    """
    drawn = shown.drawn
    width, height = figure.get_size_inches() - [WORDS + 2 * BORDER, HEAD + BORDER]
    side, view = drawn.views(shown.positions)
    framed, words = shown.framed, "seen obliquely"
    aspect = _aspect(side, framed)
    slender = aspect < SLENDER and shown.miss is not None and shown.miss.tip is not None
    below = aspect * height > width - LEAST_BESIDE and free > LEAST_BELOW
    first = width if below else min(max(aspect * height, LEAST_BESIDE), width - LEAST_BESIDE)
    main = shown.show(figure, (BORDER, BORDER, first, height), side, framed)
    if slender:
        ends = _end(drawn)
        assert shown.target is not None
        framed = np.concatenate([shown.positions[ends], shown.target[ends], shown.rays])
        view, words = side, "the free end, enlarged"
    left = BORDER + (width if below else first)
    across, top = (WORDS, free) if below else (width - first, BORDER + height)
    deep = min(across / _aspect(view, framed), top - BORDER - CAPTION)
    beside = shown.show(figure, (left, top - deep, across, deep), view, framed)
    beside.caption(words, 0, -3)
    return main, beside, beside if slender else main


def _aspect(view: View, framed: Floats) -> float:
    """Return width over height of a view of points, (m, 3), with room around them."""
    across, up = np.ptp(view.project(framed), axis=0) * [1 + sum(ROOM[:2]), 1 + sum(ROOM[2:])]
    return float(across / up)


def _end(drawn: DrawnSkin) -> Bools:
    """Return which vertices, (n,), are near the free end of a slender body."""
    points = drawn.pattern.points
    height = points[:, int(np.argmax(np.ptp(points, axis=0)))]
    return np.asarray(height > height.max() - ENLARGED * np.ptp(height))


def _mark_tip(stage: Axonometry, miss: Miss, tip: Tip) -> tuple[list[Word], list[Floats]]:
    """Draw an arrow from where a tip should be to where it is, and both directions there.

    The directions are drawn where at least half of the angle between them is seen. What belongs
    beside them is returned, with the lines.
    """
    words, lines = list[Word](), list[Floats]()
    at, goal = 1e3 * stage.view.project(np.array([tip.at, tip.asked]))
    rays = stage.view.project(np.array([tip.along, tip.asked_along]))
    if tip.distance > ARROW * miss.length:
        stage.arrow(goal, at, style.ACCENT)
        lines.append(np.array([goal, at]))
        words.append(_word(f"tip {_short(1e3 * tip.distance)} mm off", (at + goal) / 2))
    lengths = np.linalg.norm(rays, axis=1)
    seen = np.arccos(np.clip(rays[0] @ rays[1] / max(lengths.prod(), 1e-12), -1, 1))
    if lengths.min() < 0.5 or seen < max(np.radians(SEEN), 0.5 * tip.direction):
        return words, lines
    for ray, colour, dashes in zip(rays, (style.INK, style.ACCENT), ("-", "--"), strict=True):
        lines.append(np.array([at, at + 1e3 * RAY * miss.length * ray]))
        stage.axes.plot(*lines[-1].T, color=colour, ls=dashes, lw=1.2, zorder=6)
    end = at + 1e3 * RAY * miss.length * rays.mean(axis=0)
    words.append(_word(f"{_short(np.degrees(tip.direction))}°", end))
    return words, lines


def _short(number: float) -> str:
    """Return two digits of a number, or all before its point."""
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"


def _word(text: str, at: Floats) -> Word:
    return Word(text, (float(at[0]), float(at[1])), style.ACCENT, bold=True)


def _mark_held(stage: Axonometry, drawn: DrawnSkin, positions: Floats) -> None:
    """Mark a flat end that stays where it is, as drawings of beams do."""
    rest = drawn.pattern.points
    size = float(np.ptp(rest, axis=0).max())
    held = np.linalg.norm(positions - rest, axis=1) < HELD * size
    if held.sum() < 3:
        return
    flat = 1e3 * stage.view.project(rest[held])
    low, high = flat.min(axis=0), flat.max(axis=0)
    if high[1] - low[1] > FLAT * 1e3 * size:
        return
    stage.axes.plot([low[0], high[0]], [low[1], low[1]], color=style.INK, lw=2.5, zorder=5)
    for x in np.linspace(low[0], high[0], 7):
        look = {"arrowstyle": "-", "color": style.INK, "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
        style.note(stage.axes, "", (x, low[1]), (-5, -HATCH), arrowprops=look)
    middle = (float(low[0] + high[0]) / 2, float(low[1]))
    word = Word("held", middle, style.INK, 8.0, sides=BELOW)
    line = np.array([low, [high[0], low[1]]])
    write_words(stage.axes, [word], [line], NEAR_HELD, stage.covered)


def draw_miss(figure: Figure, drawn: DrawnSkin, positions: Floats) -> None:
    """Draw the inflated skin, coloured by its distance from the target.

    It has a target. Positions, (n, 3), in m, are those of all vertices.
    """
    shown = scenery(drawn, positions)
    miss, target = shown.miss, shown.target
    assert miss is not None
    assert target is not None
    most = max(float(miss.each.max()), 1e-6)
    scale = ScalarMappable(Normalize(0, 1e3 * most), style.SEQUENTIAL)
    colours = scale.to_rgba(1e3 * miss.each)[:, :3][drawn.pattern.triangles]
    which = "Centres of cross-sections" if miss.by_sections else "All points"
    style.write_title(
        figure,
        f"{which} are {1e3 * miss.rms:.2g} mm off (root mean square), "
        f"{100 * miss.rms / miss.length:.1f} % of the length",
    )
    side, oblique = drawn.views(shown.positions)
    for box, view in ((SIDE_BOX, side), (OBLIQUE_BOX, oblique)):
        stage = Axonometry(figure, box, view, shown.framed, ROOM)
        stage.draw(drawn.surfaces(shown.positions, colours))
        stage.outline(drawn, target)
        if view == side:
            stage.bar()
    bar = figure.colorbar(scale, cax=figure.add_axes(SCALE_BOX), orientation="horizontal")
    axes_named = " and ".join(np.array(list("xyz"))[list(drawn.skin.compared)])
    along = "" if all(drawn.skin.compared) else f" along {axes_named}"
    bar.set_label(fill(WHAT_IS_SHOWN.format(along), LETTERS))


def plot_states(
    path: Path,
    rows: Sequence[Sequence[tuple[str, Sequence[DrawnSurface]]]],
    view: View,
    title: str = "",
    ground: float | None = None,
    way: tuple[Floats, Floats] | None = None,
) -> None:
    """Write a PNG of states beside and below one another, in the same scale.

    Each state has its name and surfaces, in rows of equal length; the ground has a height in m, and
    the way is an arrow on the last state, between two points (3,) in m.
    """
    width, across = style.SIZE[0], max(map(len, rows))
    every = np.concatenate([s.points for row in rows for _, parts in row for s in parts])
    floor = [] if ground is None else [ground_below(every, ground)]
    flat = [
        view.project(np.concatenate([*(s.points for _, parts in row for s in parts), *floor]))
        for row in rows
    ]
    low, high = (np.array([end(points, axis=0) for points in flat]) for end in (np.min, np.max))
    left, right = float(low[:, 0].min()), float(high[:, 0].max())
    # Each row is as high as its states, all in one scale; they are no higher than the page is wide.
    heights, beside = high[:, 1] - low[:, 1], (1 - 2 * MARGIN) * width / across
    scale = min(beside / (right - left), (width - OVER * len(rows)) / float(heights.sum()))
    boxes = [scale * float(height) + OVER for height in heights]
    lines = len(style.title_lines(title, width).split("\n")) if title else 0
    head = style.BORDER + style.LINE * lines
    page = head + sum(boxes) + BAR
    with style.page(path, title, (width, page)) as figure:
        top = page - head
        for j, row in enumerate(rows):
            last = j == len(rows) - 1
            deep = boxes[j] + (BAR if last else 0.0)
            # The corners of the box in m, within the margin that a stage has.
            middle = np.array([(left + right) / 2, high[j, 1] + (NAMED - deep / 2) / scale])
            half = (1 - 2 * MARGIN) * np.array([width / across, deep]) / 2 / scale
            corners = np.stack([middle - half, middle + half]) @ view.directions[:2]
            for i, (name, surfaces) in enumerate(row):
                box = (i / across, (top - deep) / page, 1 / across, deep / page)
                stage = Axonometry(figure, box, view, corners)
                if ground is not None:
                    stage.ground(ground, every)
                stage.draw(surfaces)
                stage.caption(name, 1, -4)
                if last and way is not None and i == len(row) - 1:
                    stage.way(*way, style.ACCENT)
                if last and i == 0:
                    stage.bar()
            top -= boxes[j]


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
        for k, (colour, dashes) in enumerate(looks):
            height = top - 0.05 + 0.045 * (len(looks) - 1 - 2 * k)
            axes.plot([0, 0.3], [height] * 2, color=colour, ls=dashes, lw=1.3)
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
