"""Checkpoints of all loops of a run, one file each, in the order in which the loops come."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.errors import CheckpointError, OutputError
from toros_fem.base.files import reason
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.versions import __version__
from toros_fem.design.loop.journal import KIND, Journal, JournalEntry
from toros_fem.results.runs.files import STATE

if TYPE_CHECKING:  # a run opens its journals
    from toros_fem.results.runs.folder import OpenRun

# Key of what a checkpoint belongs to, and what to do where it cannot serve.
OWNER = "belongs_to"
REMEDY = "Remove it to lose this part of the run alone, or start the run anew."
log = logging.getLogger(__name__)


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
