"""Rows of many independent cases: shared over processes, and kept as they finish.

A file of JSON lines holds one row for each finished case, with its key. A later run with the same
file skips those cases, so that a run of hours may be stopped and taken up again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from signal import ITIMER_REAL, SIGALRM, setitimer, signal
from types import FrameType
from typing import Any, TypeVar

from mpi4py import MPI

from toros_fem._validate import require_count

Task = TypeVar("Task")
Row = dict[str, Any]


def parser_of(about: str | None, page: Path) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark of many cases.

    Args:
        about: Help text.
        page: The page that holds the tables.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument(
        "--rows",
        type=Path,
        help="JSON lines of what is finished; a rerun with the same code skips those in it",
    )
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--from", type=Path, dest="source", help="run nothing, read this file")
    parser.add_argument("--docs", action="store_true", help="write the tables into the page")
    parser.add_argument("--page", type=Path, default=page, help="the page")
    return parser


def parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Return the options of the command line; processes take the place of ranks."""
    options = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("one rank only: the checks are dense and serial. --workers takes processes.")
    require_count(1, workers=options.workers)
    return options


def read_rows(file: Path | None) -> dict[str, Row]:
    """Return the rows of a file by their keys; a last line that was cut off is left out."""
    rows: dict[str, Row] = {}
    if file is None or not file.exists():
        return rows
    text = file.read_text(encoding="utf-8")
    for line in text[: text.rfind("\n") + 1].splitlines():
        row = json.loads(line)
        rows[row.pop("key")] = row
    return rows


def complete(
    tasks: Mapping[str, Task],
    play: Callable[[Task], Row],
    file: Path | None,
    workers: int = 1,
    report: Callable[[str, Row], None] = lambda key, row: None,
) -> dict[str, Row]:
    """Play the tasks whose rows are not in the file yet.

    Args:
        tasks: Tasks by their keys.
        play: Returns the row of a task; with several workers a function of a module.
        file: JSON lines, to which every row is appended at once; None keeps none.
        workers: Number of processes.
        report: Called with each new row.

    Returns:
        The rows of all tasks in their order.
    """
    rows = read_rows(file)
    if file is not None and file.exists():
        _drop_cut_line(file)
    todo = {key: task for key, task in tasks.items() if key not in rows}
    for key, row in _played(todo, play, workers):
        rows[key] = row
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps({"key": key, **row}, allow_nan=False) + "\n")
        report(key, row)
    return {key: rows[key] for key in tasks}


def _played(
    todo: Mapping[str, Task], play: Callable[[Task], Row], workers: int
) -> Iterator[tuple[str, Row]]:
    if workers == 1:
        yield from ((key, play(task)) for key, task in todo.items())
        return
    # MPI does not survive a fork: every process starts afresh.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        running = {pool.submit(play, task): key for key, task in todo.items()}
        for future in as_completed(running):
            yield running[future], future.result()


def _drop_cut_line(file: Path) -> None:
    """Cut a last line off that has no end: the run before was killed while it wrote."""
    content = file.read_bytes()
    file.write_bytes(content[: content.rfind(b"\n") + 1])


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after a wall time: a hang must not stop the others."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"gave up after {seconds:g} s")

    before = signal(SIGALRM, ring)
    setitimer(ITIMER_REAL, seconds)
    try:
        yield
    finally:
        setitimer(ITIMER_REAL, 0)
        signal(SIGALRM, before)
