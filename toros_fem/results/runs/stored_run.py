"""What the folder of a run holds: its files, its summary, what it warns of, frames and curves."""

from __future__ import annotations

import csv
import logging
import math
import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from html import escape
from importlib import resources
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from toros_fem.base.errors import FileError, OutputError
from toros_fem.base.files import read_bytes, read_json, reading
from toros_fem.base.validation import is_number
from toros_fem.measures.figures import NONE, Figure
from toros_fem.results.runs.frames import FOLDER, Frame, ShownSkin, read_frames, read_skin

# Folder of the state inside that of a run, its record, the text of the scene, and the figures;
# folder of the machine files.
MADE = "manufacture"
STATE, RECORD, SCENE, SUMMARY = "state", "run.json", "scene.toml", "summary.json"
_TABLE = resources.files("toros_fem.results").joinpath("files.csv").read_text(encoding="utf-8")
# Names of the files in the folders of a run, but for those that a manifest lists.
_INSIDE = {
    "frames": re.compile(r"(skin-[0-9a-f]{12}|[a-z]+(-\d+)?-\d{6})\.npz"),
    STATE: re.compile(r"run\.json|([\w-]+\.)*\d{3}\.npz"),
}
# What faults of a print end in, as sentences.
FAULTS = {
    "islands": (
        "island of the print hangs on",
        "islands of the print hang on",
        "nothing but the fabric",
    ),
    "narrow_places": (
        "place is narrower than",
        "places are narrower than",
        "the printer's least line",
    ),
    "tight_places": ("gap is narrower than", "gaps are narrower than", "the printer's least gap"),
}
# Pressures that a warning names at most.
MOST_NAMED = 6
# Part of the tested strain by which a skin may stretch further without a warning.
BEYOND = 0.02
# Series in the order of the page's sliders.
SERIES = ("pressure", "pose", "iteration", "gait", "load")
# Columns of tables that hold no numbers: a sheet of tiles is pulled along x and y.
WORDS = {"direction"}
# Columns of a history that are drawn.
DRAWN = ("iteration", "objective")
# What each file holds, in the order of lists; of a folder what is in it, or the file to open.
FILES: Mapping[str, str] = {
    row["file"]: row["what it holds"] for row in csv.DictReader(_TABLE.splitlines())
}


def files_of_run(folder: Path) -> list[Path]:
    """Return the files of a run that are in its folder, its record the last (one rank).

    They are those that the table names, and in the folders of a run those of its names; machine
    files as they were made. A link counts as a file, and is never followed.

    Raises:
        OutputError: A folder of a run is a link.
        FileError: A machine file was changed since it was made.
    """
    from toros_fem.making.machine_files import made_before  # who only reads names pays nothing

    require_no_link(folder)
    found = [folder / name for name in FILES if "/" not in name]
    for name, pattern in _INSIDE.items():
        inside = folder / name
        names = sorted(os.listdir(inside)) if inside.is_dir() else []
        found += [inside / one for one in names if pattern.fullmatch(one)]
    found += made_before(folder / MADE)
    record = folder / STATE / RECORD
    there = [path for path in found if _is_file(path) and path != record]
    return [*there, record] if _is_file(record) else there


def require_no_link(folder: Path) -> None:
    """Check that no folder of a run is a link, through which files would be written elsewhere."""
    for name in (*_INSIDE, MADE):
        if (folder / name).is_symlink():
            raise OutputError(
                f"{folder / name} is a link, through which files would be written elsewhere. "
                "Remove the link, or choose another folder; nothing was done to it."
            )


def _is_file(path: Path) -> bool:
    return path.is_symlink() or path.is_file()


class WarningList(logging.Handler):
    """Keeps what the package warns of while it is a handler of the package's logger."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the text of a record, which a summary holds as a sentence."""
        self.texts.append(as_sentence(record.getMessage()))


def as_sentence(text: str) -> str:
    """Return a text with a full stop, and without the mark of a warning of Python."""
    text = text.removeprefix("warning: ").strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def notes_at(notes: Iterable[tuple[float, str]]) -> list[str]:
    """Return notes on equilibria, each with the pressures in Pa that it was made at."""
    at: dict[str, list[float]] = {}
    for pressure, note in notes:
        if note:
            at.setdefault(note, []).append(pressure)
    found = []
    for note, pressures in at.items():
        told = ", ".join(f"{pressure / 1e3:.4g} kPa" for pressure in pressures[:MOST_NAMED])
        found.append(f"At {told}{', …' * (len(pressures) > MOST_NAMED)}: {note}")
    return found


def warnings_of(content: Mapping[str, Any]) -> list[str]:
    """Return what the content of a summary gives reason to warn of, as sentences."""
    made, curve = (content.get(key) or {} for key in ("manufacture", "curve"))
    lift = (content.get("load") or {}).get("printed") or {}
    found = [
        as_sentence(f"{what}: {reason}")
        for what, reason in (
            ("The print has no equilibrium", content.get("printed_failure")),
            ("The lift ends early", lift.get("failure")),
            ("The discretisation error is unknown", (content.get("errors") or {}).get("failure")),
            ("The curve ends before lower pressures", curve.get("failure_below")),
            ("The curve ends before higher pressures", curve.get("failure_above")),
        )
        if reason
    ]
    for key, (one, many, than) in FAULTS.items():
        if number := made.get(key):
            found.append(f"{number} {one if number == 1 else many} {than}.")
    if beyond := beyond_tests(content):
        found.append(beyond)
    return found


def beyond_tests(content: Mapping[str, Any]) -> str:
    """Return that a fabric stretches further than it was tested; empty if not, or not known."""
    known, figures = known_use(content), content.get("figures") or ()
    used = next((row["value"] for row in figures if row["name"] == "stretch"), None)
    if known is None or used is None:
        return ""
    used = max(used, *(of["stretch_use"] for of in (content.get("poses") or {}).values()), 0.0)
    if used <= (1 + BEYOND) * known:
        return ""
    most, tested = (1 + use * (content["inputs"]["c1"] - 1) for use in (used, known))
    return (
        f"The skin stretches up to about {most:.3g}, and the fabric was tested up to {tested:.3g}: "
        "what is told beyond is eq. (1) and no test. Test the fabric further (toros fit), or take "
        "less pressure."
    )


def known_use(content: Mapping[str, Any]) -> float | None:
    """Return the part of the stretch bounds up to which the fabric was tested; None if unknown."""
    inputs = content.get("inputs") or {}
    tested, bound = inputs.get("tested_stretch"), inputs.get("c1")
    return None if tested is None or bound is None else (tested - 1) / (bound - 1)


@dataclass(frozen=True)
class Summary:
    """What summary.json of a run holds: figures by their keys, as "angle_deg", further entries.

    It is empty for a run that was stopped.
    """

    figures: Mapping[str, Figure]
    entries: Mapping[str, Any]

    def __bool__(self) -> bool:
        """Whether there is one."""
        return bool(self.figures or self.entries)

    def value(self, key: str) -> float | None:
        """Return the value of a figure; None if there is no such figure, or no equilibrium."""
        return self.figures[key].value if key in self.figures else None

    @property
    def meshes(self) -> dict[float, Mapping[str, float]]:
        """Values of metrics on each mesh, by its edge length over that of the print's mesh."""
        told = (self.entries.get("errors") or {}).get("meshes") or {}
        return {float(ratio): values for ratio, values in told.items()}

    def own_value(self, key: str) -> float | None:
        """Return a value on the print's mesh, as of `value`; a finer one may tell the figure."""
        return self.meshes.get(1.0, {}).get(key, self.value(key))

    def _repr_html_(self) -> str:
        return figures_html(self.figures.values())


def figures_html(figures: Iterable[Figure]) -> str:
    """Return the table of figures that a notebook shows."""
    rows = [
        (figure.label, figure.shown, figure.asked or NONE, figure.state or "") for figure in figures
    ]
    cells = ("".join(f"<td>{escape(text)}</td>" for text in row) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><tr><th></th><th>value</th><th>target</th><th>state</th></tr>{body}</table>"


def read_content(folder: Path) -> dict[str, Any]:
    """Return what summary.json of a run holds, empty if there is none yet (one rank).

    Raises:
        OutputError: It cannot be read, is none, or is that of an earlier version.
    """
    path = folder / SUMMARY
    content = read_json(path)
    if content and "figures" not in content:
        raise OutputError(
            f'{path} has no list "figures": it was written by an earlier version of toros_fem, '
            "whose runs are not read any more. Run the scene again."
        )
    return content


def _figure(row: Mapping[str, Any]) -> Figure:
    """Return the figure of an entry; a KeyError, TypeError or ValueError says that it is none."""
    known = [one.name for one in fields(Figure) if one.name in row or one.name != "at_least"]
    found = Figure(**{name: row[name] for name in known})
    named = isinstance(found.name, str) and isinstance(found.unit, str)
    widths = (found.interval, found.tolerance)
    numbers = [one for one in (found.value, found.target, *widths) if one is not None]
    finite = all(is_number(one) and isfinite(one) for one in numbers)
    if not named or not finite or any(one is not None and one < 0 for one in widths):
        raise ValueError
    return found


def summary_of(folder: Path) -> Summary:
    """Return the summary of a run, as of `read_content`."""
    content = read_content(folder)
    try:
        rows = content.pop("figures", [])
        found = [_figure(row) for row in rows]
    except (KeyError, TypeError, ValueError):
        path = folder / SUMMARY
        raise OutputError(f'{path}: an entry of "figures" is no figure. Run again.') from None
    return Summary({figure.key: figure for figure in found}, content)


class Measured(NamedTuple):
    """A measured value beside a curve: its figure's key, pressure in Pa, value, ours, and who."""

    key: str
    pressure: float
    value: float
    simulated: float | None
    source: str


class PoseFigure(NamedTuple):
    """The figure of a further pose on a curve: the curve's key, pressure in Pa, and the figure."""

    key: str
    pressure: float
    figure: Figure


@dataclass(frozen=True, eq=False)
class StoredCurve:
    """Figures over the pressure.

    Attributes:
        rows: Values by key, "pressure_pa" among them, by rising pressure.
        pressure: Pressure of the design in Pa; None for none.
        broken: Whether it ends for want of an equilibrium, at its lower and upper end.
        finer: Whether figures at the pressure of the design come from a finer mesh.
        tested: Part of the stretch bounds up to which the fabric was tested; None if unknown.
        poses: Figures of further poses that differ in pressure alone.
    """

    rows: Sequence[Mapping[str, float]]
    pressure: float | None = None
    measured: Sequence[Measured] = ()
    broken: tuple[bool, bool] = (False, False)
    finer: bool = False
    tested: float | None = None
    poses: Sequence[PoseFigure] = ()


@dataclass(frozen=True, eq=False)
class Run:
    """The content of a run's folder; what is missing is empty.

    Attributes:
        summary: Its summary; empty for a run that was stopped.
        history, curve: Rows of history.csv and curve.csv, numbers by column.
        series: Frames by what they follow, in the order of `SERIES`.
        skins: Skins of the frames, by their files' names.
        note: What is not as usual in the print's equilibrium, as sentences.
        tolerance: Content of tolerance.json.
    """

    folder: Path
    summary: Summary
    history: Sequence[Mapping[str, float]]
    curve: Sequence[Mapping[str, float]]
    series: Mapping[str, Sequence[Frame]]
    skins: Mapping[str, ShownSkin]
    note: str
    tolerance: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The folder's own name."""
        return self.folder.resolve().name

    @property
    def finer(self) -> bool:
        """Whether its figures come from a finer mesh than its curve and its shapes over it."""
        return min(self.summary.meshes, default=1.0) < 1

    def over_pressure(self, pressure: float | None) -> StoredCurve:
        """Return its curve with the pressure of the design in Pa, None for none."""
        told = self.summary.entries.get("curve") or {}
        names = ("metric", "pressure_pa", "measured", "simulated", "source")
        measured = [Measured(*map(one.get, names)) for one in told.get("measured") or ()]
        broken = bool(told.get("failure_below")), bool(told.get("failure_above"))
        rows = [row for row in self.curve if math.isfinite(row.get("pressure_pa", math.nan))]
        tested = known_use(self.summary.entries)
        poses = [
            PoseFigure(key, max(of["pressures_pa"]), self.summary.figures[f"{name}_{key}"])
            for name, of in (self.summary.entries.get("poses") or {}).items()
            for key in (rows[0] if rows and of["on_the_curve"] else ())
            if key != "pressure_pa" and f"{name}_{key}" in self.summary.figures
        ]
        return StoredCurve(rows, pressure, measured, broken, self.finer, tested, poses)


def read_run(folder: str | Path) -> Run:
    """Return the content of a run's folder.

    Where there is no curve, the print at the pressure of its design is the series "pressure".
    Steps after the last row of a finished design's history are left out: they led to no better
    print.

    Raises:
        FileError: The folder is missing or holds nothing to show.
        OutputError: A file cannot be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileError(f"{folder} is no folder. Give the folder of a run, its --output.")
    summary, history = summary_of(folder), _read_table(folder / "history.csv", DRAWN)
    frames = folder / FOLDER
    series = {name: read_frames(frames, name) for name in SERIES}
    made = read_frames(frames, "print")
    series["pressure"] = series["pressure"] or made
    if summary and history:
        last = history[-1]["iteration"]
        series["iteration"] = [f for f in series["iteration"] if f.number <= last]
    series = {name: found for name, found in series.items() if found}
    if not series and not history and not summary:
        raise FileError(
            f"{folder} holds neither frames, history.csv nor summary.json, so it is no run or one "
            "that had not begun. Give the folder of a run, its --output."
        )
    names = {frame.skin for found in series.values() for frame in found}
    skins = {name: read_skin(frames / name) for name in sorted(names)}
    note = made[0].note if made else ""
    tolerance = read_json(folder / "tolerance.json")
    curve = _read_table(folder / "curve.csv")
    return Run(folder, summary, history, curve, series, skins, note, tolerance)


def _read_table(path: Path, needed: Collection[str] = ()) -> list[dict[str, float]]:
    """Return the rows of a table, its numbers alone; empty without the file.

    A last line that does not end was cut off by a kill, and is left out.
    """
    if not path.exists():
        return []
    with reading(path, OutputError, "Delete it, or mend it."):
        text = read_bytes(path, "table").decode("utf-8")
        rows = list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))
        for number, row in enumerate(rows, 2):
            whole = None not in row.values() and None not in row
            numbers = [float(row.get(name) or "nan") for name in needed]
            if not whole or not all(map(math.isfinite, numbers)):
                told = " and ".join(("as many cells as the first one", *needed))
                raise ValueError(f"line {number} has not {told}")
        return [{k: float(v) for k, v in row.items() if v != "" and k not in WORDS} for row in rows]
