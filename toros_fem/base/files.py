"""Files that are whole or refused: written beside and moved, read with bounds; archives."""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import json
import os
import secrets
import stat
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.errors import OutputError, TorosError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import __version__

T = TypeVar("T")
# Most bytes of a file that is read whole, by what it is, far beyond what makes sense.
MOST_BYTES = {"keys": 1_000_000, "table": 50_000_000, "JSON": 100_000_000, "mesh": 1_000_000_000}
# Most bytes of what a packed file holds: these, or as many for each byte of the file.
UNPACKED, EXPANSION = 256_000_000, 100
# Characters of a reason.
LONGEST = 150
# What is said of a folder or file that the system refuses.
UNWRITTEN = (
    "{} could not be written: {}. Choose another folder, or free some space. Files that are "
    "already written stay."
)
# Ending of files that are being written.
UNFINISHED = ".unfinished"
# What may stand where a file is written.
_REPLACED = (stat.S_IFREG, stat.S_IFLNK)
# Version of the format of archives and of the files of a run; others are refused.
FORMAT = 3
# Names of two more arrays, of bytes: the header, and the SHA-256 of it and of all others.
HEADER, DIGEST = "header", "sha256"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Hand out a new file beside another; what the block writes there takes its place at the end.

    It is forced to the disk and renamed, so that the file is never seen half written, whatever
    happens. Of a link the name is taken, and what it points at stays (one rank).

    Raises:
        OSError: It cannot be written, or is a device or a folder; what was there before stays.
    """
    if os.path.lexists(path) and stat.S_IFMT(os.lstat(path).st_mode) not in _REPLACED:
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    beside = path.with_name(f".{secrets.token_hex(8)}{UNFINISHED}")
    try:
        os.close(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as caught:
        raise OSError(caught.errno, caught.strerror, str(path)) from None
    try:
        yield beside
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes were writing into a folder that is locked (one rank)."""
    for path in (*folder.glob(f".*{UNFINISHED}"), *folder.glob(f"*/.*{UNFINISHED}")):
        if path.parent == folder or not path.parent.is_symlink():
            path.unlink(missing_ok=True)


def require_unused(folder: Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Check that no file has a name that is written, unless it may be replaced (one rank).

    Raises:
        OutputError: There is one; the message says what to do.
    """
    taken = [name for name in names if os.path.lexists(folder / name)]
    if taken and not overwrite:
        raise OutputError(
            f"{folder} has {', '.join(taken)}, which would be replaced. Choose another folder, or "
            "replace them by --overwrite; nothing was done to them."
        )


def replace_file(path: Path, content: bytes) -> None:
    """Write a file as `replacing` does (one rank)."""
    with replacing(path) as beside:
        beside.write_bytes(content)


def reason(caught: Exception) -> str:
    """Return what an error says of a damaged file, in one line: zipfile may quote half of it."""
    known = caught.strerror if isinstance(caught, OSError) else None
    text = " ".join((known or str(caught)).split()).rstrip(".") or type(caught).__name__
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"


@contextmanager
def reading(path: Path, failure: type[TorosError], remedy: str) -> Iterator[None]:
    """Raise whatever a reader raises in the block as one error that names a file and a remedy.

    Errors of the package pass. A damaged file may raise anything: UnicodeDecodeError,
    RecursionError, MemoryError … A pipe is refused: its reader would wait for ever.
    """
    try:
        if path.is_fifo():
            raise ValueError("it is a pipe, and no file")
        yield
    except Exception as caught:
        ours = isinstance(caught, TorosError)
        why = f"{path} cannot be read: {reason(caught)}. {remedy}"
        raise (caught if ours else failure(why)) from None


def read_bytes(path: Path, what: str) -> bytes:
    """Return the content of a file, `what` of `MOST_BYTES` (one rank).

    Raises:
        OSError: It cannot be read.
        ValueError: It is longer than such files are.
    """
    most, content = MOST_BYTES[what], bytearray()
    with path.open("rb") as file:
        while part := file.read(2**20):  # a file may be endless, as a device is
            content += part
            if len(content) > most:
                raise ValueError(f"it is longer than {most} bytes")
    return bytes(content)


def require_unpackable(path: Path) -> None:
    """Check the size of what a zip file unpacks to, before it is read (one rank).

    Raises:
        OSError, zipfile.BadZipFile: It cannot be read, or is none.
        ValueError: It would fill the memory.
    """
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            raise zipfile.BadZipFile("it is no zip file")
    with zipfile.ZipFile(path) as packed:
        size = sum(one.file_size for one in packed.infolist())
    if size > max(UNPACKED, EXPANSION * path.stat().st_size):
        raise ValueError(f"it would unpack to {size} bytes")


def read_json(
    path: Path, failure: type[TorosError] = OutputError, remedy: str = "Delete it, or mend it."
) -> dict[str, Any]:
    """Return what a JSON file of a run holds, empty without one, or raise `failure` (one rank)."""
    with reading(path, failure, remedy):
        try:
            content = json.loads(read_bytes(path, "JSON"))
        except (FileNotFoundError, NotADirectoryError):
            return {}
        if not isinstance(content, dict):
            raise TypeError("it holds no table")
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

    `says` is its text, with places for the path and for the reason.
    """
    try:
        yield
    except OSError as caught:
        ours = isinstance(caught, TorosError)
        raise (caught if ours else error(says.format(path, reason(caught)))) from None


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

    With `make` the folder is made if it is missing.

    Raises:
        Exception: `error`, as of `naming`, or what the action raises; on all ranks.
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
        print(f"no pictures: {missing}; in the checkout: pip install '.[plot]'", file=sys.stderr)


# --------------------------------------------------------------------------------------- archives


@dataclass(frozen=True, eq=False)
class Archive:
    """What an archive holds.

    Attributes:
        kind: What it is: "pattern", for instance.
        arrays: Arrays by name, of numbers or truth values; what belongs to triangles, vertices or
            edges is in the pattern's order.
        numbers: Everything else, as JSON has it.
        written_by: Version of the package that wrote it.
    """

    kind: str
    arrays: Mapping[str, npt.NDArray[Any]]
    numbers: Mapping[str, Any]
    written_by: str = __version__

    @cached_property
    def header(self) -> bytes:
        """All but the arrays, and their types and shapes, as JSON, or a TypeError."""
        content = {
            "is": f"toros_fem {self.kind}",
            "format": FORMAT,
            "toros_fem": self.written_by,
            "arrays": _described(self.arrays),
            "numbers": self.numbers,
        }
        return json.dumps(content, ensure_ascii=False, default=_plain).encode()

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the header and of all arrays."""
        return _digest(self.header, self.arrays)


def write_archive(path: Path, archive: Archive, *, compress: bool = True) -> None:
    """Write an archive that is never seen half written (one rank).

    Raises:
        OSError: It cannot be written; an earlier one stays.
    """
    entries = {
        HEADER: np.frombuffer(archive.header, np.uint8),
        DIGEST: np.frombuffer(archive.digest.encode(), np.uint8),
    }
    out = io.BytesIO()
    save: Callable[..., None] = np.savez_compressed if compress else np.savez
    save(out, **entries, **archive.arrays)
    replace_file(path, out.getvalue())


def read_archive(
    path: Path, kind: str, make: Callable[[Archive], T], failure: type[TorosError], remedy: str
) -> T:
    """Read an archive of a kind and make something of it (one rank).

    Raises:
        TorosError: `failure`, with the remedy as its last sentence: there is no such file, it is
            damaged, of another kind or format, or `make` raises.
    """
    with reading(path, failure, remedy):
        require_unpackable(path)
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header, digest = (arrays.pop(name, np.zeros(0)).tobytes() for name in (HEADER, DIGEST))
        about: dict[str, Any] = dict(json.loads(header or b"{}"))
    whole = _digest(header, arrays).encode() == digest and about.get("arrays") == _described(arrays)
    fault = "" if whole else "is damaged: its content is not what was written"
    if about.get("is") != f"toros_fem {kind}":
        fault = f"is another kind of file, or was written before format {FORMAT}"
    elif about.get("format") != FORMAT:
        fault = (
            f"has format {about.get('format')}, written by toros_fem {about.get('toros_fem')}; "
            f"this is {__version__} and reads format {FORMAT}. Read it with that version"
        )
    if fault:
        raise failure(f"{path} {fault}. {remedy}")
    try:
        return make(Archive(kind, arrays, about["numbers"], about["toros_fem"]))
    except Exception as caught:
        what = f"it lacks {caught}" if isinstance(caught, KeyError) else str(caught).rstrip(".")
        raise failure(f"{path} is not valid: {what}. {remedy}") from None


def _plain(value: object) -> Any:
    """Return a number of NumPy's own types as JSON has it."""
    assert isinstance(value, np.generic)
    return value.item()


def _described(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, list[Any]]:
    """Return type and shape of each array, by name."""
    return {name: [arrays[name].dtype.str, [*arrays[name].shape]] for name in sorted(arrays)}


def _digest(header: bytes, arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    found = hashlib.sha256(header)
    for name in sorted(arrays):
        found.update(arrays[name].tobytes())
    return found.hexdigest()
