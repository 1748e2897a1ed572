"""All pictures of a run, drawn from what its folder holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as MplFigure
from mpi4py import MPI

from toros_fem.base.validation import Floats
from toros_fem.making.printability import PRINT as PRINT_FILE
from toros_fem.making.printability import printability, read_print_polygons
from toros_fem.measures.figures import Figure, formatted
from toros_fem.measures.miss import is_of_shape
from toros_fem.results.pictures.curves import draw_curve, draw_history
from toros_fem.results.pictures.flat import draw_density, draw_panels, draw_pattern
from toros_fem.results.pictures.raster import MARGIN, DrawnSurface, View, render, window_of
from toros_fem.results.pictures.shapes import draw_miss, draw_shape
from toros_fem.results.pictures.shown import Axonometry, DrawnSkin
from toros_fem.results.pictures.style import (
    BAR_ROOM,
    INK,
    SIZE,
    SOFT,
    STRIP,
    TALL,
    TEXT,
    TITLE,
    Box,
    Word,
    note,
    page,
    write_words,
)
from toros_fem.results.runs.frames import FOLDER, Frame, read_frames, read_skin
from toros_fem.results.runs.stored_run import Run, read_run

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
# Figures that every run has, told where it has no others.
OF_THE_STATE = ("pressure", "volume", "stretch")
# Parts of the way from rest to the design's state that are shown between them, and how near a
# frame must be.
BETWEEN, NEAR = (0.25, 0.5, 0.75), 0.12
# What is said of a skin of more than this number of equal parts.
MIRRORED, LEGS = 2, "The skin has {} equal parts: a number is that of each."
# Iterations that are shown, besides the last one.
ITERATIONS = (1, 5, 20)
# Lower end and height of their panels, over the page.
BOTTOM, HEIGHT = 0.40, 0.47


def draw_hero(
    figure: MplFigure, drawn: DrawnSkin, states: Sequence[tuple[str, Floats]], sentence: str
) -> None:
    """Draw a strip with the flat print at the left and the skin as it inflates at the right.

    The states are those of `draw_inflation`, the sentence says what it does.
    """
    draw_panels(figure, (0.01, 0.03, 0.28, 0.80), drawn.pattern, drawn.skin.regions)
    draw_inflation(figure, (0.30, 0.02, 0.69, 0.84), drawn, states)
    for x, words in ((0.02, "print this, sew it …"), (0.31, f"… {sentence}")):
        figure.text(x, 0.93, words, fontsize=TITLE - 1, va="center")


def draw_inflation(
    figure: MplFigure,
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


def draw_poses(figure: MplFigure, poses: Sequence[tuple[str, DrawnSkin, Floats]]) -> None:
    """Draw poses of a skin beside each other, with the outlines of their targets.

    Each has its name, its skin with the target, and positions of all vertices, (n, 3), in m.
    """
    placed = [drawn.skin.placed(positions) for _, drawn, positions in poses]
    targets = [drawn.skin.wanted(x) for (_, drawn, _), x in zip(poses, placed, strict=True)]
    scenes = [drawn.surfaces(x) for (_, drawn, _), x in zip(poses, placed, strict=True)]
    # All have one scale, and their bases are at one height.
    framed = [one.points for surfaces in scenes for one in surfaces]
    framed += [target for target in targets if target is not None]
    view, width = inflation_view(poses[0][1], placed[0]), 0.98 / len(poses)
    for k, (name, drawn, _) in enumerate(poses):
        box = 0.01 + k * width, 0.02, 0.96 * width, 0.80
        stage = Axonometry(figure, box, view, np.concatenate(framed))
        stage.draw(scenes[k])
        if (target := targets[k]) is not None:
            stage.outline(drawn, target)
        stage.bar()
        figure.text(box[0] + box[2] / 2, 0.85, name, ha="center", color=SOFT)


def _draw_over(
    figure: MplFigure, box: Box, drawn: DrawnSkin, view: View, scenes: Scenes, target: Floats | None
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
    figure: MplFigure, box: Box, drawn: DrawnSkin, view: View, scenes: Scenes, target: Floats | None
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


def draw_run(folder: str | Path) -> list[Path]:
    """Draw the pictures of a run into its folder, and return their paths (one rank).

    They are, as far as the run has what they show: shape.png, miss.png, poses.png, inflation.png,
    pattern.png, curve.png, design.png and hero.png. Errors are those of `read_run` and `page`.
    """
    return _Pictures(read_run(folder)).draw()


class _Pictures:
    def __init__(self, run: Run) -> None:
        self.run, self.written = run, list[Path]()
        self.figures, self.facts = told_figures(run), facts_of(run)
        self.state = _state(run)
        if self.state is not None:
            skin = read_skin(run.folder / FOLDER / self.state.skin)
            self.drawn = DrawnSkin(skin, self.state.density)
            pressure = self.state.values.get("pressure_pa")
            there = [told for told in self.figures if told.key in self.state.values]
            self.title = sentence(there or self.figures, pressure)

    def draw(self) -> list[Path]:
        if self.state is not None:
            self._shape(self.state)
            self._inflation(self.state)
        self._poses()
        self._pattern()
        self._curve()
        self._design()
        return self.written

    @contextmanager
    def _page(
        self, name: str, title: str = "", size: tuple[float, float] = SIZE
    ) -> Iterator[MplFigure]:
        path = self.run.folder / name
        with page(path, title, size, self.facts) as figure:
            yield figure
        self.written.append(path)

    def _shape(self, state: Frame) -> None:
        failed = self.run.summary.entries.get("printed_failure")
        warning = "The print has no equilibrium: this is the design." if failed else state.note
        pressure = state.values.get("pressure_pa")
        what = "print" if state.series != "iteration" and not failed else "design"
        shown = "" if pressure is None else f"The {what} at {pressure / 1e3:.3g} kPa"
        parts = self.run.summary.entries.get("parts_by_symmetry") or 1
        notes = [LEGS.format(parts)] if parts > MIRRORED else []
        with self._page("shape.png") as figure:
            shape = filter(is_of_shape, self.run.summary.figures.values())
            figures = [*self.figures, *shape]
            draw_shape(
                figure, self.drawn, state.positions, figures, self.title, shown, notes, warning
            )
        if self.drawn.skin.target is not None and any(self.drawn.skin.compared):
            with self._page("miss.png") as figure:
                draw_miss(figure, self.drawn, state.positions)

    def _inflation(self, state: Frame) -> None:
        frames = self.run.series.get("pressure", ())
        if not frames:
            return
        states = states_of(frames, state, self.drawn)
        with self._page("inflation.png", self.title) as figure:
            draw_inflation(figure, (0.01, 0.01, 0.98, 0.88), self.drawn, states)
        if self.drawn.skin.regions is not None:
            aim = self.drawn.skin.target is not None
            dashed = " (dashed: target, dotted: lines along it)" if aim else ""
            with self._page("hero.png", size=STRIP) as figure:
                draw_hero(figure, self.drawn, states, f"inflate it to {states[-1][0]}{dashed}")

    def _poses(self) -> None:
        frames = self.run.series.get("pose", ())
        if not frames:
            return
        poses = [
            (
                f"pose {frame.number} at {_kilopascal(frame.values['pressure_pa'])}",
                DrawnSkin(self.run.skins[frame.skin]),
                frame.positions,
            )
            for frame in frames
        ]
        with self._page("poses.png", self.title) as figure:
            draw_poses(figure, poses)

    def _pattern(self) -> None:
        folder = self.run.folder
        if (folder / PRINT_FILE).exists():
            stored = read_print_polygons(MPI.COMM_SELF, folder)
            found = printability(stored.pattern, stored.regions, stored.limits)
            with self._page("pattern.png") as figure:
                draw_pattern(figure, stored.pattern, stored.regions, found, stored.limits)

    def _curve(self) -> None:
        at = None if self.state is None else self.state.values.get("pressure_pa")
        curve = self.run.over_pressure(at)
        figures = [told for told in self.figures if curve.rows and told.key in curve.rows[0]]
        if len(curve.rows) < 2 or not figures:
            return
        size = SIZE if len({told.unit for told in figures}) < 3 else TALL
        with self._page("curve.png", self.title, size) as figure:
            draw_curve(figure, curve, figures)

    def _design(self) -> None:
        rows = self.run.history
        if len(rows) < 2:
            return
        frames = [
            (f"iteration {frame.number}", self.run.skins[frame.skin].pattern, frame.density)
            for frame in _some(self.run.series.get("iteration", ()))
            if frame.density is not None
        ]
        regions = None if self.state is None else self.drawn.skin.regions
        told = next((f for f in self.figures if f.key in rows[-1]), None)
        title = f"Designed in {int(rows[-1]['iteration'])} iterations"
        with self._page("design.png", title, TALL) as figure:
            width = 0.98 / max(len(frames) + (regions is not None), 1)

            def place(k: int, name: str) -> Box:
                left, wide = 0.01 + k * width, 0.95 * width
                figure.text(left + wide / 2, BOTTOM + HEIGHT + 0.02, name, ha="center", color=SOFT)
                return left, BOTTOM, wide, HEIGHT

            for k, (name, pattern, density) in enumerate(frames):
                draw_density(figure, place(k, name), pattern, density).set_anchor("N")
            if regions is not None:
                box = place(len(frames), "print")
                axes, _ = draw_panels(figure, box, self.drawn.pattern, regions, names=False)
                axes.set_anchor("N")
            draw_history(figure.add_axes((0.10, 0.09, 0.78, 0.26)), rows, told)


def _state(run: Run) -> Frame | None:
    """Return the print at its pressure, else the design as far as it is; None without shapes."""
    if made := read_frames(run.folder / FOLDER, "print"):
        return made[-1]
    if frames := run.series.get("pressure"):
        pressure = run.summary.value("pressure_pa") or frames[-1].values["pressure_pa"]
        return min(frames, key=lambda frame: abs(frame.values["pressure_pa"] - pressure))
    frames = run.series.get("iteration")
    return frames[-1] if frames else None


def told_figures(run: Run) -> list[Figure]:
    """Return the figures that pictures tell: those with a target, else the run's own.

    Those of a shape are told by shape.png alone.
    """
    figures = [told for told in run.summary.figures.values() if not is_of_shape(told)]
    asked = [told for told in figures if told.target is not None]
    return asked or [told for told in figures if told.name not in OF_THE_STATE]


def facts_of(run: Run) -> dict[str, str]:
    """Return what pictures of a run tell of themselves: run, seed and figures."""
    inputs: Any = run.summary.entries.get("inputs") or {}
    seed = inputs.get("seed", (inputs.get("design") or {}).get("seed"))
    # The tables of figures know no tolerances.
    words = (replace(figure, tolerance=None).words for figure in told_figures(run))
    facts = {"Title": run.name, "Description": ", ".join(words)}
    return facts if seed is None else {**facts, "Comment": f"seed {seed}"}


def sentence(figures: Sequence[Figure], pressure: float | None) -> str:
    """Return figures and pressure, in Pa, as a title."""
    told = []
    for figure in figures[:3]:
        of = "" if figure.target is None else f" (target {formatted(figure.target, figure.unit)})"
        told.append(f"{figure.name.replace('_', ' ')} {figure.shown}{of}")
    found = ", ".join(told)
    found = found[:1].upper() + found[1:]
    if pressure is None:
        return found
    return f"{found} at {pressure / 1e3:.3g} kPa" if found else f"At {pressure / 1e3:.3g} kPa"


def states_of(frames: Sequence[Frame], state: Frame, drawn: DrawnSkin) -> list[tuple[str, Floats]]:
    """Return rest, frames at about equal parts of the way to the design's state, and that one.

    The way goes through all frames: many skins turn away from their target first.
    """
    pressure, rest = state.values.get("pressure_pa", 0.0), drawn.pattern.points
    below = sorted(
        (f for f in frames if 0 < f.values["pressure_pa"] < 0.99 * pressure),
        key=lambda frame: frame.values["pressure_pa"],
    )
    passed = [rest, *(frame.positions for frame in below), state.positions]
    moved = np.cumsum([np.linalg.norm(b - a) for a, b in pairwise(passed)])
    way, chosen = moved[-1], set[int]()
    for part in BETWEEN if below else ():
        nearest = int(np.abs(moved[:-1] - part * way).argmin())
        if abs(moved[nearest] - part * way) < NEAR * way:
            chosen.add(nearest)
    shown = [
        (_kilopascal(below[k].values["pressure_pa"]), below[k].positions) for k in sorted(chosen)
    ]
    return [("at rest", rest), *shown, (_kilopascal(pressure), state.positions)]


def _kilopascal(pressure: float) -> str:
    return f"{pressure / 1e3:.{2 if pressure < 1e4 else 3}g} kPa"


def _some(frames: Sequence[Frame]) -> list[Frame]:
    """Return the frames nearest to `ITERATIONS`, and the last one."""
    if not frames:
        return []
    numbers = np.array([frame.number for frame in frames])
    chosen = {int(np.abs(numbers - number).argmin()) for number in ITERATIONS}
    return [frames[k] for k in sorted(chosen | {len(frames) - 1})]
