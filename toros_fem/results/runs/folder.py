"""A run is a folder: its lock, its inputs, the state of its loops, and then its results."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shlex
import signal
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial, reduce
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self, TypeVar

from mpi4py import MPI

from toros_fem.base.archive import FORMAT
from toros_fem.base.errors import CheckpointError, FileError, OutputError, RunStoppedError
from toros_fem.base.files import (
    add_to_list,
    guarded,
    listed,
    listing,
    read_bytes,
    read_json,
    reading,
    remove_unfinished,
    replace_file,
    write_json,
)
from toros_fem.base.program import program
from toros_fem.base.validation import require_count
from toros_fem.base.versions import __version__
from toros_fem.results.runs.earlier import move_aside, move_back
from toros_fem.results.runs.files import RECORD, SCENE, STATE
from toros_fem.results.runs.journal import RunJournal
from toros_fem.results.runs.lock import FolderLock
from toros_fem.results.runs.signals import Signals
from toros_fem.results.runs.warnings import WarningList

log = logging.getLogger(__name__)
PACKAGE = "toros_fem"

T = TypeVar("T")

# Key of the inputs that may change in a run that goes on.
FREE = "free"
# Number of iterations between two writes of the state.
EVERY = 2
ANEW = "Start the run anew in another folder."
UNUSABLE = (
    "{} cannot be used as the folder of a run: {}. Choose another folder, or free some space."
)

_open: dict[Path, OpenRun] = {}


@dataclass(frozen=True)
class RunRecord:
    """What a folder says of its run.

    Attributes:
        inputs: All inputs, as JSON has them.
        identity: What tells runs apart: a hash of the inputs but for those under `FREE`.
        finished: Whether it came to its end.
        changed: Whether some of these were changed, and the run has not ended since.
        written_by: Version of the package that began it.
    """

    inputs: Mapping[str, Any]
    identity: str
    finished: bool = False
    changed: bool = False
    written_by: str = ""
    format: int = FORMAT


class OpenRun:
    """An open run folder, made by `open_run`; as a context manager it is closed at the end.

    While it is open, what designs into this folder keeps its state there and finds it again.
    `closing` is told how the run ended, and frees the folder's lock. What the package warns of
    meanwhile is kept for the summary.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        folder: Path,
        record: RunRecord,
        closing: ExitStack,
        *,
        every: int,
        again: str,
    ) -> None:
        self.comm, self.folder, self.every = comm, folder, every
        self.record, self._closing, self._again = record, closing, again
        self.signals, self.warnings = Signals(comm, self.stop), WarningList()
        self._journal = RunJournal(self)

    def journal(self, folder: str | Path) -> RunJournal:
        """Return the journal of what is designed into this folder, or into one inside it."""
        inside = Path(folder).resolve().relative_to(self.folder.resolve())
        return reduce(RunJournal.branch, inside.parts, self._journal)

    def check(self) -> None:
        """End the run here by a RunStoppedError if a signal asks for it (collective)."""
        number, _ = self.signals.asked(self.comm)
        if number:
            self.stop(number)

    def stop(self, number: int) -> NoReturn:
        """End the run by a RunStoppedError, because of a signal."""
        raise self._stopped(number)

    def _stopped(self, number: int) -> RunStoppedError:
        return RunStoppedError(
            f"stopped by {signal.Signals(number).name}; the state is on disk. Go on with: "
            f"{self._again}",
            number,
        )

    def __enter__(self) -> Self:
        _open[self.folder.resolve()] = self
        logging.getLogger(PACKAGE).addHandler(self.warnings)
        self.signals.install()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        _open.pop(self.folder.resolve(), None)
        logging.getLogger(PACKAGE).removeHandler(self.warnings)
        self.signals.restore()
        number, late = self.signals.stopped_at_once, None
        if number and not isinstance(error, RunStoppedError):
            # PETSc makes an error of its own of one in a callback; others may swallow it.
            error = late = self._stopped(number)
        try:
            if error is None:
                done = replace(self.record, finished=True, changed=False)
                _in_folder(self.comm, self.folder, lambda: _write_record(self.folder, done))
        finally:
            self._closing.__exit__(None if error is None else type(error), error, trace)
        if late is not None:
            raise late


def run_of(folder: str | Path) -> OpenRun | None:
    """Return the open run whose folder this is, or lies inside; None without."""
    place = Path(folder).resolve()
    return next((_open[at] for at in (place, *place.parents) if at in _open), None)


def journal_of(folder: str | Path) -> RunJournal | None:
    """Return the journal of what is designed into a folder; None if no run is open there."""
    run = run_of(folder)
    return None if run is None else run.journal(folder)


def require_open(folder: Path) -> None:
    """Check that a folder holds no run whose files would be replaced, or an open one (one rank)."""
    if run_of(folder) is None and (folder / STATE / RECORD).exists():
        raise OutputError(
            f"{folder} holds a run, whose files would be replaced. Choose another folder, or let "
            "`open_run` move it aside."
        )


def open_run(
    comm: MPI.Comm,
    folder: str | Path,
    inputs: Mapping[str, Any],
    *,
    scene: str | None = None,
    resume: bool = False,
    every: int = EVERY,
    again: str | None = None,
) -> OpenRun:
    """Open a run folder: lock it, and move the files of an earlier run aside (collective).

    Files of an earlier run go to earlier-1, earlier-2, … inside the folder; other files stay. They
    come back if the new run ends by an error before it has written anything.

    Args:
        inputs: All inputs, as JSON has them. They tell this run from others, but for those under
            the key `FREE`, by which it only goes further or tells more.
        scene: Text of the scene that it is made from, written to scene.toml; None without.
        resume: Whether to go on with the run in the folder; its files stay. A finished one goes on
            if inputs under `FREE` are others.
        every: Number of iterations between two writes of the state.
        again: Command that goes on, for the line that tells it; None takes `toros resume`.

    Raises:
        OutputError: Another process uses the folder, it cannot be written to, a file in it that no
            run wrote has the name of a file of runs, or the run in it is finished.
        FileError: There is no run in it to resume.
        CheckpointError: The run in it has other inputs, or is of a newer version.
    """
    require_count(1, every=every)
    folder = Path(folder)
    fixed = {key: value for key, value in inputs.items() if key != FREE}
    identity = hashlib.sha256(json.dumps(fixed, sort_keys=True).encode()).hexdigest()
    new = RunRecord(dict(inputs), identity, written_by=__version__)
    with ExitStack() as stack:
        begin = _resume if resume else _anew
        record = _in_folder(comm, folder, partial(begin, folder, new, scene, stack))
        closing = stack.pop_all()
    again = again or f"{program()} resume {shlex.quote(str(folder))}"
    return OpenRun(comm, folder, record, closing, every=every, again=again)


def _resume(folder: Path, new: RunRecord, scene: str | None, stack: ExitStack) -> RunRecord:
    """Lock the folder of a run that goes on, and return its record (one rank)."""
    _read_record(folder)  # nothing is written into a folder that holds no run
    stack.callback(FolderLock(folder).release)
    record = _read_record(folder)  # another process may have ended it just now
    if record.finished and record.inputs == new.inputs:
        raise OutputError(f"the run in {folder} is finished; there is nothing to resume.")
    if record.identity != new.identity:
        raise CheckpointError(
            f"the run in {folder} has other inputs than those given. Resume it with its own, or "
            "start a new run without resuming."
        )
    remove_unfinished(folder)
    if record.inputs == new.inputs:
        return record
    changed = replace(record, inputs=new.inputs, finished=False, changed=True)
    before = None if scene is None else (folder / SCENE).read_text(encoding="utf-8")
    _write_run(folder, changed, scene)
    stack.push(partial(_unchange, folder, record, before, (folder / STATE / RECORD).stat()))
    return changed


def _unchange(
    folder: Path,
    record: RunRecord,
    scene: str | None,
    since: os.stat_result,
    kind: type[BaseException] | None,
    *_: Any,
) -> None:
    """Write a record and a scene back, where an error ended the run before it wrote a state."""
    states = [path.stat().st_mtime_ns for path in (folder / STATE).glob("*.npz")]
    written = max(states, default=0) > since.st_mtime_ns
    if kind is not None and not issubclass(kind, RunStoppedError) and not written:
        _write_run(folder, record, scene)


def _anew(folder: Path, record: RunRecord, scene: str | None, stack: ExitStack) -> RunRecord:
    """Lock a folder, move an earlier run in it aside, and write scene and record (one rank)."""
    folder.mkdir(parents=True, exist_ok=True)
    stack.callback(FolderLock(folder).release)
    remove_unfinished(folder)
    earlier = _read_record(folder) if (folder / STATE / RECORD).exists() else None
    moved = move_aside(folder)
    if moved is not None:
        ended = earlier is None or earlier.finished
        of = "an earlier run" if ended else "a run that was not finished"
        log.warning("files of %s are now in %s", of, moved)
        stack.push(partial(_undo, folder, moved))
    add_to_list(folder, [STATE])
    with listing(folder):  # a folder around it may have a list too
        (folder / STATE).mkdir()
        _write_run(folder, record, scene)
    return record


def _write_run(folder: Path, record: RunRecord, scene: str | None) -> None:
    if scene is not None:
        replace_file(folder / SCENE, scene.encode())
    _write_record(folder, record)


def _undo(folder: Path, moved: Path, kind: type[BaseException] | None, *_: Any) -> None:
    """Move an earlier run back, where an error ended the new one before it wrote anything."""
    fresh = {folder / SCENE, folder / STATE / RECORD}
    new = [*(folder / STATE).glob("*"), *(folder / name for name in listed(folder))]
    written = {path for path in new if path.is_file()} - fresh
    if kind is None or issubclass(kind, RunStoppedError) or written:
        return
    for path in fresh:
        path.unlink(missing_ok=True)
    with suppress(FileNotFoundError):
        (folder / STATE).rmdir()
    move_back(moved)
    log.warning("the new run wrote nothing; files of the earlier one are back in %s", folder)


def read_record(comm: MPI.Comm, folder: str | Path) -> tuple[RunRecord, str | None]:
    """Return the record of a run and the text of its scene, None without (collective).

    Raises:
        FileError: The folder holds no run.
        CheckpointError: Its record is damaged or of a newer version.
    """
    folder = Path(folder)
    scene = folder / SCENE

    def read() -> tuple[RunRecord, str | None]:
        record = _read_record(folder)
        with reading(scene, CheckpointError, ANEW):
            return record, read_bytes(scene, "keys").decode() if scene.exists() else None

    return _in_folder(comm, folder, read)


def _in_folder(comm: MPI.Comm, folder: Path, action: Callable[[], T]) -> T:
    return guarded(comm, folder, action, OutputError, UNUSABLE, make=False)


def _write_record(folder: Path, record: RunRecord) -> None:
    write_json(folder / STATE / RECORD, asdict(record))


def _read_record(folder: Path) -> RunRecord:
    path = folder / STATE / RECORD
    content = read_json(path, CheckpointError, ANEW)
    if not content:
        raise FileError(f"{folder} holds no run: {path} is missing. Start one there.")
    found, damaged = content.get("format"), CheckpointError(f"{path} is damaged. {ANEW}")
    if isinstance(found, int) and found != FORMAT:
        raise CheckpointError(
            f"{path} has format {found}; this version, {__version__}, reads format {FORMAT}. Go on "
            "with the version that wrote it, or start the run anew in another folder."
        )
    try:
        record = RunRecord(**content)
    except TypeError:
        raise damaged from None
    whole = isinstance(record.inputs, dict) and isinstance(record.identity, str)
    if found != FORMAT or not whole:
        raise damaged
    return record
