"""Tolerances of a finished run, from what its folder holds, and their files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from textwrap import fill

from mpi4py import MPI

from toros_fem.base.errors import FileError, NoEquilibriumError
from toros_fem.base.files import guarded, if_plotting, write_json, write_table
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats
from toros_fem.making.printability import case_of_print, read_print_polygons
from toros_fem.meshes.files import PATTERN_FILE, read_pattern
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.common.options import ToleranceConfig
from toros_fem.products.tolerance import ToleranceResult, Variant, simulated_tolerances
from toros_fem.results.runs.frames import FOLDER, read_frames, read_skin
from toros_fem.results.runs.stored_run import SUMMARY, Summary, summary_of

FILES = ("tolerance.json", "tolerance.csv", "tolerance.png")
LESS = "#7FA6C9"
# Numbers below all charts, and letters of their names in a line, at most.
TICKS, LETTERS = 12, 80


def tolerances_of_run(
    comm: MPI.Comm,
    run: Path | str,
    scene: ActuatorScene,
    files: Mapping[str, Path],
    config: ToleranceConfig | None = None,
) -> ToleranceResult:
    """Return how a finished design moves if it is not made as drawn (collective).

    The simulation starts from the shape of the print that the run has stored. The files are those
    that the design has taken, by name. None takes the default tolerances.

    Raises:
        FileError: The folder holds no finished design of an actuator.
        NoEquilibriumError: The print has no equilibrium.
        TorosError: A file cannot be read, or does not fit.
    """
    folder = Path(run)
    summary = printed_summary(comm, folder)
    scene = scene.with_files(comm, files)
    level = scene.level_of_print
    case = scene.case(comm, level)
    stored = read_print_polygons(comm, folder)
    fine = case_of_print(comm, case, stored.pattern, stored.regions)
    near = on_first_rank(comm, lambda: _shape(folder))
    problem = scene.problem(comm, fine, level)

    values = {m.key: summary.own_value(m.key) for m in case.judged}
    return simulated_tolerances(
        problem,
        config,
        whole=(stored.pattern, stored.regions),
        limits=stored.limits,
        near=near,
        pressures=summary.entries["pressures_pa"],
        own_mesh={key: value for key, value in values.items() if value is not None},
    )


def printed_summary(comm: MPI.Comm, folder: Path) -> Summary:
    """Return the summary of a finished design whose print has an equilibrium (collective).

    Raises:
        FileError: The folder holds no finished design.
        NoEquilibriumError: The print has no equilibrium.
    """
    summary = on_first_rank(comm, lambda: finished_summary(folder))
    if failure := summary.entries["printed_failure"]:
        raise NoEquilibriumError(f"the print has no equilibrium: {failure}")
    return summary


def finished_summary(folder: Path) -> Summary:
    """Return the summary of a finished design (one rank).

    Raises:
        FileError: The folder holds none.
    """
    found = summary_of(folder)
    if "printed_failure" not in found.entries:
        what = "has no print" if found else "is missing"
        raise FileError(f"{folder / SUMMARY} {what}: give the folder of a finished design.")
    return found


def _shape(folder: Path) -> tuple[Pattern, Floats] | None:
    """Return the pattern that was designed and the shape of its print; None if none is stored."""
    frames = read_frames(folder / FOLDER, "print")
    if not frames:
        return None
    part = read_pattern(MPI.COMM_SELF, folder / PATTERN_FILE)
    whole = read_skin(folder / FOLDER / frames[-1].skin).pattern
    positions = part.points.copy()
    # The triangles of a part are the first of the whole.
    positions[part.triangles] = frames[-1].positions[whole.triangles[: len(part.panel)]]
    return part, positions


def write_tolerances(comm: MPI.Comm, folder: Path | str, found: ToleranceResult) -> None:
    """Write tolerance.json, tolerance.csv and tolerance.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / FILES[0], found.summary())
        write_table(folder / FILES[1], found.rows())
        if_plotting(lambda: plot_tolerances(folder / FILES[2], found))

    guarded(comm, folder, write)


def by_size(found: ToleranceResult) -> list[list[Variant]]:
    """Return the variants of each quantity and amount, those that move the first metric most last.

    A variant without an equilibrium counts as the largest.
    """

    def what(variant: Variant) -> tuple[str, str]:
        return variant.quantity, variant.amount

    def size(pair: list[Variant]) -> float:
        changes = [found.change(v, found.metrics[0].key) for v in pair]
        return max(math.inf if change is None else abs(change) for change in changes)

    pairs = [list(pair) for _, pair in groupby(sorted(found.variants, key=what), what)]
    return sorted(pairs, key=size)


def plot_tolerances(path: Path, found: ToleranceResult) -> None:
    """Write a picture of how each metric moves, a bar for each variant (one rank)."""
    from toros_fem.results.pictures.style import (
        ACCENT,
        DARK,
        INK,
        LINE,
        note,
        page,
        space_numbers,
        title_lines,
    )

    pairs = by_size(found)
    bars = [(k, v) for k, pair in enumerate(pairs) for v in pair]
    names = [fill(metric.label, LETTERS // len(found.metrics)) for metric in found.metrics]
    below = 0.38 + 0.15 * max(name.count("\n") + 1 for name in names)
    title = next(iter(found.worst_sentences), "What a skin does that is not made as drawn")
    title = title.rstrip(".")
    head = LINE * (title_lines(title, 8.0).count("\n") + 1)
    height = 0.92 + head + below + 0.34 * len(pairs)
    top = 1 - (head + 0.65) / height
    where = {"left": 0.24, "right": 0.97, "bottom": below / height, "top": top}
    with page(path, title, (8.0, height)) as figure:
        grid = figure.subplots(
            1, len(found.metrics), sharey=True, squeeze=False, gridspec_kw={**where, "wspace": 0.12}
        )
        for axes, metric, name in zip(grid[0], found.metrics, names, strict=True):
            key, nominal = metric.key, found.nominal[metric.key]
            for row, variant in bars:
                change = found.change(variant, key)
                if change is None:
                    axes.plot(nominal, row, color=ACCENT, marker="x", ls="", ms=9, mew=2)
                else:
                    colour = LESS if variant.change < 0 else DARK
                    axes.barh(row, change, left=nominal, height=0.62, color=colour)
            axes.axvline(nominal, color=INK, lw=0.8)
            if metric.target is not None:
                axes.axvline(metric.target, color=ACCENT, linestyle="--", lw=1)
                above = ("data", "axes fraction")
                note(axes, "target", (metric.target, 1), (3, 2), ACCENT, xycoords=above)
            axes.set_xlabel(name)
            axes.grid(axis="x")
        rows = [f"{pair[0].quantity} ± {pair[0].amount}" for pair in pairs]
        grid[0, 0].set_yticks(range(len(pairs)), rows)
        words = [("■ less than drawn", LESS), ("■ more than drawn", DARK)]
        if any(not variant.values for variant in found.variants):
            words.append(("× no equilibrium", ACCENT))
        for k, (text, colour) in enumerate(words):
            figure.text(0.02 + 0.22 * k, 1 - (head + 0.32) / height, text, color=colour)
        space_numbers(figure, grid[0], TICKS // len(found.metrics))
