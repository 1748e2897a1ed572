"""Archives: named arrays and numbers in one .npz file, which is whole or refused."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import TorosError
from toros_fem.base.files import reading, replace_file, require_unpackable
from toros_fem.base.versions import __version__

# Version of the format of archives and of the files of a run; others are refused.
FORMAT = 3
# Names of two more arrays, of bytes: the header, and the SHA-256 of it and of all others.
HEADER, DIGEST = "header", "sha256"
T = TypeVar("T")


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
