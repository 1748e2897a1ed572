"""Progress of a run: lines and a bar on the console, and a shape for each step."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI
from tqdm import tqdm

from toros_fem.base.files import guarded, write_table
from toros_fem.base.keys import duration
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import Evaluation
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.results.runs.frames import FOLDER, forget_from, rename
from toros_fem.results.runs.open_run import begin_folder
from toros_fem.results.runs.record import gathered_frame, write_step

Item = TypeVar("Item")
# Least width of a column that holds a metric.
METRIC_WIDTH = 12
# Time in s between two lines on the progress, where there is no terminal.
LINE_EVERY = 30.0


def print_line(text: str) -> None:
    """Print a line above the progress bar, if there is one (one rank)."""
    tqdm.write(text, file=sys.stdout)
    sys.stdout.flush()


def print_step(comm: MPI.Comm) -> Callable[[NewtonStep | str], None]:
    """Return a log for `EquilibriumSolver` that prints each Newton step on the first rank."""

    def show(row: NewtonStep | str) -> None:
        if comm.rank == 0:
            print_line(f"    {row}")

    return show


def header(row: Iteration) -> str:
    """Return the titles of the columns of `line`."""
    titles = [_title(key) for key in row.metrics]
    metrics = "".join(f"  {t:>{_width(t) - 2}}" for t in titles)
    return (
        f"  it  level  stage   objective{metrics}  kPa     volume   grey   g_r"
        "      g_t     rejected  newton  seconds"
    )


def line(row: Iteration) -> str:
    """Return a row of the history as a line of text."""
    metrics = "".join(f"{value:{_width(_title(key))}.2f}" for key, value in row.metrics.items())
    return (
        f"{row.iteration:4d}  {row.level:5d}  {row.stage:5d}  {row.objective:10.4e}{metrics}"
        f"  {row.pressure / 1e3:6.3f}  {row.volume_fraction:6.3f}  {row.grey_level:5.3f}"
        f"  {row.g_r:7.1e}  {row.g_t:7.1e}  {row.rejected:8d}  {row.newton_steps:6d}"
        f"  {row.seconds:7.2f}"
    )


def _title(key: str) -> str:
    """Return "angle/deg" for the key "angle_deg"."""
    name, _, unit = key.rpartition("_")
    return f"{name}/{unit}" if name else key


def _width(title: str) -> int:
    return max(METRIC_WIDTH, len(title) + 2)


class ProgressBar:
    """The number of steps done and the time left: a bar on a terminal, else lines now and then.

    The time left is that of the steps so far, those of a resumed run left out. Steps on finer
    meshes take longer.

    Args:
        unit: What a step is.
    """

    def __init__(self, unit: str = "step") -> None:
        self._unit = unit
        self._bar: tqdm | None = None
        self._total: int | None = None
        self._first: tuple[int, float] | None = None  # step, and time in s
        self._said = 0.0

    def expect(self, total: int) -> None:
        """Set the planned number of steps."""
        self._total = total
        if self._bar is not None:
            self._bar.total = total
            self._bar.refresh()

    def advance(self, done: int) -> None:
        """Show how many steps are done; the last planned one removes the bar."""
        now = time.monotonic()
        if self._first is None or done < self._first[0]:
            self._first, self._said = (done, now), now
        first, begin = self._first
        if self._total is None or done >= self._total:
            self.close()
        elif sys.stderr.isatty():
            if self._bar is None:
                self._bar = tqdm(
                    total=self._total, initial=done, unit=self._unit, file=sys.stderr,
                    mininterval=0, leave=False,
                )  # fmt: skip
            self._bar.update(done - self._bar.n)
        elif done > first and now >= self._said + LINE_EVERY:
            self._said = now
            left = (now - begin) / (done - first) * (self._total - done)
            print_line(f"{self._unit} {done} of {self._total}, about {duration(left)} left")

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def with_progress(comm: MPI.Comm, items: Iterable[Item], total: int, unit: str) -> Iterator[Item]:
    """Yield items, and show on the first rank how many of all are done."""
    bar = ProgressBar(unit)
    bar.expect(total)
    try:
        for done, item in enumerate(items):
            if comm.rank == 0:
                bar.advance(done)
            yield item
    finally:
        bar.close()


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
