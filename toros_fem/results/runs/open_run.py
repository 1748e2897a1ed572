"""A run is a folder: its lock, its inputs, the state of its loops, and then its results."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import logging
import os
import re
import shlex
import signal
import socket
import stat
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import partial, reduce
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NoReturn, Self, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, FileError, OutputError, RunStoppedError
from toros_fem.base.files import (
    FORMAT,
    UNFINISHED,
    Archive,
    guarded,
    read_archive,
    read_bytes,
    read_json,
    reading,
    reason,
    remove_unfinished,
    replace_file,
    write_archive,
    write_json,
)
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import __version__, program
from toros_fem.base.validation import require_count
from toros_fem.design.loop.journal import KIND, Journal, JournalEntry
from toros_fem.results.runs.stored_run import (
    RECORD,
    SCENE,
    STATE,
    WarningList,
    files_of_run,
    require_no_link,
)

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
_HALF = re.compile(rf"\..*{re.escape(UNFINISHED)}")
# Folders in which scripts began results without an open run.
_begun: set[Path] = set()
NAME = ".lock"
# What the lock of a run begins with, where it is not empty.
HOLDER = b"process "
# Open MPI's mpirun passes the second user signal on, but ends the ranks itself at the others.
STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR2)
# Key of what a checkpoint belongs to, and what to do where it cannot serve.
OWNER = "belongs_to"
REMEDY = "Remove it to lose this part of the run alone, or start the run anew."
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
    own = run_of(folder) is not None or folder.resolve() in _begun
    if not own and (folder / STATE / RECORD).exists():
        raise OutputError(
            f"{folder} holds a run, whose files would be replaced. Choose another folder, or begin "
            "there by `open_run(…, overwrite=True)`."
        )


def begin_folder(comm: MPI.Comm, folder: str | Path, *, overwrite: bool = False) -> None:
    """Begin a folder of results without states, as `open_run` does (collective).

    Nothing is done in the folder of an open run, or inside it.

    Raises:
        OutputError: As of `open_run`.
    """
    folder = Path(folder)
    if run_of(folder) is not None:
        return

    def begin() -> None:
        with ExitStack() as stack:
            _anew(folder, RunRecord({}, "", written_by=__version__), None, stack, overwrite)

    _in_folder(comm, folder, begin)
    _begun.add(folder.resolve())


def open_run(
    comm: MPI.Comm,
    folder: str | Path,
    inputs: Mapping[str, Any],
    *,
    scene: str | None = None,
    resume: bool = False,
    overwrite: bool = False,
    every: int = EVERY,
    again: str | None = None,
) -> OpenRun:
    """Open and lock the folder of a run that is new, goes on, or is overwritten (collective).

    Args:
        inputs: All inputs, as JSON has them. They tell this run from others, but for those under
            the key `FREE`, by which it only goes further or tells more.
        scene: Text of the scene that it is made from, written to scene.toml; None without.
        resume: Whether to go on with the run in the folder; its files stay. A finished one goes on
            if inputs under `FREE` are others.
        overwrite: Whether the files of a run in the folder are removed first, by the names of
            `files_of_run`; all other files stay, and no link is followed.
        every: Number of iterations between two writes of the state.
        again: Command that goes on, for the line that tells it; None takes `toros resume`.

    Raises:
        OutputError: Another process uses the folder, it cannot be written to, it is not empty, or
            holds no run to resume or to overwrite.
        CheckpointError: The run in it has other inputs, or is of a newer version.
    """
    require_count(1, every=every)
    folder = Path(folder)
    fixed = {key: value for key, value in inputs.items() if key != FREE}
    identity = hashlib.sha256(json.dumps(fixed, sort_keys=True).encode()).hexdigest()
    new = RunRecord(dict(inputs), identity, written_by=__version__)
    with ExitStack() as stack:
        begin = partial(_resume if resume else partial(_anew, overwrite=overwrite), folder, new)
        record = _in_folder(comm, folder, partial(begin, scene, stack))
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
    require_no_link(folder)
    if record.inputs == new.inputs:
        if scene is not None and not (folder / SCENE).exists():  # a kill came before it
            replace_file(folder / SCENE, scene.encode())
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


def _anew(
    folder: Path, record: RunRecord, scene: str | None, stack: ExitStack, overwrite: bool
) -> RunRecord:
    """Lock an empty folder, or one whose run is removed, and write record and scene (one rank)."""
    _require_room(folder, overwrite=overwrite)
    folder.mkdir(parents=True, exist_ok=True)
    stack.callback(FolderLock(folder).release)
    empty = _require_room(folder, overwrite=overwrite)  # another process may have begun just now
    remove_unfinished(folder)
    if empty:
        stack.push(partial(_forget, folder))
    else:
        *others, _ = files_of_run(folder)
        for path in others:
            path.unlink()
        for place in {path.parent for path in others} - {folder, folder / STATE}:
            with suppress(OSError):  # what is not empty stays
                place.rmdir()
    (folder / STATE).mkdir(exist_ok=True)
    _write_run(folder, record, scene)
    return record


def _forget(folder: Path, kind: type[BaseException] | None, *_: Any) -> None:
    """Remove what a run is begun with, where an error ended it before it had written more."""
    state = folder / STATE
    more = _whole(folder) - {NAME, SCENE, STATE} | _whole(state) - {RECORD}
    if kind is not None and not issubclass(kind, RunStoppedError) and not more:
        for path in (folder / SCENE, state / RECORD):
            path.unlink(missing_ok=True)
        state.rmdir()


def _require_room(folder: Path, *, overwrite: bool) -> bool:
    """Check that a folder is missing, empty, or of a run that is overwritten; whether it is empty.

    What a run that was killed at its very beginning leaves, a lock and a folder, is nothing.
    """
    if not os.path.lexists(folder):
        return True
    left, state = _whole(folder) - {NAME}, folder / STATE
    if not left or (left == {STATE} and not state.is_symlink() and not _whole(state)):
        return True
    held = (state / RECORD).is_file() and not (state / RECORD).is_symlink()
    if not (overwrite and held):
        what = "is not empty"
        if overwrite:
            what = f"holds no run that could be overwritten: {state / RECORD} is missing"
        other = "replace its run by --overwrite" if held and not overwrite else "empty this one"
        raise OutputError(
            f"{folder} {what}. Choose another folder, or {other}; nothing was done to its files."
        )
    _read_record(folder)
    return False


def _whole(folder: Path) -> set[str]:
    """Return the names in a folder, but for files that a killed process was writing."""
    return {name for name in os.listdir(folder) if not _HALF.fullmatch(name)}


def _write_run(folder: Path, record: RunRecord, scene: str | None) -> None:
    """Write the record first: with it a folder can go on, or be overwritten."""
    _write_record(folder, record)
    if scene is not None:
        replace_file(folder / SCENE, scene.encode())


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
    found = content.get("format")
    if isinstance(found, int) and found != FORMAT:
        raise CheckpointError(
            f"{path} has format {found}; this version, {__version__}, reads format {FORMAT}. Go on "
            "with the version that wrote it, or start the run anew in another folder."
        )
    known = content.keys() <= {one.name for one in fields(RunRecord)}
    whole = isinstance(content.get("inputs"), dict) and isinstance(content.get("identity"), str)
    if found != FORMAT or not (known and whole):
        raise CheckpointError(f"{path} is damaged. {ANEW}")
    return RunRecord(**content)


class FolderLock:
    """Lock of a folder that exists for this process (one rank).

    The kernel frees it when the process ends, however it ends.

    Raises:
        OutputError: Another process holds it; the message names process and host. Or a link or a
            file of somebody else has its name.
        OSError: The folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / NAME
        foreign = OutputError(f"{path} is no lock of a run. Move it, or choose another folder.")
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            self._file: int | None = os.open(path, flags, 0o644)
        except OSError as caught:
            strange = caught.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO)
            raise (foreign if strange else caught) from None
        about = os.fstat(self._file)
        own = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
        if not own or os.pread(self._file, len(HOLDER), 0) not in (b"", HOLDER):
            self.release()
            raise foreign
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as caught:
            holder = os.read(self._file, 200).decode(errors="replace").strip()
            self.release()
            in_use = OutputError(
                f"{folder} is in use by a run{f', {holder}' if holder else ''}. Wait for its end, "
                "stop it, or choose another folder."
            )
            # Any other error is that of a file system without locks.
            raise (in_use if isinstance(caught, BlockingIOError) else caught) from None
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)

    def release(self) -> None:
        """Free the lock."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


class Signals:
    """Handlers of SIGINT, SIGTERM and the user signals while a run is open.

    SIGUSR1 asks for a write, the others for an end: the first of them at the end of the step.
    Where nothing is to be written, outside of design loops, or at a second one, the run stops at
    once by `stop`. Handlers are installed in the main thread alone.

    Attributes:
        waits: Whether a design loop will look at what is asked soon.
        stopped_at_once: Number of the signal that did not wait; 0 for none.
    """

    def __init__(self, comm: MPI.Comm, stop: Callable[[int], None]) -> None:
        self._comm, self._stop = comm, stop
        self._asked, self._write = 0, False
        self.waits = False
        self.stopped_at_once = 0
        self._before: dict[int, Any] = {}

    def install(self) -> None:
        """Install the handlers."""
        if threading.current_thread() is threading.main_thread():
            for number in (*STOPS, signal.SIGUSR1):
                self._before[number] = signal.signal(number, self._handle)

    def restore(self) -> None:
        """Restore the handlers from before."""
        for number, handler in self._before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        self._before.clear()

    def _handle(self, number: int, _: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            self._write = True
            return
        again, self._asked = self._asked > 0, number
        if again and self._comm.size > 1:  # the others may wait for this rank
            sys.stderr.write("stopped at once; the state on disk is that of the last write\n")
            sys.stderr.flush()
            self._comm.Abort(128 + number)
        if again or (self._comm.size == 1 and not self.waits):
            self.stopped_at_once = number
            self._stop(number)

    def asked(self, comm: MPI.Comm) -> tuple[int, bool]:
        """Return the signal that asks for an end, or 0, and whether to write (collective)."""
        found = np.zeros(2, dtype=np.int64)
        own = np.array([self._asked, self._write], dtype=np.int64)
        self._write = False
        comm.Allreduce(own, found, op=MPI.MAX)
        return int(found[0]), bool(found[1])


class RunJournal(Journal):
    """Journal of a run; the names of all of its files begin alike."""

    def __init__(self, run: OpenRun, name: str = "") -> None:
        self._run, self._name, self._count = run, name, 0
        self._branches: dict[str, RunJournal] = {}

    def branch(self, name: str) -> RunJournal:
        """Return a journal inside this one, with a sequence of its own."""
        return self._branches.setdefault(name, RunJournal(self._run, f"{self._name}{name}."))

    def entry(self, comm: MPI.Comm, signature: str) -> RunEntry:
        """Return the next entry (collective)."""
        path = self._run.folder / STATE / f"{self._name}{self._count:03d}.npz"
        self._count += 1
        return RunEntry(comm, self._run, path, signature)


class RunEntry(JournalEntry):
    """The checkpoint of one design loop or simulation, on its part of the run's ranks."""

    def __init__(self, comm: MPI.Comm, run: OpenRun, path: Path, signature: str) -> None:
        self._comm, self._run, self._path = comm, run, path
        self._belongs_to = {"inputs": run.record.identity, "problem": signature}
        self._since = run.every  # the first one is written

    def saved(self) -> Archive | None:
        """Return the checkpoint of an earlier, interrupted run; None without (collective).

        That of another loop is none, if the run's inputs were changed. From now on a stop waits
        for the next `offer`.

        Raises:
            CheckpointError: It is damaged, of a newer version, or belongs to something else.
        """

        def read() -> Archive | None:
            if not self._path.exists():
                return None
            found = read_archive(self._path, KIND, self._own, CheckpointError, REMEDY)
            if found is None:
                log.warning("%s is of another loop, and is made anew", self._path)
                return None
            if found.written_by != __version__:
                log.warning(
                    "%s was written by toros_fem %s; this is %s, and digits may differ",
                    self._path, found.written_by, __version__,
                )  # fmt: skip
            return found

        self._run.signals.waits = True
        return on_first_rank(self._comm, read)

    def offer(self, make: Callable[[], Archive], *, last: bool) -> None:
        """Write a checkpoint if it is due, or if a signal asks for it (collective).

        Raises:
            RunStoppedError: A signal asked for an end; the checkpoint is written.
            OutputError: It cannot be written; the one before stays.
        """
        self._since += 1
        number, write = self._run.signals.asked(self._comm)
        if last or write or number or self._since >= self._run.every:
            self._write(make())
            self._since = 0
        if write:
            log.info("the state is written to %s", self._path.parent)
        if number:
            self._run.stop(number)
        self._run.signals.waits = not last

    def close(self) -> None:
        """Say that no checkpoint will come soon, so that a stop need not wait for it."""
        self._run.signals.waits = False

    def _own(self, archive: Archive) -> Archive | None:
        """Return the content of a file; None for another loop, if the inputs were changed."""
        owner = archive.numbers.get(OWNER, {})
        differing = [key for key, value in self._belongs_to.items() if owner.get(key) != value]
        if differing == ["problem"] and self._run.record.changed:
            return None
        if differing:
            raise CheckpointError(
                f"it belongs to another run, with other {' and '.join(differing)}; resume with "
                "the inputs that the run began with"
            )
        return archive

    def _write(self, checkpoint: Archive) -> None:
        numbers = {**checkpoint.numbers, OWNER: self._belongs_to}

        def write() -> None:
            try:
                whole = replace(checkpoint, numbers=numbers)
                write_archive(self._path, whole, compress=False)
            except OSError as caught:
                raise OutputError(
                    f"{self._path} could not be written: {reason(caught)}. The state of an earlier "
                    "iteration is kept there. Free some space and resume."
                ) from None

        on_first_rank(self._comm, write)
