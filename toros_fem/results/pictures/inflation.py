"""Pictures of a skin as it inflates, and the strip from flat print to inflated skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from toros_fem.base.array_types import Floats
from toros_fem.results.pictures.arrangement import Arrangement, arrange
from toros_fem.results.pictures.flat import draw_panels
from toros_fem.results.pictures.raster import MARGIN, Surface, render, window_of
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.stage import Stage
from toros_fem.results.pictures.style import BAR_ROOM, INK, SOFT, TITLE, Box
from toros_fem.results.pictures.view import View
from toros_fem.results.pictures.words import Word, write_words

# States by their names, each with what is drawn of it.
Scenes = Sequence[tuple[str, Sequence[Surface]]]
# Opacity of the first state, and of the last one but one.
FIRST, BEFORE = 0.22, 0.5
# Distance of a state's name from its tip, in points.
NAME = 28.0
# Points between a state and its name above; room beside states for the bar of the scale, over the
# width of all.
NAME_OFF, BAR_BESIDE = 4.0, 0.15
# Distances that names of states above each other are tried at.
REACH = (8.0, 14.0, 20.0, 26.0, 34.0, 44.0)
# On these sides of the tip, since earlier states are at the left.
AWAY = ((0, 1), (1, 1), (1, 0), (1, -1), (-1, 1), (-1, 0), (0, -1), (-1, -1))
# Elevation and further turn of the view, in degrees.
ABOVE, TURN = 12.0, -20.0
# Part of the vertices that move less than the tip.
TIP = 0.95
# States stand in rows where the last one covers more than this part of the skin at rest.
COVERED = 0.6
# Width in pixels of the picture that this is found by.
ROUGH = 200


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
    if _covered(scenes[0], scenes[-1][:1], view) <= COVERED:
        _draw_over(figure, box, drawn, view, list(zip(names, scenes, strict=True)), target)
    else:
        _draw_in_rows(figure, box, drawn, view, list(zip(names, scenes, strict=True)), target)


def _draw_over(
    figure: Figure, box: Box, drawn: DrawnSkin, view: View, scenes: Scenes, target: Floats | None
) -> None:
    """Draw states where they are, each over the earlier ones."""
    placed = [skin.points for _, (skin, *_) in scenes]
    moves = np.linalg.norm(placed[-1] - placed[0], axis=1)
    tip = moves >= np.quantile(moves, TIP)
    others = [body.points for body in scenes[-1][1][1:]] + ([] if target is None else [target])
    across, up = 72 * figure.get_size_inches() * box[2:]
    room = (2.2 * NAME / across, 2.2 * NAME / across, 0.03, 1.6 * NAME / up)
    stage = Stage(figure, box, view, np.concatenate([*placed, *others]), room)
    opacities = [*np.linspace(FIRST, BEFORE, len(scenes) - 1), 1.0]
    for (_, surfaces), opacity in zip(scenes, opacities, strict=True):
        stage.draw(surfaces, float(opacity))
    if target is not None:
        stage.outline(drawn, target)
    stage.bar()
    flat = [1e3 * view.project(x) for x in placed]
    words = [
        Word(name, tuple(x[tip].mean(axis=0)), INK if x is flat[-1] else SOFT, bold=x is flat[-1])
        for (name, _), x in zip(scenes, flat, strict=True)
    ]
    seen = [1e3 * view.project(points) for points in others]
    write_words(stage.axes, words[::-1], [*flat, *seen], REACH, AWAY)


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
    rows, bar = max(((arrange(extents, space - bar), bar) for bar in bars), key=_scale)
    wider = bar / rows.scale
    corners = np.array([rows.low - wider, rows.high + wider * [1, 0]])
    plane = view.directions[:2]
    stage = Stage(figure, box, view, corners @ plane)
    for k, ((name, surfaces), move) in enumerate(zip(scenes, rows.moves @ plane, strict=True)):
        last = k == len(scenes) - 1
        stage.draw([replace(one, points=one.points + move) for one in surfaces])
        if last and target is not None:
            stage.outline(drawn, target + move)
        (left, _), (right, top) = 1e3 * (extents[k] + rows.moves[k])
        stage.axes.annotate(
            name, ((left + right) / 2, top), (0, NAME_OFF), textcoords="offset points",
            ha="center", va="bottom", color=INK if last else SOFT, zorder=5,
            fontweight="bold" if last else "normal",
        )  # fmt: skip
    stage.bar()


def _scale(found: tuple[Arrangement, Floats]) -> float:
    return found[0].scale


def _covered(rest: Sequence[Surface], last: Sequence[Surface], view: View) -> float:
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
