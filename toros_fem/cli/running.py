"""Runs of scene files in their folders: one, one that goes on, and a study of many."""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, FileError, ParameterError, TorosError
from toros_fem.base.files import guarded, if_plotting, require_unused, write_table
from toros_fem.base.keys import Key, nearest, plain_value
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import program
from toros_fem.cli.command import Answer
from toros_fem.cli.process import UsageError
from toros_fem.cli.scene_files import QUICK, SceneFile, keys_of, read_scene, scene_text
from toros_fem.measures.figures import State
from toros_fem.products.common.plausibility import doubts, warn_of_doubts
from toros_fem.products.kinds import KINDS
from toros_fem.results.report.page_file import write_report
from toros_fem.results.report.tables import as_text
from toros_fem.results.runs.open_run import EVERY, FREE, open_run, read_record
from toros_fem.results.runs.stored_run import (
    RECORD,
    SCENE,
    STATE,
    Summary,
    files_of_run,
    read_content,
    summary_of,
)

log = logging.getLogger(__name__)
# The method of a scene that does what a command asks for, and its table of files that it can take.
_ACTIONS = {
    "design": ("run_design", "DESIGN_FILES"),
    "simulate": ("run_simulation", "SIMULATION_FILES"),
}
TABLE, PICTURE = "study.csv", "study.png"
# Letters that may stand in the name of a folder.
PLAIN = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,=_+-")
# Most runs of a study.
MOST = 10_000
_RANGE = re.compile(r"(?P<low>.+?)\.\.(?P<high>.+?)(?::(?P<count>\d+))?")
_NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*(?P<unit>.*?)\s*")


def files_of(scene: SceneFile, name: str) -> tuple[str, ...]:
    """Return the names of the files that a "design" or "simulate" of a scene can take.

    A UsageError says that its kind has no such action.
    """
    run, files = _ACTIONS[name]
    if not hasattr(scene.kind, run):
        known = ", ".join(kind for kind, of in KINDS.items() if hasattr(of, run))
        raise UsageError(
            f"toros {name}: scenes of the kind {scene.kind.KIND!r} have no {name}; those of these "
            f"kinds have one: {known}."
        )
    return tuple(getattr(scene.kind, files))


def run_scene(
    comm: MPI.Comm,
    scene: SceneFile,
    name: str,
    folder: Path,
    *,
    every: int,
    verbose: bool,
    resume: bool = False,
    overwrite: bool = False,
) -> Answer:
    """Design or simulate a scene in a run folder, by the name of the action (collective).

    Raises:
        UsageError: The kind of the scene has no such action, or its run would remove a file that it
            reads.
        TorosError: As of `open_run` and of the action.
    """
    files = _taken(scene, name)
    action = getattr(scene.config, _ACTIONS[name][0])
    if overwrite:
        on_first_rank(comm, lambda: _require_apart(folder, files))
    inputs = on_first_rank(comm, lambda: inputs_of(scene, name))
    text = scene_text(scene.config, files, scene.materials)
    with scene.located():  # what is impossible is refused before a folder is touched
        doubtful = doubts(scene.config, simulated=name == "simulate")
        if overwrite:
            _require_meshes(comm, scene, name, files)
    with (
        scene.located(),
        open_run(comm, folder, inputs, scene=text, resume=resume, overwrite=overwrite, every=every),
    ):
        if resume:
            log.info("the run in %s goes on", folder)
        if name == "simulate":  # a design warns by itself
            warn_of_doubts(comm, doubtful)
        action(comm, folder, files, verbose=verbose)
    told, summary = on_first_rank(comm, lambda: (_told(folder), read_content(folder)))
    return Answer("\n".join([told, *narrower(scene, folder, summary)]), summary)


def _told(folder: Path) -> str:
    """Write the report of a run, and return what a terminal tells of it (one rank)."""
    place = folder

    def write() -> None:
        nonlocal place
        place = write_report(folder)

    if_plotting(write)
    return f"{as_text(summary_of(folder))}\nSee {place}"


def narrower(scene: SceneFile, folder: Path, summary: Mapping[str, Any]) -> list[str]:
    """Return how to go on with a run that is not certain; empty if it cannot be narrower."""
    key, state = "check_refinement", summary["verdict"]["state"]
    possible = key in scene.kind.described() and scene.config.value(key) is None
    if state != State.NOT_CERTAIN or not possible:
        return []
    lines = "start" in scene.kind.described() and scene.config.value("start") == "relaxed"
    also = ", and perhaps other lines" if lines else ""
    told = summary.get("errors", {}).get("meshes", {})
    finer = round(2 / min(1.0, *map(float, told)) if told else 2)
    return [
        f"For narrower intervals{also}:",
        f"  {program()} resume {shlex.quote(str(folder))} --set {key}={finer}",
    ]


def resume_scene(
    comm: MPI.Comm, folder: Path, changes: Sequence[str] = (), *, every: int, verbose: bool
) -> Answer:
    """Go on with the run in a folder, with the inputs that it began with (collective).

    Args:
        changes: Other values of keys that are `free`, as "KEY=VALUE".

    Raises:
        UsageError: A key may not change.
        OutputError: The run in the folder is finished or in use.
        CheckpointError: The run cannot go on: it is no run of a scene, or its scene was changed.
        FileError: The folder holds no run, or a file that it began with has gone.
    """
    record, text = read_record(comm, folder)
    name = record.inputs.get("command")
    if text is None and name in _ACTIONS:
        raise CheckpointError(
            f"{folder / SCENE} is missing. Start the run anew by toros {name} --overwrite."
        )
    if text is None or name not in _ACTIONS:
        raise CheckpointError(
            f"the run in {folder} was not made by `toros design` or `toros simulate`. Resume it "
            "by the script that made it."
        )
    try:
        scene = read_scene(folder / SCENE, comm=comm, changes=changes)
    except FileError as error:
        if changes:
            raise
        raise CheckpointError(
            f"the scene of the run in {folder} cannot be read any more: {error}"
        ) from None
    scene.require_files(comm)
    if changes:
        inputs, then = on_first_rank(comm, lambda: inputs_of(scene, name)), record.inputs
        values, before = inputs["config"], then.get("config", {})
        if fixed := [key for key in values if values[key] != before.get(key)]:
            raise UsageError(
                f"toros resume: {fixed[0]} tells another problem. A run that goes on may change "
                f"{', '.join(inputs[FREE])}; for all else start a new run by toros design."
            )
    return run_scene(comm, scene, name, folder, every=every, verbose=verbose, resume=True)


def _require_apart(folder: Path, files: Mapping[str, Path]) -> None:
    """Check that no file of a scene belongs to the run that is overwritten (one rank)."""
    own = {folder.resolve(), *(path.resolve() for path in files_of_run(folder))}
    for name, path in files.items():
        if path in own:
            raise UsageError(
                f"{name} = {path} belongs to the run in {folder}, which would be removed. "
                "Choose another --output."
            )


def _require_meshes(comm: MPI.Comm, scene: SceneFile, name: str, files: Mapping[str, Path]) -> None:
    """Check the files and meshes of an action before it removes a run (collective)."""
    from toros_fem.products.actuators.cost import require_affordable_meshes
    from toros_fem.products.actuators.scene import ActuatorScene
    from toros_fem.products.actuators.simulate import case_to_simulate
    from toros_fem.products.inflate import InflateScene

    config = scene.config
    if isinstance(config, InflateScene):
        config.expected_cost(comm)
    elif isinstance(config, ActuatorScene):
        read = config.with_files(comm, files)
        if name == "design":
            require_affordable_meshes(comm, read)
        else:
            case_to_simulate(comm, read, files.get("pattern"))


def _taken(scene: SceneFile, name: str) -> dict[str, Path]:
    """Return the files of a scene that an action takes."""
    names = files_of(scene, name)
    return {key: scene.files[key].resolve() for key in names if key in scene.files}


def inputs_of(scene: SceneFile, name: str) -> dict[str, Any]:
    """Return all inputs of an action, as JSON has them (one rank).

    Files are told by their content, folders by their place.
    """
    values, free = scene.config.fixed_and_free()
    found: dict[str, Any] = {
        "command": name,
        "kind": scene.kind.KIND,
        "config": values,
        FREE: free,
        "files": {key: _content(path) for key, path in _taken(scene, name).items()},
    }
    return dict(json.loads(json.dumps(found)))


def _content(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:  # a folder; what is missing is told where it is read
        return str(path)


@dataclass
class Trial:
    """One run of a study: its values by key, and what it found.

    Attributes:
        failure: Why there is no result; empty if there is one, or the run has not ended.
    """

    values: Mapping[str, Any]
    folder: Path
    scene: SceneFile
    summary: Summary | None = None
    failure: str = ""


def run_study(
    comm: MPI.Comm,
    scene: Path | str,
    over: Mapping[str, Sequence[Any]] | Sequence[str],
    output: Path | str,
    *,
    command: str = "design",
    coarse: bool = False,
    changes: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """Run a scene with all combinations of some values; return the rows of the table (collective).

    Each run has a folder of its own. Those that are finished stay, those that were stopped go on.

    Args:
        scene: The scene file.
        over: Values by key, or words KEY=VALUES as of `values_of`.
        output: Folder of the study, made if missing: study.csv, study.png, a folder for each run.
        command: "design" or "simulate".
        changes: Texts "KEY=VALUE" that hold for all runs.

    Raises:
        FileError: A value is wrong; before anything runs.
        ParameterError: A key is wrong, or there are too many values.
        OutputError: The folder cannot be written, or has a table that is of no study.
    """
    folder = Path(output)
    read = partial(read_scene, Path(scene), comm=comm, coarse=coarse)
    keys, values = _varied(read(changes=changes), over)
    trials = []
    for one in combinations(values):
        own = [f"{name}={keys[name].written(value)}" for name, value in one.items()]
        trials.append(Trial(one, folder / _name(one), read(changes=[*changes, *own])))
    there = on_first_rank(comm, lambda: any(folder.glob(f"*/{STATE}/{RECORD}")))
    files = (TABLE, PICTURE)
    on_first_rank(comm, lambda: require_unused(folder, files, overwrite=there))
    for number, trial in enumerate(trials, 1):
        log.info("%d of %d: %s", number, len(trials), trial.folder.name)
        _run(comm, trial, command)
        rows = rows_of(keys, trials)
        guarded(comm, folder, partial(write_table, folder / TABLE, rows))
    columns, found = list(_columns(keys, trials).values()), [one.summary for one in trials]

    def draw() -> None:
        from toros_fem.results.pictures.study import draw_study

        draw_study(folder / PICTURE, rows, columns, [one for one in found if one is not None])

    guarded(comm, folder, lambda: if_plotting(draw))
    return rows


def _varied(
    scene: SceneFile, over: Mapping[str, Sequence[Any]] | Sequence[str]
) -> tuple[dict[str, Key], dict[str, Sequence[Any]]]:
    """Return the keys that vary, and their values."""
    known = keys_of(scene.kind)[QUICK]
    given = over.items() if isinstance(over, Mapping) else (values_of(one, known) for one in over)
    varied: dict[str, Sequence[Any]] = {}
    for name, several in given:
        if name in varied:
            raise ParameterError(f"{name} is given twice. Give all of its values at once.", name)
        if name not in known:
            raise ParameterError(f"unknown key {name!r}; {nearest(name, known)}", name)
        varied[name] = several
    return {name: known[name] for name in varied}, varied


def _run(comm: MPI.Comm, trial: Trial, command: str) -> None:
    """Run one scene, go on with it, or take what it found (collective)."""
    folder = trial.folder
    try:
        state = _state_of(comm, trial, command)
        if state != "finished":
            how = {"resume": state == "stopped", "overwrite": state == "another"}
            run_scene(comm, trial.scene, command, folder, every=EVERY, verbose=False, **how)
        trial.summary = on_first_rank(comm, lambda: summary_of(folder))
    except TorosError as caught:
        trial.failure = str(caught)
        log.warning("%s: %s", folder.name, caught)


def _state_of(comm: MPI.Comm, trial: Trial, command: str) -> str:
    """Return what run a folder holds: "none", "another", or this one, "finished" or "stopped"."""
    if not on_first_rank(comm, (trial.folder / STATE / RECORD).exists):
        return "none"
    record, _ = read_record(comm, trial.folder)
    if record.inputs != on_first_rank(comm, lambda: inputs_of(trial.scene, command)):
        return "another"
    return "finished" if record.finished else "stopped"


def rows_of(keys: Mapping[str, Key], trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Return values and figures of all runs as rows of the table."""
    columns, rows = _columns(keys, trials), []
    for trial in trials:
        row = {columns[name]: value for name, value in trial.values.items()}
        found = {} if trial.summary is None else trial.summary.figures
        for key, figure in found.items():
            row[key] = figure.value
            if figure.interval is not None:
                row[f"{figure.name}_error_{figure.unit}"] = figure.interval
            if figure.state is not None:
                row[f"{figure.name}_state"] = str(figure.state)
        rows.append(row | {"run": trial.folder.name, "failure": trial.failure})
    return rows


def _columns(keys: Mapping[str, Key], trials: Sequence[Trial]) -> dict[str, str]:
    """Return the column of each key that varies; one that a figure has too is ``given_…``."""
    found = {k for trial in trials if trial.summary for k in trial.summary.figures}
    plain = {name: _column_of(one) for name, one in keys.items()}
    return {name: f"given_{of}" if of in found else of for name, of in plain.items()}


def _column_of(one: Key) -> str:
    """Return the column of a key: its name, and the unit that ends it."""
    plain = one.kind is float and one.within.unit is not None
    return f"{one.name}_{one.ending}" if plain else one.name


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
    if count is None or not 2 <= int(count) <= MOST:
        raise ParameterError(
            f"{words!r}: say how many values, 2 to {MOST}, as in {name}={low}..{high}:5.", name
        )
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
