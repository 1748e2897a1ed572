"""A run is a folder: its lock, its inputs, the state of its loops, and then its results."""

from __future__ import annotations

import hashlib
import json
import logging
import shlex
import signal
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self, TypeVar

from mpi4py import MPI

from toros_fem.base.archive import FORMAT
from toros_fem.base.errors import CheckpointError, RunError, RunStoppedError
from toros_fem.base.files import replace_file
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_count
from toros_fem.base.versions import __version__
from toros_fem.results.runs.earlier import move_aside, names_beside
from toros_fem.results.runs.journal import RunJournal
from toros_fem.results.runs.lock import FolderLock
from toros_fem.results.runs.signals import Signals

log = logging.getLogger(__name__)

T = TypeVar("T")

# Folder of the state inside that of a run, its record, and the text of the scene.
STATE, RECORD, SCENE = "state", "run.json", "scene.toml"
SUMMARY = "summary.json"
# Number of iterations between two writes of the state.
EVERY = 2
ANEW = "Start the run anew in another folder."

_open: dict[Path, Run] = {}


@dataclass(frozen=True)
class RunRecord:
    """What a folder says of its run.

    Attributes:
        inputs: All inputs, as JSON has them.
        identity: Tells the inputs from others.
        finished: Whether the run came to its end.
        kept: Names of files and folders that were there before the first run.
        written_by: Version of the package.
        format: Version of the format.
    """

    inputs: Mapping[str, Any]
    identity: str
    finished: bool = False
    kept: tuple[str, ...] = ()
    written_by: str = ""
    format: int = FORMAT


class Run:
    """An open run folder, made by `open_run`; as a context manager it is closed at the end.

    While it is open, what designs into this folder keeps its state there and finds it again.

    Attributes:
        comm: Communicator.
        folder: The folder.
        resumed: Whether an earlier run goes on.
        scene: Text of the scene that made it; None without.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        folder: Path,
        record: RunRecord,
        lock: FolderLock | None,
        *,
        scene: str | None,
        resumed: bool,
        every: int,
        again: str,
    ) -> None:
        self.comm, self.folder, self.scene, self.resumed = comm, folder, scene, resumed
        self._record, self._lock, self._every, self._again = record, lock, every, again
        self._signals = Signals(comm, self._stop)
        self._journals: dict[str, RunJournal] = {}

    def journal(self, folder: str | Path) -> RunJournal:
        """Return the journal of what is designed into this folder, or into one inside it."""
        inside = Path(folder).resolve().relative_to(self.folder.resolve())
        name = "".join(f"{part}." for part in inside.parts)
        if name not in self._journals:
            self._journals[name] = RunJournal(
                self.folder / STATE,
                self._record.identity,
                self._every,
                self._signals,
                self._stop,
                name,
            )
        return self._journals[name]

    def check(self) -> None:
        """End the run here if a signal asks for it (collective).

        Raises:
            RunStoppedError: It does; all that can be kept is written.
        """
        number, _ = self._signals.asked(self.comm)
        if number:
            self._stop(number)

    def _stop(self, number: int) -> NoReturn:
        raise RunStoppedError(
            f"stopped by {signal.Signals(number).name}; the state is on disk. Go on with: "
            f"{self._again}",
            number,
        )

    def __enter__(self) -> Self:
        _open[self.folder.resolve()] = self
        self._signals.install()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        _open.pop(self.folder.resolve(), None)
        self._signals.restore()
        try:
            if error is None:
                done = replace(self._record, finished=True)
                _guarded(self.comm, self.folder, lambda: _write_record(self.folder, done))
        finally:
            if self._lock is not None:
                self._lock.release()
        at_once = self._signals.stopped_at_once
        if at_once and error is not None and not isinstance(error, RunStoppedError):
            self._stop(at_once)  # PETSc makes an error of its own of one in a callback


def run_of(folder: str | Path) -> Run | None:
    """Return the open run whose folder this is, or lies inside; None without."""
    place = Path(folder).resolve()
    return next((_open[at] for at in (place, *place.parents) if at in _open), None)


def journal_of(folder: str | Path) -> RunJournal | None:
    """Return the journal of what is designed into a folder; None if no run is open there."""
    run = run_of(folder)
    return None if run is None else run.journal(folder)


def open_run(
    comm: MPI.Comm,
    folder: str | Path,
    inputs: Mapping[str, Any],
    *,
    scene: str | None = None,
    resume: bool = False,
    every: int = EVERY,
    again: str | None = None,
) -> Run:
    """Open a run folder: lock it, and move the files of an earlier run aside (collective).

    Files of an earlier run go to earlier-1, earlier-2, … inside the folder; other files stay.

    Args:
        comm: Communicator.
        folder: The folder, made if missing.
        inputs: All inputs, as JSON has them; they tell this run from others.
        scene: Text of the scene that it is made from, written to scene.toml; None without.
        resume: Whether to go on with the run in the folder; its files stay.
        every: Number of iterations between two writes of the state.
        again: Command that goes on, for the line that tells it; None takes `toros resume`.

    Raises:
        RunError: Another process uses the folder, it cannot be written to, or there is nothing to
            resume in it.
        CheckpointError: The run in it has other inputs, or is of a newer version.
        ParameterError: `every` is not a whole number, at least 1.
    """
    require_count(1, every=every)
    folder = Path(folder)
    lock: FolderLock | None = None
    record = RunRecord(dict(inputs), _identity(inputs), written_by=__version__)

    def begin() -> tuple[RunRecord, str | None]:
        nonlocal lock
        if resume:
            found = _read_record(folder)
            _check_resumable(folder, found, record.identity)
            lock = FolderLock(folder)
            return found, _read_scene(folder)
        folder.mkdir(parents=True, exist_ok=True)
        lock = FolderLock(folder)
        earlier = _read_record(folder) if (folder / STATE / RECORD).exists() else None
        moved = move_aside(folder, None if earlier is None else earlier.kept, last=STATE)
        if moved is not None:
            ended = earlier is None or earlier.finished
            of = "an earlier run" if ended else "a run that was not finished"
            log.warning("files of %s are now in %s", of, moved)
        made = replace(record, kept=names_beside(folder))
        (folder / STATE).mkdir()
        if scene is not None:
            replace_file(folder / SCENE, scene.encode())
        _write_record(folder, made)
        return made, scene

    try:
        made, text = _guarded(comm, folder, begin)
    except BaseException:
        if lock is not None:
            lock.release()
        raise
    return Run(
        comm,
        folder,
        made,
        lock,
        scene=text,
        resumed=resume,
        every=every,
        again=again or f"toros resume {shlex.quote(str(folder))}",
    )


def read_run(comm: MPI.Comm, folder: str | Path) -> tuple[RunRecord, str | None]:
    """Return the record of a run and the text of its scene, None without (collective).

    Raises:
        RunError: The folder holds no run.
        CheckpointError: Its record is damaged or of a newer version.
    """
    folder = Path(folder)
    return _guarded(comm, folder, lambda: (_read_record(folder), _read_scene(folder)))


def _guarded(comm: MPI.Comm, folder: Path, action: Callable[[], T]) -> T:
    """Return the result of an action on the first rank, with errors of the system named."""

    def guarded() -> T:
        try:
            return action()
        except RunError:
            raise
        except OSError as caught:
            raise RunError(
                f"{folder} cannot be used as the folder of a run: {caught}. Choose another folder, "
                "or free some space."
            ) from None

    return on_first_rank(comm, guarded)


def _identity(inputs: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


def _write_record(folder: Path, record: RunRecord) -> None:
    content = json.dumps(asdict(record), indent=2, ensure_ascii=False) + "\n"
    replace_file(folder / STATE / RECORD, content.encode())


def _read_record(folder: Path) -> RunRecord:
    path = folder / STATE / RECORD
    try:
        content = json.loads(path.read_bytes())
        found = int(content["format"])
    except (FileNotFoundError, NotADirectoryError):
        raise RunError(f"{folder} holds no run: {path} is missing. Start one there.") from None
    except (ValueError, TypeError, KeyError) as fault:
        raise CheckpointError(f"{path} is damaged: {fault}. {ANEW}") from None
    if found != FORMAT:
        raise CheckpointError(
            f"{path} has format {found}; this version, {__version__}, reads format {FORMAT}. Go on "
            "with the version that wrote it, or start the run anew in another folder."
        )
    try:
        record = RunRecord(**{**content, "kept": tuple(content["kept"])})
        whole = isinstance(record.inputs, dict) and isinstance(record.identity, str)
    except (TypeError, KeyError):
        whole = False
    if not whole:
        raise CheckpointError(f"{path} is damaged: entries are missing. {ANEW}")
    return record


def _read_scene(folder: Path) -> str | None:
    path = folder / SCENE
    return path.read_text(encoding="utf-8") if path.exists() else None


def _check_resumable(folder: Path, record: RunRecord, identity: str) -> None:
    if record.finished:
        raise RunError(f"the run in {folder} is finished; there is nothing to resume.")
    if record.identity != identity:
        raise CheckpointError(
            f"the run in {folder} has other inputs than those given. Resume it with its own, or "
            "start a new run without resuming."
        )
