"""Design loops that are stopped and go on."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from toros_fem.base.files import Archive
from toros_fem.design.loop.journal import Journal, JournalEntry
from toros_fem.design.loop.options import Iteration


class Stopped(Exception):  # noqa: N818
    """In place of a signal."""


class OneEntry(Journal, JournalEntry):
    """A journal of one loop in memory, as JSON would have it; it stops the loop after some rows."""

    def __init__(self, stop_at: int | None = None, saved: Archive | None = None) -> None:
        self.stop_at, self.kept, self.rows = stop_at, saved, 0

    def entry(self, comm: MPI.Comm, signature: str) -> OneEntry:
        return self

    def saved(self) -> Archive | None:
        return self.kept

    def offer(self, make: Callable[[], Archive], *, last: bool) -> None:
        self.rows += 1
        if self.rows == self.stop_at:
            made = make()
            self.kept = dataclasses.replace(made, numbers=json.loads(json.dumps(made.numbers)))
            raise Stopped


def figures(row: Iteration) -> dict[str, Any]:
    """All of a row but the wall time."""
    return {name: value for name, value in row.columns().items() if name != "seconds"}
