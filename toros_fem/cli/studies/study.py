"""A study: one scene with all combinations of some values, side by side, in one table."""

from __future__ import annotations

import itertools
import logging
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError, TorosError
from toros_fem.base.files import guarded, naming, write_table
from toros_fem.base.keys import Key, nearest, plain_value
from toros_fem.cli.command_line.running import inputs_of
from toros_fem.cli.scene_files.layout import FILES, QUICK, keys_of
from toros_fem.cli.scene_files.reading import SceneFile, read_scene
from toros_fem.results.runs.folder import read_record
from toros_fem.results.runs.summary_file import Summary, summary_of

log = logging.getLogger(__name__)
TABLE, PICTURE, LOGS = "study.csv", "study.png", "logs"
# Letters that may stand in the name of a folder.
PLAIN = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,=_+-")
# Environment of a run beside others: each has one core.
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
# Most runs of a study.
MOST = 10_000
_RANGE = re.compile(r"(?P<low>.+?)\.\.(?P<high>.+?)(?::(?P<count>\d+))?")
_NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*(?P<unit>.*?)\s*")


@dataclass
class Trial:
    """One run of a study: its values by key, and what it found.

    Attributes:
        failure: Why there is no result; empty if there is one.
        seconds: Wall time in this study; None for a run that was finished before.
    """

    values: Mapping[str, Any]
    folder: Path
    summary: Summary | None = None
    failure: str = ""
    seconds: float | None = None

    def row(self, columns: Mapping[str, str]) -> dict[str, Any]:
        """Return values, in columns by key, and figures as a row of the table."""
        row = {columns[name]: value for name, value in self.values.items()}
        found = {} if self.summary is None else self.summary.figures
        for key, figure in found.items():
            row[key] = figure.value
            if figure.interval is not None:
                row[f"{figure.name}_error_{figure.unit}"] = figure.interval
            if figure.state is not None:
                row[f"{figure.name}_state"] = str(figure.state)
        return row | {"run": self.folder.name, "failure": self.failure}


@dataclass
class Study:
    """A study, and what it found: its keys, and its runs in the order of the table."""

    keys: Mapping[str, Key]
    trials: Sequence[Trial]
    folder: Path

    @property
    def table(self) -> Path:
        """The table of all runs."""
        return self.folder / TABLE

    @property
    def failed(self) -> list[Trial]:
        """The runs without a result."""
        return [trial for trial in self.trials if trial.failure]

    @property
    def columns(self) -> dict[str, str]:
        """Column of each key that varies; one that a figure has too is ``given_…``."""
        found = {k for trial in self.trials if trial.summary for k in trial.summary.figures}
        plain = {name: column_of(one) for name, one in self.keys.items()}
        return {name: f"given_{of}" if of in found else of for name, of in plain.items()}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The rows of the table."""
        columns = self.columns
        return [trial.row(columns) for trial in self.trials]

    def write_table(self) -> None:
        """Write the rows as they are now."""
        guarded(MPI.COMM_SELF, self.folder, lambda: write_table(self.table, self.rows))

    def write_picture(self) -> None:
        """Draw the figures of the runs."""
        from toros_fem.results.pictures.study import draw_study  # who runs none does not pay

        columns, found = list(self.columns.values()), [one.summary for one in self.trials]
        path, summaries = self.folder / PICTURE, [one for one in found if one is not None]
        guarded(MPI.COMM_SELF, self.folder, lambda: draw_study(path, self.rows, columns, summaries))


def column_of(one: Key) -> str:
    """Return the column of a key: its name, and the unit that ends it."""
    plain = one.kind is float and one.within.unit is not None
    return f"{one.name}_{one.ending}" if plain else one.name


def run_study(
    scene: Path | str,
    over: Mapping[str, Sequence[Any]] | Sequence[str],
    output: Path | str,
    *,
    command: str = "design",
    coarse: bool = False,
    changes: Sequence[str] = (),
    allow_large: bool = False,
    jobs: int | None = None,
) -> Study:
    """Run a scene with all combinations of some values, and put all figures into one table.

    Each run has a folder of its own. Those that are finished stay, those that were stopped go on.

    Args:
        scene: The scene file.
        over: Values by key, or words KEY=VALUES as of `values_of`.
        output: Folder of the study, made if missing: study.csv, study.png, a folder for each run.
        command: "design" or "simulate".
        changes: Texts "KEY=VALUE" that hold for all runs.
        jobs: Runs at a time; None takes one for each core.

    Raises:
        FileError: A value is wrong; before anything runs.
        ParameterError: A key is wrong, or there are too many values.
        OutputError: The folder cannot be written.
    """
    path, folder = Path(scene), Path(output)
    first = read_scene(path, coarse=coarse, changes=changes)
    tables = keys_of(first.kind)
    known = {
        key: one for at in tables if at not in (FILES, QUICK) for key, one in tables[at].items()
    }
    given = over.items() if isinstance(over, Mapping) else (values_of(one, known) for one in over)
    varied: dict[str, Sequence[Any]] = {}
    for name, several in given:
        if name in varied:
            raise ParameterError(f"{name} is given twice. Give all of its values at once.", name)
        if name not in known:
            raise ParameterError(f"unknown key {name!r}; {nearest(name, known)}", name)
        varied[name] = several
    keys, trials, waiting = {name: known[name] for name in varied}, [], []
    options = [*["--coarse"] * coarse, *["--allow-large"] * allow_large]
    for values in combinations(varied):
        own = [*changes, *(f"{name}={keys[name].written(one)}" for name, one in values.items())]
        trial = Trial(values, folder / _name(values))
        trials.append(trial)
        state = _state_of(trial.folder, read_scene(path, coarse=coarse, changes=own), command)
        if state == "finished":
            trial.summary = summary_of(trial.folder)
        elif state == "stopped":
            waiting.append((trial, ["resume", str(trial.folder)]))
        else:
            sets = [word for change in own for word in ("--set", change)]
            line = [command, str(path), *options, *sets, "--output", str(trial.folder)]
            waiting.append((trial, line))
    study = Study(keys, trials, folder)
    _run_all(study, waiting, jobs or os.cpu_count() or 1)
    study.write_picture()
    return study


def _run_all(study: Study, waiting: Sequence[tuple[Trial, list[str]]], jobs: int) -> None:
    """Run what waits, so many at a time, and write the table after each."""
    running: set[subprocess.Popen[bytes]] = set()
    begin, done, count = time.perf_counter(), 0, len(study.trials)
    before = count - len(waiting)
    study.write_table()
    with naming(study.folder):
        (study.folder / LOGS).mkdir(exist_ok=True)
    if before:
        log.info("%d of %d runs are finished already", before, count)
    with ThreadPoolExecutor(jobs) as pool:
        alone = ALONE if jobs > 1 else {}
        found = {pool.submit(_run, *one, running, alone): one[0] for one in waiting}
        try:
            for future in as_completed(found):
                trial = future.result()
                done += 1
                study.write_table()
                left = (time.perf_counter() - begin) / done * (len(waiting) - done)
                told = trial.failure or _told(trial)
                log.info(
                    "%d of %d: %s: %s; %.0f s, about %.1f min left",
                    before + done, count, trial.folder.name, told, trial.seconds or 0.0, left / 60,
                )  # fmt: skip
        except BaseException:  # Ctrl-C: runs write their state and can go on
            for future in found:
                future.cancel()
            for process in list(running):
                process.terminate()
            raise


def _run(
    trial: Trial, words: list[str], running: set[subprocess.Popen[bytes]], alone: Mapping[str, str]
) -> Trial:
    """Run one scene in a process of its own."""
    begin = time.perf_counter()
    kept = trial.folder.parent / LOGS / f"{trial.folder.name}.txt"
    with kept.open("wb") as file:
        line = [sys.executable, "-m", "toros_fem", *words, "--quiet"]
        file.write((shlex.join(line) + "\n").encode())
        file.flush()
        process = subprocess.Popen(
            line, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            env={**os.environ, **alone},
        )  # fmt: skip
        running.add(process)
        code = process.wait()
        running.discard(process)
    trial.seconds = time.perf_counter() - begin
    try:
        trial.summary = summary_of(trial.folder) if code == 0 else None
    except TorosError as caught:
        trial.failure = str(caught)
    if code != 0:
        last = kept.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1]
        trial.failure = f"exit code {code}: {last}"
    return trial


def _told(trial: Trial) -> str:
    figures = () if trial.summary is None else trial.summary.figures.values()
    return ", ".join(f"{one.label} {one.shown}" for one in figures if one.interval is not None)


def _state_of(folder: Path, scene: SceneFile, command: str) -> str:
    """Return whether a folder holds this very run: "finished", "stopped", or "none"."""
    try:
        record, _ = read_record(MPI.COMM_SELF, folder)
    except TorosError:
        return "none"
    if record.inputs != inputs_of(scene, command):
        return "none"
    return "finished" if record.finished else "stopped"


def _name(values: Mapping[str, Any]) -> str:
    def shown(value: Any) -> str:
        if isinstance(value, float):
            return f"{value:.12g}"
        return value if isinstance(value, str) else str(value).lower()

    text = ",".join(f"{name}={shown(value)}" for name, value in values.items())
    return "".join(letter if letter in PLAIN else "_" for letter in text)


def values_of(words: str, keys: Mapping[str, Key]) -> tuple[str, list[object]]:
    """Return a key and its values from KEY=VALUES.

    VALUES is a list with commas, as in "1,2,5"; LOW..HIGH:COUNT for so many even steps, or
    LOW..HIGH for all whole numbers between. The unit of the last number is that of both.

    Raises:
        ParameterError: The key is unknown, or a value is wrong.
    """
    name, equals, text = (part.strip() for part in words.partition("="))
    name = name.rpartition(".")[2]
    if not equals or not text:
        raise ParameterError(f"{words!r}: write KEY=VALUES, pressure=2..10kPa:5 for instance.")
    if name not in keys:
        raise ParameterError(f"{words!r}: unknown key {name!r}; {nearest(name, keys)}", name)
    one, found = keys[name], _RANGE.fullmatch(text)
    if found is None:
        return name, [one.read(plain_value(part)) for part in text.split(",")]
    low, high, count = found["low"], found["high"], found["count"]
    unit, own = (_NUMBER.fullmatch(end) for end in (high, low))
    if unit is not None and own is not None and not own["unit"]:
        low += unit["unit"]
    ends = [one.read(plain_value(end)) for end in (low, high)]
    if not all(isinstance(end, int | float) and not isinstance(end, bool) for end in ends):
        raise ParameterError(f"{words!r}: a range needs numbers. Give a list with commas.", name)
    if one.kind is int and count is None:
        return name, _distinct(words, name, list(range(ends[0], ends[1] + 1)))
    if count is None or int(count) < 2:
        raise ParameterError(
            f"{words!r}: say how many values, at least 2, as in {name}={low}..{high}:5.", name
        )
    if int(count) > MOST:
        raise ParameterError(f"{words!r}: {count} values are more than {MOST}.", name)
    steps = [one.kind(step) for step in np.linspace(float(ends[0]), float(ends[1]), int(count))]
    return name, _distinct(words, name, steps)


def combinations(over: Mapping[str, Sequence[object]]) -> list[dict[str, object]]:
    """Return all combinations of the values of keys, the last key first to change.

    Raises:
        ParameterError: There are too many.
    """
    count = int(np.prod([len(values) for values in over.values()], dtype=float))
    if count > MOST:
        raise ParameterError(f"{count} combinations are more than {MOST}. Give fewer values.")
    return [dict(zip(over, values, strict=True)) for values in itertools.product(*over.values())]


def _distinct(words: str, name: str, values: list[object]) -> list[object]:
    if len(set(values)) != len(values) or not values:
        raise ParameterError(f"{words!r}: its values are not different, or there is none.", name)
    return values
