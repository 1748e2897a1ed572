"""Pictures of a skin as it inflates, and the strip from flat print to inflated skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from toros_fem.base.array_types import Floats
from toros_fem.results.pictures.flat import draw_panels
from toros_fem.results.pictures.raster import render, window_of
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.stage import Stage
from toros_fem.results.pictures.style import INK, SOFT, TITLE, Box
from toros_fem.results.pictures.view import View
from toros_fem.results.pictures.words import Word, write_words

# Opacity of the first state, and of the last one but one.
FIRST, BEFORE = 0.22, 0.5
# Distance of a state's name from its tip, in points.
NAME = 28.0
# Distances that names of states above each other are tried at.
REACH = (8.0, 14.0, 20.0, 26.0, 34.0, 44.0)
# On these sides of the tip, since earlier states are at the left.
AWAY = ((0, 1), (1, 1), (1, 0), (1, -1), (-1, 1), (-1, 0), (0, -1), (-1, -1))
# Elevation and further turn of the view, in degrees.
ABOVE, TURN = 12.0, -20.0
# Part of the vertices that move less than the tip.
TIP = 0.95
# States stand side by side where the last one covers more than this part of the skin at rest, with
# this distance over its width.
COVERED, BESIDE = 0.6, 2.8
# Skins that are so many times wider than high stand above each other, by this over their height.
LYING, STACKED = 1.5, 1.2
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

    States that would cover each other, as those of a skin that twists, stand side by side. Each has
    its name and positions of all vertices, (n, 3), in m; the last one is that of the target.
    """
    names, placed = [name for name, _ in states], [drawn.skin.placed(x) for _, x in states]
    view = inflation_view(drawn, placed[-1])
    way, step = _arrangement(drawn, placed[0], placed[-1], view)
    moves = np.linalg.norm(placed[-1] - placed[0], axis=1)
    tip = moves >= np.quantile(moves, TIP)
    placed, end = [x + k * step for k, x in enumerate(placed)], (len(placed) - 1) * step
    target = drawn.skin.wanted(placed[-1] - end)
    skins = [drawn.surfaces(x) for x in placed]
    beside = [replace(body, points=body.points + end) for body in skins[-1][1:]]
    others = [body.points for body in beside] + ([] if target is None else [target + end])
    across, up = 72 * figure.get_size_inches() * box[2:]
    room = (2.2 * NAME / across, 2.2 * NAME / across, 0.03, 1.6 * NAME / up)
    stage = Stage(figure, box, view, np.concatenate([*placed, *others]), room)
    fading = [*np.linspace(FIRST, BEFORE, len(placed) - 1), 1.0]
    for k, (skin, *_) in enumerate(skins):
        surfaces = [skin, *beside] if k == len(skins) - 1 else [skin]
        stage.draw(surfaces, float(fading[k]) if way == "over" else 1.0)
    if target is not None:
        stage.outline(drawn, target + end)
    stage.bar()
    flat = [1e3 * view.project(x) for x in placed]
    if way == "over":
        words = [
            Word(name, tuple(x[tip].mean(axis=0)), INK if k == len(flat) - 1 else SOFT,
                 bold=k == len(flat) - 1)
            for k, (name, x) in enumerate(zip(names, flat, strict=True))
        ]  # fmt: skip
        seen = [1e3 * view.project(points) for points in others]
        write_words(stage.axes, words[::-1], [*flat, *seen], REACH, AWAY)
        return
    for name, x in zip(names, flat, strict=True):
        at, away = _name_place(way, x)
        stage.axes.annotate(
            name, tuple(at), tuple(away), textcoords="offset points", ha="center",
            va="center", color=INK if x is flat[-1] else SOFT, zorder=5,
            fontweight="bold" if x is flat[-1] else "normal",
        )  # fmt: skip


def _arrangement(drawn: DrawnSkin, rest: Floats, last: Floats, view: View) -> tuple[str, Floats]:
    """Return whether states are drawn "over" each other, "beside" or "below", and the step."""
    right, up, _ = view.directions
    if _covered(drawn, rest, last, view) <= COVERED:
        return "over", np.zeros(3)
    across, height = np.ptp(view.project(np.concatenate([rest, last])), axis=0)
    if across > LYING * height:
        return "below", -STACKED * height * up
    return "beside", BESIDE * float(np.ptp(view.project(rest)[:, 0])) * right


def _name_place(way: str, flat: Floats) -> tuple[Floats, Floats]:
    """Return the place of a state's name in the unit of its points, and its offset in points."""
    if way == "below":
        return np.array([flat[:, 0].max(), flat[:, 1].mean()]), np.array([NAME, 0.0])
    return np.array([flat[:, 0].mean(), flat[:, 1].max()]), np.array([0.0, NAME / 2])


def _covered(drawn: DrawnSkin, rest: Floats, last: Floats, view: View) -> float:
    """Return which part of a skin at rest is covered by another state that is before it."""
    window = window_of(view.project(np.concatenate([rest, last])), 1.0, ROUGH)
    one, other = (
        render(drawn.surfaces(x)[:1], view, window, cut=False).colours[..., 3] > 0
        for x in (rest, last)
    )
    return float((one & other).sum() / max(one.sum(), 1))


def inflation_view(drawn: DrawnSkin, positions: Floats) -> View:
    """Return the side view from somewhat above, for states in one frame."""
    side, _ = drawn.views(positions)
    return View(ABOVE, side.turn + TURN)
