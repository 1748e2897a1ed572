"""A TOML file while it is read: a wrong key or value is told with file, line and remedy."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, NoReturn

from toros_fem.base.errors import FileKeyError
from toros_fem.base.toml_files.lines import Place, key_lines, line_of

# Longest file in bytes, far beyond what makes sense.
LONGEST = 1_000_000


class Document:
    """A TOML file that was parsed.

    Attributes:
        path: The file.
        content: Its tables and keys.
        lines: Line of each place, from 1.
        failure: Type of the errors.

    Raises:
        FileKeyError: Of the type `failure`: the text is no TOML.
    """

    def __init__(self, path: Path, text: str, failure: type[FileKeyError]) -> None:
        self.path, self.failure = path, failure
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except RecursionError:
            raise failure(f"{path}: tables and lists are nested too deeply.", path) from None
        except ValueError as caught:  # an overlong number is no TOMLDecodeError
            place = re.search(r" ?\(at line (\d+), column \d+\)", str(caught))
            line = None if place is None else int(place.group(1))
            if "end of document" in str(caught):
                line = text.count("\n") + 1
            message = re.sub(r" ?\(at [^)]*\)$", "", str(caught))
            at = f"{path}" if line is None else f"{path}, line {line}"
            raise failure(
                f"{at}: {message}: this is no TOML. Text needs quotes, and so do values with "
                'units, as in "5 kPa".',
                path,
                line,
            ) from None
        self.lines = key_lines(text)

    def fail(self, place: Place, message: str) -> NoReturn:
        """Raise the error of a key."""
        line, key = line_of(self.lines, place), ".".join(map(str, place))
        at = f"{self.path}" if line is None else f"{self.path}, line {line}"
        raise self.failure(f"{at}: {key}: {message}", self.path, line, key)


def read_text(path: Path, what: str, failure: type[FileKeyError], longest: int = LONGEST) -> str:
    """Return the text of a file.

    Args:
        path: The file.
        what: What it is, for messages: "a scene file".
        failure: Type of the error.
        longest: Most bytes that it may have.

    Raises:
        FileKeyError: Of the type `failure`: the file cannot be read, is too long, or is no UTF-8.
    """
    try:
        if path.is_dir():
            raise failure(f"{path} is a folder; name {what}.", path)
        with path.open("rb") as file:
            content = file.read(longest + 1)
    except (OSError, ValueError) as caught:  # a path with a null character is a ValueError
        if isinstance(caught, failure):
            raise
        raise failure(f"{path} cannot be read: {caught}. Check the path.", path) from None
    if len(content) > longest:
        raise failure(f"{path} is longer than {longest} bytes: it is not {what}.", path)
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as caught:
        line = content.count(b"\n", 0, caught.start) + 1
        raise failure(
            f"{path}, line {line}: no UTF-8 text. Save it as UTF-8.", path, line
        ) from None
