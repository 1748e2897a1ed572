"""Pictures of a skin as it inflates, and the strip from flat print to inflated skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from toros_fem.base.array_types import Floats
from toros_fem.results.pictures.flat import draw_panels
from toros_fem.results.pictures.raster import MARGIN, DrawnSurface, render, window_of
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.stage import Axonometry
from toros_fem.results.pictures.style import BAR_ROOM, INK, SOFT, TEXT, TITLE, Box, note
from toros_fem.results.pictures.view import View
from toros_fem.results.pictures.words import Word, write_words

# States by their names, each with what is drawn of it.
Scenes = Sequence[tuple[str, Sequence[DrawnSurface]]]
# Opacity of the first state, and of the last one but one.
FIRST, BEFORE = 0.22, 0.5
# Room for names of states beside and above them, in points.
BESIDE, ABOVE_ALL = 62.0, 22.0
# Points between a state and its name above; room beside states for the bar of the scale, over the
# width of all.
NAME_OFF, BAR_BESIDE = 4.0, 0.15
# Distances from a tip at which the name of its state is tried, in points; turns in degrees from
# where the tip points to.
REACH = (8.0, 10.0, 13.0, 16.0, 20.0, 26.0, 34.0, 44.0)
TURNS = (0, 20, -20, 40, -40, 60, -60, 90, -90)
# Elevation and further turn of the view, in degrees.
ABOVE, TURN = 12.0, -20.0
# Parts of the vertices that move less than the tip, and than where it begins.
TIP, NECK = 0.95, 0.75
# States stand in rows where the last one covers more than this part of the skin at rest.
COVERED = 0.6
# Width in pixels of the picture that this is found by.
ROUGH = 200
# States in rows, in points: height of the name above a state, distance between the middles of two
# states for names not to meet, and distance between two states at least.
NAME_ABOVE, NAME_ACROSS, GAP = 16.0, 60.0, 10.0
# Columns are at most so many times the width of a state apart.
APART = 2.8


def draw_hero(
    figure: Figure, drawn: DrawnSkin, states: Sequence[tuple[str, Floats]], sentence: str
) -> None:
    """Draw a strip with the flat print at the left and the skin as it inflates at the right.

    The states are those of `draw_inflation`, the sentence says what it does.
    """
    draw_panels(figure, (0.01, 0.03, 0.28, 0.80), drawn.pattern, drawn.skin.regions)
    draw_inflation(figure, (0.30, 0.02, 0.69, 0.84), drawn, states)
    for x, words in ((0.02, "print this, sew it …"), (0.31, f"… {sentence}")):
        figure.text(x, 0.93, words, fontsize=TITLE - 1, va="center")


def draw_inflation(
    figure: Figure,
    box: Box,
    drawn: DrawnSkin,
    states: Sequence[tuple[str, Floats]],
) -> None:
    """Draw a skin at rest and at rising pressures in one frame, earlier ones fading.

    States that would cover each other, as those of a skin that twists, stand in rows. Each has its
    name and positions of all vertices, (n, 3), in m; the last one is that of the target.
    """
    names, placed = [name for name, _ in states], [drawn.skin.placed(x) for _, x in states]
    view = inflation_view(drawn, placed[-1])
    target = drawn.skin.wanted(placed[-1])
    scenes = [drawn.surfaces(x)[:1] for x in placed[:-1]] + [drawn.surfaces(placed[-1])]
    covered = _covered(scenes[0], scenes[-1][:1], view) > COVERED
    draw = _draw_in_rows if covered else _draw_over
    draw(figure, box, drawn, view, list(zip(names, scenes, strict=True)), target)


def _draw_over(
    figure: Figure, box: Box, drawn: DrawnSkin, view: View, scenes: Scenes, target: Floats | None
) -> None:
    """Draw states where they are, each over the earlier ones."""
    placed = [skin.points for _, (skin, *_) in scenes]
    moves = np.linalg.norm(placed[-1] - placed[0], axis=1)
    tip, below = moves >= np.quantile(moves, TIP), moves < np.quantile(moves, TIP)
    neck = below & (moves >= np.quantile(moves, NECK))
    others = [body.points for body in scenes[-1][1][1:]] + ([] if target is None else [target])
    across, up = 72 * figure.get_size_inches() * box[2:]
    room = (BESIDE / across, BESIDE / across, 0.03, ABOVE_ALL / up)
    stage = Axonometry(figure, box, view, np.concatenate([*placed, *others]), room)
    opacities = [*np.linspace(FIRST, BEFORE, len(scenes) - 1), 1.0]
    for (_, surfaces), opacity in zip(scenes, opacities, strict=True):
        stage.draw(surfaces, float(opacity))
    if target is not None:
        stage.outline(drawn, target)
    stage.bar()
    words = []
    for (name, _), points in zip(scenes, placed, strict=True):
        flat, last = 1e3 * view.project(points), points is placed[-1]
        at = flat[tip].mean(axis=0)
        sides = _fan(at - flat[neck].mean(axis=0))
        words.append(Word(name, tuple(at), INK if last else SOFT, bold=last, sides=sides))
    write_words(stage.axes, words[::-1], [], REACH, stage.covered)


def _fan(along: Floats) -> list[tuple[float, float]]:
    """Return sides of a tip that points along a direction, (2,): the nearest ones first."""
    angles = np.arctan2(along[1], along[0]) + np.radians(TURNS)
    return [(float(np.cos(angle)), float(np.sin(angle))) for angle in angles]


def _draw_in_rows(
    figure: Figure, box: Box, drawn: DrawnSkin, view: View, scenes: Scenes, target: Floats | None
) -> None:
    """Draw states beside each other, as large as the box lets them be."""
    shapes = [[one.points for one in surfaces] for _, surfaces in scenes]
    shapes[-1] += [] if target is None else [target]
    flat = [view.project(np.concatenate(points)) for points in shapes]
    extents = [np.array([x.min(axis=0), x.max(axis=0)]) for x in flat]
    space = 72 * figure.get_size_inches() * box[2:] * (1 - 2 * MARGIN)
    # The bar of the scale is below the states, or beside them.
    bars = (np.array([0.0, BAR_ROOM]), np.array([BAR_BESIDE * space[0], 0.0]))
    fits = [(arrange(extents, space - bar), bar) for bar in bars]
    rows, bar = max(fits, key=lambda fit: fit[0].scale)
    wider = bar / rows.scale
    corners = np.array([rows.low - wider, rows.high + wider * [1, 0]])
    plane = view.directions[:2]
    stage = Axonometry(figure, box, view, corners @ plane)
    for k, ((name, surfaces), move) in enumerate(zip(scenes, rows.moves @ plane, strict=True)):
        last = k == len(scenes) - 1
        stage.draw([replace(one, points=one.points + move) for one in surfaces])
        if last and target is not None:
            stage.outline(drawn, target + move)
        left, right = 1e3 * (extents[k][:, 0] + rows.moves[k, 0])
        note(
            stage.axes, name, ((left + right) / 2, 1e3 * rows.tops[k]), (0, NAME_OFF),
            INK if last else SOFT, TEXT,
            ha="center", va="bottom", zorder=5, fontweight="bold" if last else "normal",
        )  # fmt: skip
    stage.bar()


def _covered(rest: Sequence[DrawnSurface], last: Sequence[DrawnSurface], view: View) -> float:
    """Return which part of a skin at rest is covered by another state that is before it."""
    points = np.concatenate([one.points for one in (*rest, *last)])
    window = window_of(view.project(points), 1.0, ROUGH)
    one, other = (
        render(surfaces, view, window, cut=False).colours[..., 3] > 0 for surfaces in (rest, last)
    )
    return float((one & other).sum() / max(one.sum(), 1))


def inflation_view(drawn: DrawnSkin, positions: Floats) -> View:
    """Return the side view from somewhat above, for states in one frame."""
    side, _ = drawn.views(positions)
    return View(ABOVE, side.turn + TURN)


@dataclass(frozen=True)
class Arrangement:
    """States in rows, each moved as a whole.

    Attributes:
        scale: Points on the page per m.
        moves: How far each state is moved to the right and upwards, (n, 2), in m.
        tops: Height of the row of each state, below its names, (n,), in m.
        low, high: Corners of what all need with their names, (2,), in m.
    """

    scale: float
    moves: Floats
    tops: Floats
    low: Floats
    high: Floats


def arrange(extents: Sequence[Floats], space: Floats) -> Arrangement:
    """Return the rows of states in which these are largest.

    States of a row keep their heights over each other, and those of a column their places across.

    Args:
        extents: Lower left and upper right corner of each state on the picture, (2, 2), in m.
        space: Width and height that they may take, (2,), in points.
    """
    found = [_in_columns(np.array(extents), k, space) for k in range(1, len(extents) + 1)]
    return max(found, key=lambda one: one.scale)


def _in_columns(extents: Floats, columns: int, space: Floats) -> Arrangement:
    """Return the rows of so many states each."""
    rows = [extents[k : k + columns, :, 1] for k in range(0, len(extents), columns)]
    low = np.array([row[:, 0].min() for row in rows])
    heights = np.array([row[:, 1].max() for row in rows]) - low
    left, width = extents[:, 0, 0].min(), np.ptp(extents[..., 0])
    across, up = space - [GAP * columns, (NAME_ABOVE + GAP) * len(rows) - GAP]
    # Too many columns for their names are no choice, as is a page without room.
    scale = max(min(across / (columns * width), up / heights.sum()), 1e-9)
    if columns * NAME_ACROSS > space[0]:
        scale = 1e-9
    pitch = min(max(APART * width, NAME_ACROSS / scale), space[0] / (columns * scale))
    pitch = max(pitch, width + GAP / scale)
    bottoms = GAP / scale - np.cumsum(heights + (NAME_ABOVE + GAP) / scale)
    number = np.arange(len(extents))
    row = number // columns
    moves = np.stack([number % columns * pitch, (bottoms - low)[row]], axis=1)
    middle = (columns - 1) * pitch / 2 + left + width / 2
    half = max(columns * pitch, width) / 2
    corners = np.array([[middle - half, bottoms[-1]], [middle + half, 0.0]])
    return Arrangement(scale, moves, (bottoms + heights)[row], *corners)
