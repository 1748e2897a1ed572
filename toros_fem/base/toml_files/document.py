"""A TOML file while it is read: a wrong key or value is told with file, line and remedy."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.files import read_bytes
from toros_fem.base.keys import Key, nearest
from toros_fem.base.toml_files.lines import DEEPEST, Place, key_lines, line_of, too_deep
from toros_fem.base.validation import shown

T = TypeVar("T")
# Characters of a key that a message shows.
LONGEST = 100


class Document:
    """A TOML file that was parsed, with the line of each place, from 1.

    An error of the type `failure` says that the text is no TOML, or a key has too many parts.
    """

    def __init__(self, path: Path, text: str, failure: type[FileError]) -> None:
        self.path, self.failure = path, failure
        if line := too_deep(text):
            raise failure(f"{at(path, line)}: a key has more than {DEEPEST} parts.", path, line)
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except RecursionError:
            raise failure(f"{path}: tables and lists are nested too deeply.", path) from None
        except ValueError as caught:  # an overlong number is no TOMLDecodeError
            why, _, place = str(caught).rpartition(" (at ")
            found = re.match(r"line (\d+)", place)
            line = int(found[1]) if found else text.count("\n") + 1 if why else None
            written = text.split("\n")[line - 1] if line else ""
            if re.match(r"Cannot (overwrite|declare|mutate)", why):
                advice = "this key or table stands in the file already. Keep one of them."
            elif comma := re.search(r"=\s*([-+]?\d+),(\d+)", written):
                advice = f"a number has a comma. Write a point: {comma[1]}.{comma[2]}"
            else:
                advice = (
                    f"{why or place}: this is no TOML. Text needs quotes, and so do values with "
                    'units, as in "5 kPa".'
                )
            raise failure(f"{at(path, line)}: {advice}", path, line) from None
        self.lines = key_lines(text)

    def fail(self, place: Place, message: str) -> NoReturn:
        """Raise the error of a key, or of the whole file where the place is empty."""
        line, key = line_of(self.lines, place), ".".join(map(str, place))
        cut = f"{key[:LONGEST]}{'…' * (len(key) > LONGEST)}"
        message = f"{cut if cut.isprintable() else ascii(cut)}: {message}" if key else message
        raise self.failure(f"{at(self.path, line)}: {message}", self.path, line, key or None)

    def require_known(
        self, place: Place, name: str, known: Collection[str], word: str = "key"
    ) -> None:
        """Check that a key or another word is known."""
        if name not in known:
            self.fail(place, f"unknown {word} {shown(name)}; {self.advice(place, name, known)}")

    def advice(self, place: Place, name: str, known: Collection[str]) -> str:
        """Return the advice for an unknown word: the nearest known one."""
        return nearest(name, known)

    def table(self, at: Place, content: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
        """Return the values of the table at a place, in their units."""
        if not isinstance(content, dict):
            self.fail(at, f"must be a table: write [{at[0]}], and its keys in lines below.")
        found = {}
        for name, value in content.items():
            self.require_known((*at, name), name, keys)
            try:
                found[name] = keys[name].read(value)
            except ParameterError as caught:
                self.fail((*at, name), str(caught))
        return found

    def made(self, of: Callable[..., T], at: Place, values: Mapping[str, Any]) -> T:
        """Return what the values of a table make; a value that fits no other is told by its key."""
        try:
            return of(**values)
        except ParameterError as caught:
            self.fail((*at, str(caught.key)) if caught.key in values else at, str(caught))


def at(path: Path, line: int | None) -> str:
    """Return a place in a file in words; the line may not be known."""
    return f"{path}" if line is None else f"{path}, line {line}"


def read_text(
    path: Path,
    what: str,
    failure: type[FileError],
    size: str = "keys",
    decoded: Callable[[bytes], str] = lambda content: content.decode("utf-8-sig"),
) -> str:
    """Return the text of a file: `what`, "a scene file" for instance, of a size in `MOST_BYTES`.

    Raises:
        FileError: Of the type `failure`: the file cannot be read, is too long, or is no UTF-8.
    """
    try:
        content = read_bytes(path, size)
    except IsADirectoryError:
        raise failure(f"{path} is a folder; name {what}.", path) from None
    except FileNotFoundError:
        raise failure(f"there is no {path}. Check its path.", path) from None
    except (OSError, ValueError) as caught:  # a path with a null character is a ValueError
        advice = "Check the path" if isinstance(caught, OSError) else f"It is not {what}"
        raise failure(f"{path} cannot be read: {caught}. {advice}.", path) from None
    try:
        return decoded(content).replace("\r\n", "\n")
    except UnicodeDecodeError as caught:
        line = content.count(b"\n", 0, caught.start) + 1
        message = f"{at(path, line)}: no UTF-8 text. Save it as UTF-8."
        raise failure(message, path, line) from None
