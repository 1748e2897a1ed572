"""Rows of many independent cases: shared over processes, and kept as they finish.

A file of JSON lines holds one row for each finished case, with its key. A later run with the same
file skips those cases, so that a run of hours may be stopped and taken up again.
"""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from signal import ITIMER_REAL, SIGALRM, setitimer, signal
from types import FrameType
from typing import Any, TypeVar

Task = TypeVar("Task")
Row = dict[str, Any]


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
