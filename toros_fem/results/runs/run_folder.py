"""What a run's folder holds, read back."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from toros_fem.base.errors import FileError, OutputError
from toros_fem.base.files import read_bytes, read_json, reading
from toros_fem.results.frames.files import FOLDER, Frame, read_frames
from toros_fem.results.frames.shown_skin import ShownSkin, read_skin
from toros_fem.results.runs.summary_file import Summary, summary_of
from toros_fem.results.runs.warnings import known_use

# Series in the order of the page's sliders.
SERIES = ("pressure", "iteration", "gait", "load")
# Columns of tables that hold no numbers: a sheet of tiles is pulled along x and y.
WORDS = {"direction"}
# Columns of a history that are drawn.
DRAWN = ("iteration", "objective")


class Measured(NamedTuple):
    """A measured value beside a curve: its figure's key, pressure in Pa, value, ours, and who."""

    key: str
    pressure: float
    value: float
    simulated: float | None
    source: str


@dataclass(frozen=True, eq=False)
class StoredCurve:
    """Figures over the pressure.

    Attributes:
        rows: Values by key, "pressure_pa" among them, by rising pressure.
        pressure: Pressure of the design in Pa; None for none.
        broken: Whether it ends for want of an equilibrium, at its lower and upper end.
        finer: Whether figures at the pressure of the design come from a finer mesh.
        tested: Part of the stretch bounds up to which the fabric was tested; None if unknown.
    """

    rows: Sequence[Mapping[str, float]]
    pressure: float | None = None
    measured: Sequence[Measured] = ()
    broken: tuple[bool, bool] = (False, False)
    finer: bool = False
    tested: float | None = None


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
        return StoredCurve(rows, pressure, measured, broken, self.finer, tested)


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
