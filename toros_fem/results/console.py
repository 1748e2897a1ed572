"""Lines, and a progress bar on a terminal, while a design runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from mpi4py import MPI
from tqdm import tqdm

from toros_fem.base.units import duration
from toros_fem.design.loop.options import Iteration
from toros_fem.mechanics.equilibrium.iteration import NewtonStep

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
