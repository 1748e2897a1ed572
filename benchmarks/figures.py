"""Figures of all demos: each scene once more, as its command makes it.

    python -m benchmarks figures --rows output/figures.csv
    python -m benchmarks figures --rows output/figures.csv --page

Every figure of README, demos/README.md and the gallery comes from these rows: value and interval of
each figure that the summary of a run tells, its target, and whether the target is reached. A run
takes up to ten minutes on one core; `--only coarse` takes the coarse scenes alone. Prints of some
coarse runs are simulated on finer meshes too. Times are CPU times, since other runs may be beside.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any

from mpi4py import MPI

from benchmarks.bench import ROOT, Case, Command, Row, Rows, Table, markdown
from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene
from toros_fem.making.printability import read_print_polygons
from toros_fem.measures.figures import NONE, Figure, State, formatted, overall, split_key
from toros_fem.products.actuators.estimates import Job, SimulatedPrint, simulated_on
from toros_fem.results.reporter import duration
from toros_fem.results.runs.stored_run import Summary, summary_of

SIZES = ("coarse", "full")
# Folder of all runs.
RUNS = ROOT / "output" / "figures"
# Pictures of the coarse runs, from the top of a checkout.
PICTURES, GALLERY = "demos/pictures", "docs/gallery/index.md"
# Pictures beside each other.
ACROSS = 3
# Entries of summaries beside their figures; dots go down into them.
DESIGN, ISLANDS = "design.", "manufacture.islands"
INITIAL, WORST = "load.initial.held_mass_kg", "worst_percent"


@dataclass(frozen=True)
class Demo:
    """A scene of a demo in the tables.

    Attributes:
        scene: Name of its file.
        paper: What the paper asks for or shows, with its pressure.
        keys: Figures in the tables, by their keys.
        changes: Keys of the scene that differ, as after `--set`.
    """

    scene: str
    paper: str
    keys: Sequence[str]
    changes: Sequence[str] = ()

    @property
    def name(self) -> str:
        """Name of the scene and its changes."""
        return " ".join((self.scene, *self.changes))

    @property
    def command(self) -> str:
        """Command of `toros` that runs it."""
        return "simulate" if self.scene == "inflate" else "design"


LEGS, GRIP = ("angle_deg", "stride_mm"), ("gap_mm", "angle_deg", "held_mass_kg", INITIAL)
STIFF = ("stiffness_at_0_deg_n_per_m", "stiffness_at_90_deg_n_per_m")
SHAPE = ("shape_distance_percent", "tip_direction_deg")
DEMOS = (
    Demo("inflate", "Fig. 8a: swells, lengthens, saturates above about 10 kPa", (
        "radius_percent", "length_percent",
        "radius_when_saturated_percent", "length_when_saturated_percent",
    )),
    Demo("bend", "Fig. 8b: 180° (5 kPa)", ("angle_deg", *SHAPE)),
    Demo("contract", "Fig. 8c: 8 % (10 kPa)", ("shortening_percent", *SHAPE)),
    Demo("twist", "Fig. 8d: 300° (15 kPa)", ("twist_deg", "length_ratio", *SHAPE)),
    Demo("twist", "", ("twist_deg", "length_ratio", *SHAPE), ("keep_length=true",)),
    Demo("bend_twist", "our own combination", ("angle_deg", "twist_deg", *SHAPE)),
    Demo("walker", "Fig. 9: legs by 90° (20 kPa)", LEGS),
    Demo("walker", "Fig. 10: crawls", LEGS, ("motion=crawl",)),
    Demo("gripper", "Fig. 1: grips", GRIP),
    Demo("gripper", "", GRIP, ("shape=box",)),
    Demo("tile", "Fig. 7: 10 % of strain", (WORST,)),
    Demo("tile", "Fig. 7", (WORST,), ("target=orthotropic",)),
    Demo("tile", "Fig. 7", (WORST,), ("target=isotropic",)),
    Demo("tile", "Fig. 7", STIFF, ("target=anisotropic",)),
    Demo("tile", "Fig. 7", ("contraction_at_0_deg_fraction",), ("target=auxetic",)),
    Demo("own_design", "", ("angle_deg", *SHAPE)),
)  # fmt: skip


# Prints of coarse runs that are simulated on finer meshes: the key of their edges, and these in m.
CHECKED = {
    "walker": ("edge_length", (1.8e-3, 1.2e-3)),
    "walker motion=crawl": ("edge_length", (1.8e-3, 1.2e-3)),
    "gripper": ("edge_length", (1.2e-3,)),
    "gripper shape=box": ("edge_length", (1.2e-3,)),
}
# Scenes with a trial: it is repeated on the first finer mesh.
TRIED = ("walker", "gripper")
FINER = "edges of {:.3g} mm"


def folder_of(demo: Demo, size: str) -> Path:
    """Return the folder of a run, which is kept: its pictures are those of the docs."""
    return RUNS / size / demo.name.replace(" ", "_").replace("=", "_")


def summary_after(words: Sequence[str], changes: Sequence[str], folder: Path) -> Summary:
    """Run a command of `toros` with changed keys into a new folder, and return its summary."""
    shutil.rmtree(folder, ignore_errors=True)
    changed = [word for one in changes for word in ("--set", one)]
    if code := run(MPI.COMM_SELF, [*words, *changed, "--output", str(folder), "--overwrite"]):
        raise RuntimeError(f"toros {words[0]} {Path(words[1]).name} ended with {code}")
    return summary_of(folder)


def rows_of(demo: Demo, size: str) -> Iterator[Row]:
    """Run a scene by its command, and read the figures of its summary."""
    file = ROOT / "demos" / "scenes" / f"{demo.scene}.toml"
    folder = folder_of(demo, size)
    words = [demo.command, str(file), *(["--coarse"] if size == "coarse" else [])]
    begin = time.process_time()
    found = summary_after(words, demo.changes, folder)
    place, seconds = (demo.name, size, ""), time.process_time() - begin
    entries: Any = found.entries
    yield from figure_rows(place, found.figures.values(), seconds)
    # Beside laid lines there is no design by densities.
    designed = {} if entries.get("densities_kept") is False else entries.get("design", {})
    for key, value in designed.items():
        if key in found.figures:
            yield Row(*place, DESIGN + key, value, found.figures[key].unit, None, seconds)
    for key in (ISLANDS, INITIAL, WORST):
        value = reduce(lambda of, name: (of or {}).get(name), key.split("."), entries)
        if value is not None:
            unit = (split_key(key) or ("", ""))[1]
            # The largest deviation of a tile has the state of all its directions.
            told = [one for one in found.figures.values() if one.state is not None]
            note = str(overall(told)) if key == WORST and told else ""
            yield Row(*place, key, float(value), unit, None, seconds, note=note)


def checked_rows(demo: Demo, edge: float) -> Iterator[Row]:
    """Simulate the print of a coarse run, which must be there, on a finer mesh."""
    coarse, place = folder_of(demo, "coarse"), (demo.name, FINER.format(1e3 * edge), "")
    key = CHECKED[demo.name][0]
    changes = [f"{key}={edge}", "levels=1", "curve_steps=1", "check_refinement=none"]
    changes += [f"filter_radius={1.6 * edge}"] if key == "edge_length" else []
    changes += [f"pressure={summary_of(coarse).entries['pressures_pa'][-1]}"]
    words = ["simulate", str(coarse / "scene.toml"), "--pattern", str(coarse)]
    found = summary_after(words, changes, RUNS / "finer" / f"{coarse.name}_{1e6 * edge:.0f}")
    entries: Any = found.entries
    yield from figure_rows(place, found.figures.values(), entries["seconds"]["total"])
    if demo.scene in TRIED and edge == CHECKED[demo.name][1][0]:
        begin = time.perf_counter()
        tried = tried_on(coarse, edge)
        yield from figure_rows(place, tried, time.perf_counter() - begin)


def tried_on(folder: Path, edge: float) -> tuple[Figure, ...]:
    """Return the figures of a trial of a run's print on a mesh with edges in m."""
    comm = MPI.COMM_SELF
    scene: Any = read_scene(folder / "scene.toml", comm=comm).config
    level = scene.finest_level
    pattern, stored = scene.case(comm, level).pattern, read_print_polygons(comm, folder)
    pressures = summary_of(folder).entries["pressures_pa"]
    again = SimulatedPrint((pattern, pattern.points), (stored.pattern, stored.regions), pressures)
    ratio = edge / level.edge_length
    made = simulated_on(Job(comm, scene), level.scaled(ratio), again, ratio)
    found: tuple[Figure, ...] = scene.trial_figures(comm, made)
    return found


def figure_rows(
    place: tuple[str, str, str], figures: Iterable[Figure], seconds: float
) -> Iterator[Row]:
    """Return rows of figures, with intervals and states in their notes."""
    for one in figures:
        width = "" if one.interval is None else f"± {float(one.interval)!r}"
        note = ", ".join(filter(None, (width, one.state)))
        yield Row(*place, one.key, one.value, one.unit, one.target, seconds, note=note)


def cases(quick: bool) -> list[Case]:
    """Return all scenes, coarse, full and checked; a quick selection is one that is coarse."""
    found = [
        Case(demo.name, partial(rows_of, demo, size), size, alone=True)
        for size in (SIZES[:1] if quick else SIZES)
        for demo in (DEMOS[:1] if quick else DEMOS)
    ]
    checked = [] if quick else [demo for demo in DEMOS if demo.name in CHECKED]
    return found + [
        Case(demo.name, partial(checked_rows, demo, edge), FINER.format(1e3 * edge), alone=True)
        for demo in checked
        for edge in CHECKED[demo.name][1]
    ]


def figure_of(row: Row) -> Figure:
    """Return a figure from its row."""
    name, unit = split_key(row.figure) or (row.figure, row.unit)
    width = row.note.partition("±")[2].partition(",")[0]
    return Figure(name, unit, row.value, float(width) if width else None, row.reference)


def state_in(row: Row) -> State | None:
    """Return the state of a figure from its row; None without one."""
    last = row.note.rpartition(", ")[2]
    return None if not last or last.startswith("±") else State(last)


def table(rows: Rows, size: str) -> str:
    """Return the table of all scenes of a size that have rows."""
    head = ("scene", "the paper", "as printed", "states", "as designed", "pressure", "islands")
    lines = []
    for demo in DEMOS:
        own = run_of(demo, rows, size)
        if not own:
            continue
        shown = [figure_of(own[key]) for key in demo.keys if key in own]
        designed = [own[DESIGN + key] for key in demo.keys if DESIGN + key in own]
        told = [state_in(row) for key, row in own.items() if key in demo.keys]
        pressure, islands = own.get("pressure_pa"), own.get(ISLANDS)
        lines.append((
            f"`{demo.name}`", demo.paper, "; ".join(figure.words for figure in shown),
            ", ".join(filter(None, told)) or NONE,
            ", ".join(formatted(row.value, row.unit) for row in designed) or NONE,
            formatted(pressure.value, "pa") if pressure else NONE,
            f"{islands.value:.0f}" if islands else NONE,
        ))  # fmt: skip
    return markdown(head, lines)


def checks(rows: Rows) -> str:
    """Return what coarse runs tell of their prints, beside what finer meshes tell of the same."""
    lines = []
    for demo in DEMOS:
        _, edges = CHECKED.get(demo.name, ("", ()))
        own = {(row.variant, row.figure): row for row in rows if row.case == demo.name}
        for key in demo.keys:
            told = own.get(("coarse", key))
            finer = [(own.get((FINER.format(1e3 * edge), key)), edge) for edge in edges]
            there = [f"{figure_of(row).shown} ({1e3 * e:g} mm)" for row, e in finer if row]
            if told and there:
                lines.append((f"`{demo.name}`", figure_of(told).words, "; ".join(there)))
    return markdown(("scene", "the coarse run", "its print on finer meshes (edges)"), lines)


def times(rows: Rows) -> str:
    """Return how long whole runs of coarse scenes take, from the start to the last summary."""
    plain = [demo for demo in DEMOS if not demo.changes]
    took = {demo.name: time_of(run_of(demo, rows, "coarse").values()) for demo in plain}
    return markdown(("scene", "time"), [(f"`{name}`", time) for name, time in took.items() if time])


def time_of(rows: Iterable[Row]) -> str | None:
    """Return the time of a run from its rows; None where other jobs ran beside it."""
    return next((duration(row.seconds) for row in rows if row.seconds), None)


def run_of(demo: Demo, rows: Rows, size: str) -> dict[str, Row]:
    """Return the rows of a run by their figures."""
    return {row.figure: row for row in rows if (row.case, row.variant) == (demo.name, size)}


def told_of(demo: Demo, rows: Rows, size: str) -> tuple[str, str | None]:
    """Return the first two figures of a run and those that miss, with states; and the time."""
    own, told = run_of(demo, rows, size), []
    for number, row in enumerate(own[key] for key in demo.keys if key in own):
        state = state_in(row)
        if number < 2 or state is State.MISSED:
            told.append(figure_of(row).words + f" ({state})" * bool(state))
    return "; ".join(told), time_of(own.values())


def headline(rows: Rows) -> str:
    """Return pictures of coarse scenes as they are, with figures and time below."""
    cells = []
    for demo in DEMOS:
        told, took = told_of(demo, rows, "coarse")
        told += f". {took}" if took else ""
        if demo.paper and not demo.changes and told:
            picture = next(
                f"{PICTURES}/{name}"
                for name in (f"{demo.scene}_hero.png", f"{demo.scene}.png")
                if (ROOT / PICTURES / name).exists()
            )
            link = f"[![{demo.scene}]({picture})]({GALLERY}#{demo.scene})"
            cells.append((link, f"`{demo.scene}`: {told}"))
    lines = []
    for k in range(0, len(cells), ACROSS):
        part = cells[k : k + ACROSS]
        lines += [[link for link, _ in part], [words for _, words in part]]
    return markdown(lines[0], lines[1:])


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(
        Table("../README.md", "figures", headline),
        Table("../demos/README.md", "figures of the demos", lambda rows: table(rows, "full")),
        Table("../demos/README.md", "figures of coarse demos", lambda rows: table(rows, "coarse")),
        Table("accuracy.md", "prints on finer meshes", checks),
        Table("performance.md", "whole runs", times),
    ),
)
