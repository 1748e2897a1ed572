"""All pictures of a run, drawn from what its folder holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as MplFigure
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.making.print.printability import PRINT as PRINT_FILE
from toros_fem.making.print.printability import printability, read_print_polygons
from toros_fem.measures.figures import Figure, formatted
from toros_fem.measures.miss import is_of_shape
from toros_fem.results.frames import FOLDER, Frame, read_frames, read_skin
from toros_fem.results.pictures.curves import draw_curve, draw_history
from toros_fem.results.pictures.flat import draw_density, draw_panels, draw_pattern
from toros_fem.results.pictures.inflation import draw_hero, draw_inflation
from toros_fem.results.pictures.shapes import draw_miss, draw_shape
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.style import SIZE, SOFT, STRIP, TALL, Box, page
from toros_fem.results.stored_run import Run, read_run

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


def draw_run(folder: str | Path) -> list[Path]:
    """Draw the pictures of a run into its folder, and return their paths (one rank).

    They are, as far as the run has what they show: shape.png, miss.png, inflation.png, pattern.png,
    curve.png, design.png and hero.png. Errors are those of `read_run` and `page`.
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
