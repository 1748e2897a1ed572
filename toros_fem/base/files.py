"""Files that are whole or absent, and files that the first rank writes for all."""

from __future__ import annotations

import csv
import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from toros_fem.base.errors import OutputError, TorosError
from toros_fem.base.mpi import on_first_rank

T = TypeVar("T")
# Characters of a reason.
LONGEST = 150
# What is said of a folder or file that the system refuses.
UNWRITTEN = (
    "{} could not be written: {}. Choose another folder, or free some space. Files that are "
    "already written stay."
)
# Ending of files that are being written.
UNFINISHED = ".unfinished"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Hand out a path beside a file; what the block writes there takes its place at the end.

    It is forced to the disk and renamed, so that the file is never seen half written, whatever
    happens (one rank).

    Raises:
        OSError: It cannot be written; what was there before stays.
    """
    beside = path.with_name(path.name + UNFINISHED)
    try:
        yield beside
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file as `replacing` does (one rank)."""
    with replacing(path) as beside:
        beside.write_bytes(content)


def reason(caught: Exception) -> str:
    """Return what an error says of a damaged file, in one line: zipfile may quote half of it."""
    text = str(caught)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"


def read_json(path: Path) -> dict[str, Any]:
    """Return what a JSON file of a run holds, empty if there is none (one rank).

    Raises:
        OutputError: It cannot be read, or holds something else.
    """
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as caught:
        raise OutputError(f"{path} cannot be read: {caught}. Delete it, or mend it.") from None
    if not isinstance(content, dict):
        raise OutputError(f"{path} holds no summary of a run. Delete it.")
    return content


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as JSON, numbers in full precision (one rank)."""
    replace_file(path, (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode())


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV (one rank); a column that a row does not have stays empty there."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns)
    writer.writeheader()
    writer.writerows(rows)
    replace_file(path, text.getvalue().encode())


@contextmanager
def naming(
    path: Path, error: type[Exception] = OutputError, says: str = UNWRITTEN
) -> Iterator[None]:
    """Raise errors of the system in the block as one that names a path and what to do.

    Args:
        path: The path.
        error: Type of the error.
        says: What it says, with places for the path and for the reason.
    """
    try:
        yield
    except TorosError:
        raise
    except OSError as caught:
        raise error(says.format(path, caught)) from None


def guarded(
    comm: MPI.Comm,
    folder: str | Path,
    action: Callable[[], T],
    error: type[Exception] = OutputError,
    says: str = UNWRITTEN,
    *,
    make: bool = True,
) -> T:
    """Do something with a folder on the first rank, and return what it finds (collective).

    Args:
        comm: Communicator.
        folder: The folder.
        action: Reads or writes its files.
        error, says: As of `naming`.
        make: Whether the folder is made if it is missing.

    Raises:
        Exception: `error`, or what the action raises; on all ranks.
    """
    folder = Path(folder)

    def named() -> T:
        with naming(folder, error, says):
            if make:
                folder.mkdir(parents=True, exist_ok=True)
            return action()

    return on_first_rank(comm, named)


def if_possible(what: str, write: Callable[[], Any]) -> None:
    """Write what a run can do without, or print in one line why there is none (one rank)."""
    try:
        write()
    except TorosError as missing:
        print(f"no {what}: {missing}", file=sys.stderr)


def if_plotting(draw: Callable[[], None]) -> None:
    """Draw pictures, or print in one line which package is missing for them (one rank)."""
    try:
        draw()
    except ImportError as missing:
        print(f"no pictures: {missing}; pip install toros_fem[plot]", file=sys.stderr)
