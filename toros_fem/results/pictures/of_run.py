"""All pictures of a run, drawn from what its folder holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.making.print.print_file import NAME as PRINT_FILE
from toros_fem.making.print.print_file import read_print_polygons
from toros_fem.making.print.printability import printability
from toros_fem.measures.figures import Figure, formatted
from toros_fem.results.frames.files import FOLDER, Frame, read_frames
from toros_fem.results.frames.shown_skin import read_skin
from toros_fem.results.pictures.curves import Measured, plot_curve
from toros_fem.results.pictures.flat import plot_pattern
from toros_fem.results.pictures.inflation import plot_hero, plot_inflation
from toros_fem.results.pictures.progress import plot_progress
from toros_fem.results.pictures.shapes import plot_miss, plot_shape
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.report.run_folder import Run, read_run

# Figures that every run has, told where it has no others.
OF_THE_STATE = ("pressure", "volume", "stretch")
# Parts of the way from rest to the design's state that are shown between them.
BETWEEN = (0.25, 0.5, 0.75)
# Iterations that are shown, besides the last one.
ITERATIONS = (1, 5, 20)


def draw_run(folder: str | Path) -> list[Path]:
    """Draw the pictures of a run into its folder, and return their paths (one rank).

    They are, as far as the run has what they show: shape.png, miss.png, inflation.png, pattern.png,
    curve.png, design.png and hero.png.

    Args:
        folder: Folder of the run.

    Raises:
        OutputError: The folder holds no run, or a file cannot be read.
        OSError: A picture cannot be written.
    """
    return _Pictures(read_run(folder)).draw()


class _Pictures:
    """The pictures of one run."""

    def __init__(self, run: Run) -> None:
        self.run, self.folder = run, run.folder
        made = read_frames(run.folder / FOLDER, "print")
        frames = made or run.series.get("pressure", ()) or run.series.get("iteration", ())
        self.state: Frame | None = frames[-1] if frames else None
        self.figures = told_figures(run)
        self.facts = facts_of(run)
        if self.state is not None:
            skin = read_skin(run.folder / FOLDER / self.state.skin)
            self.drawn = DrawnSkin(skin, self.state.density)

    def draw(self) -> list[Path]:
        found = []
        if self.state is not None:
            found += self._shape(self.state)
            found += self._inflation(self.state)
        found += self._pattern()
        found += self._curve()
        found += self._design()
        return found

    def _shape(self, state: Frame) -> list[Path]:
        path = self.folder / "shape.png"
        failed = self.run.summary.entries.get("printed_failure")
        warning = "The print has no equilibrium: this is the design." if failed else state.note
        plot_shape(path, self.drawn, state.positions, self.title, self.figures, self.facts, warning)
        if self.drawn.skin.target is None or not any(self.drawn.skin.compared):
            return [path]
        miss = self.folder / "miss.png"
        plot_miss(miss, self.drawn, state.positions, self.facts)
        return [path, miss]

    def _inflation(self, state: Frame) -> list[Path]:
        states = self.states(state)
        if len(states) < 3:
            return []
        path, hero = self.folder / "inflation.png", self.folder / "hero.png"
        plot_inflation(path, self.drawn, states, self.title, self.facts)
        if self.drawn.skin.regions is None:
            return [path]
        told = ", ".join(f"{f.name.replace('_', ' ')} {f.shown}" for f in self.figures[:2])
        dashed = " (dashed: target)" if self.drawn.skin.target is not None else ""
        does = f"inflate it to {states[-1][0]}: {told}{dashed}"
        plot_hero(hero, self.drawn, states, does, self.facts)
        return [path, hero]

    def _pattern(self) -> list[Path]:
        if not (self.folder / PRINT_FILE).exists():
            return []
        path, stored = self.folder / "pattern.png", read_print_polygons(MPI.COMM_SELF, self.folder)
        found = printability(stored.pattern, stored.regions, stored.limits)
        plot_pattern(path, stored.pattern, stored.regions, found, stored.limits, self.facts)
        return [path]

    def _curve(self) -> list[Path]:
        rows = [row for row in self.run.curve if "pressure_pa" in row]
        figures = [told for told in self.figures if told.key in (rows[0] if rows else {})]
        if len(rows) < 2 or not figures:
            return []
        path, entries = self.folder / "curve.png", self.run.summary.entries.get("curve") or {}
        measured = [
            Measured(m["metric"], m["pressure_pa"], m["measured"], m["simulated"], m["source"])
            for m in entries.get("measured", ())
        ]
        broken = tuple(bool(entries.get(f"failure_{end}")) for end in ("below", "above"))
        at = None if self.state is None else self.state.values.get("pressure_pa")
        plot_curve(
            path, rows, figures, at, self.title, measured, (broken[0], broken[1]), self.facts
        )
        return [path]

    def _design(self) -> list[Path]:
        rows, frames = self.run.history, self.run.series.get("iteration", ())
        if len(rows) < 2:
            return []
        steps = [
            (frame.number, self.run.skins[frame.skin].pattern, frame.density)
            for frame in _some(frames)
            if frame.density is not None
        ]
        printed = None
        if self.state is not None and self.drawn.skin.regions is not None:
            printed = self.drawn.pattern, self.drawn.skin.regions
        path, last = self.folder / "design.png", int(rows[-1]["iteration"])
        told = next((f for f in self.figures if f.key in rows[-1]), None)
        seconds = (self.run.summary.entries.get("seconds") or {}).get("total")
        title = f"Designed in {last} iterations"
        title += "" if seconds is None else f", {seconds:.0f} s"
        plot_progress(path, steps, printed, rows, told, title, self.facts)
        return [path]

    @property
    def title(self) -> str:
        """The result in a sentence."""
        pressure = None if self.state is None else self.state.values.get("pressure_pa")
        return sentence(self.figures, pressure)

    def states(self, state: Frame) -> list[tuple[str, Floats]]:
        """Return rest, some states on the way, and the design's, each with its name."""
        return states_of(self.run.series.get("pressure", ()), state, self.figures, self.drawn)


def told_figures(run: Run) -> list[Figure]:
    """Return the figures that pictures tell: those with a target, else the run's own."""
    figures = list(run.summary.figures.values())
    asked = [told for told in figures if told.target is not None]
    return asked or [told for told in figures if told.name not in OF_THE_STATE]


def facts_of(run: Run) -> dict[str, str]:
    """Return what pictures of a run tell of themselves: run, seed and figures."""
    inputs: Any = run.summary.entries.get("inputs") or {}
    seed = inputs.get("seed", (inputs.get("design") or {}).get("seed"))
    facts = {"Title": run.name, "Description": ", ".join(f.words for f in told_figures(run))}
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


def states_of(
    frames: Sequence[Frame], state: Frame, figures: Sequence[Figure], drawn: DrawnSkin
) -> list[tuple[str, Floats]]:
    """Return rest, frames at about equal steps of the first figure, and the last state.

    Args:
        frames: Frames over the pressure.
        state: The state of the design.
        figures: Figures, the first of which is followed; without one the pressure is.
        drawn: The skin.
    """
    pressure = state.values.get("pressure_pa", 0.0)
    below = [f for f in frames if f.values["pressure_pa"] < 0.99 * pressure]
    key = next((f.key for f in figures if f.key in state.values), "pressure_pa")
    rest = 1.0 if key.endswith("_ratio") else 0.0
    way = state.values[key] - rest if key in state.values else 0.0
    chosen: list[Frame] = []
    for part in BETWEEN:
        if not below or way == 0:
            break
        goal = rest + part * way
        nearest = min(below, key=lambda f: abs(f.values[key] - goal))
        if nearest not in chosen:
            chosen.append(nearest)
    chosen.sort(key=lambda frame: frame.values["pressure_pa"])
    shown = [(f"{f.values['pressure_pa'] / 1e3:.2g} kPa", f.positions) for f in chosen]
    last = (f"{pressure / 1e3:.3g} kPa", state.positions)
    return [("at rest", drawn.pattern.points), *shown, last]


def _some(frames: Sequence[Frame]) -> list[Frame]:
    """Return the frames nearest to `ITERATIONS`, and the last one."""
    if not frames:
        return []
    numbers = np.array([frame.number for frame in frames])
    chosen = {int(np.abs(numbers - number).argmin()) for number in ITERATIONS}
    return [frames[k] for k in sorted(chosen | {len(frames) - 1})]
