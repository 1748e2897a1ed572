"""Reporter of a design: console, progress bar, and the history on disk while it runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.files import guarded, write_table
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import Evaluation
from toros_fem.results.console import ProgressBar, header, line, print_line
from toros_fem.results.frames.files import FOLDER, forget_from, rename
from toros_fem.results.frames.record import gathered_frame, write_step
from toros_fem.results.runs.folder import begin_folder


class DesignReporter(AbstractContextManager["DesignReporter"]):
    """Reporter of a design: console lines, progress bar, and history.csv while it runs.

    It is the `callback` of `optimize`. Its construction starts the clock of the run. As a context
    manager it removes the progress bar at the end. The folder is made if missing.

    Attributes:
        attempt: Number of the attempt at the design whose shapes are recorded; the first one is 0.

    Raises:
        OutputError: The folder cannot be made or written to; here and in each call. It is neither
            empty nor that of an open run, and not to be overwritten.
    """

    def __init__(self, comm: MPI.Comm, folder: str | Path, *, overwrite: bool = False) -> None:
        require_kind("folder", folder, (str, Path), "the path of a folder")
        self._begin = time.perf_counter()
        self._comm, self._folder = comm, Path(folder)
        self._setup: float | None = None
        self._rows: list[Iteration] = []
        self._bar = ProgressBar()
        self.attempt = 0
        begin_folder(comm, self._folder, overwrite=overwrite)

    def expect(self, iterations: int) -> None:
        """Set the planned number of steps, all of the run so far included, for the bar."""
        self._bar.expect(iterations)

    def begin(self) -> int:
        """Begin another attempt at the design, and return its number.

        Its shapes are recorded beside those of earlier attempts, until `keep`.
        """
        self.attempt += 1
        return self.attempt

    def keep(self, attempt: int, last: int, place: int = 0) -> None:
        """Keep the shapes of one attempt, up to its last iteration (collective).

        It takes the place of an earlier attempt, and all after that are forgotten.
        """

        def move() -> None:
            folder = self._folder / FOLDER
            if attempt != place:
                rename(folder, _series(attempt), _series(place))
            for other in range(place + 1, self.attempt + 1):
                forget_from(folder, _series(other), 0)
            forget_from(folder, _series(place), last + 1)

        guarded(self._comm, self._folder, move)
        self.attempt = place

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time in s on this rank since the start: until the first step, and in total."""
        total = time.perf_counter() - self._begin
        return {"setup": total if self._setup is None else self._setup, "total": total}

    def __call__(self, row: Iteration, evaluation: Evaluation[Any]) -> None:
        """Report one iteration and record its shape (collective)."""
        self.report(row)
        shown = gathered_frame(row, evaluation)
        if shown is not None:
            skin, frame = shown
            frame = replace(frame, series=_series(self.attempt))
            guarded(self._comm, self._folder, lambda: write_step(self._folder, skin, frame))

    def restored(self, rows: Sequence[Iteration]) -> None:
        """Take the rows of an interrupted run, without printing them (collective)."""
        self._rows += rows

        def show() -> None:
            if rows:
                self._write_history()
                print_line(f"resumed after iteration {rows[-1].iteration}")

        guarded(self._comm, self._folder, show)

    def report(self, row: Iteration) -> None:
        """Report a row of the history, also one of an earlier part of the design (collective)."""
        first = self._setup is None
        if first:
            self._setup = time.perf_counter() - self._begin - row.seconds
        self._rows.append(row)

        def show() -> None:
            self._write_history()
            if first:
                print_line(header(row))
            print_line(line(row))
            self._bar.advance(row.iteration)

        guarded(self._comm, self._folder, show)

    def _write_history(self) -> None:
        """Write all rows (one rank): the file of an earlier run stays until there is one."""
        write_table(self._folder / "history.csv", [row.columns() for row in self._rows])

    def close(self) -> None:
        """Remove the progress bar."""
        self._bar.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def _series(attempt: int) -> str:
    """Return the name of the series of an attempt's shapes."""
    return f"attempt-{attempt}" if attempt else "iteration"
