"""Tensile tests from CSV files: units from the header or by option, faults by their line."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.base.validation import require_positive, shown
from toros_fem.products.fitting.columns import (
    ACROSS,
    ALONG,
    CONSTANTS,
    EXAMPLES,
    LENGTHS,
    LOADS,
    PER_WIDTH,
    UNITS,
    WORDS,
    known_as,
    nearest_name,
    split_header,
)
from toros_fem.products.fitting.tensile_test import FEWEST, TensileTest

# Largest file in bytes: a machine's test has some thousand rows.
LARGEST = 50_000_000
# Strains above this are most likely in %.
LARGEST_STRAIN = 15.0
_QUANTITY = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(\S*)\s*")


@dataclass(frozen=True)
class Given:
    """What the tables do not say; it overrides what they do.

    Attributes:
        thickness, width, gauge_length: In m; None leaves them to the files.
        direction: Direction of the pull in all files; None leaves it to them.
        units: Unit of a column by what it holds, {"force": "N"}.

    Raises:
        ParameterError: A length is not positive, or a unit or what it is for is unknown.
    """

    thickness: float | None = None
    width: float | None = None
    gauge_length: float | None = None
    direction: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("thickness", "width", "gauge_length"):
            if getattr(self, name) is not None:
                require_positive(**{name: getattr(self, name)})
        for name, unit in self.units.items():
            if name not in UNITS:
                raise ParameterError(
                    f"unit of {name!r}: no such column; known are {', '.join(UNITS)}."
                )
            if unit not in UNITS[name]:
                raise ParameterError(f"unit of {name!r} = {unit!r}: {_units(name)}.")


@dataclass(frozen=True)
class _Column:
    kind: str
    place: int
    factor: float
    per_width: bool


def read_tensile_tests(
    paths: Sequence[str | Path], given: Given | None = None
) -> list[TensileTest]:
    """Read tensile tests from CSV files.

    The columns are named in a header: stretch, strain or extension; force or stress; if measured
    lateral stretch, lateral strain or current width; specimen and direction where a file holds
    several. Other columns are left out. Units stand in brackets, "force [N]". Lines
    "# width = 25 mm" before the header hold for the whole file, as do lengths given here. The
    separator is a comma, a semicolon or a tab; with the last two, numbers may have a decimal comma.

    Args:
        paths: Files.
        given: What the files do not say.

    Returns:
        One test for each specimen and direction of each file.

    Raises:
        MeasurementError: A file cannot be read, a line is wrong, or something is missing.
    """
    given = given or Given()
    found = [test for path in paths for test in _read(Path(path), given)]
    if not found:
        raise MeasurementError("no file of a test is given.")
    return found


def _read(path: Path, given: Given) -> list[TensileTest]:
    table = _Table(path, _lines(path), given)
    return table.tests()


def _lines(path: Path) -> list[str]:
    try:
        if path.stat().st_size > LARGEST:
            raise MeasurementError(
                f"{path} has more than {LARGEST / 1e6:.0f} MB: thin the rows out.", path
            )
        content = path.read_bytes()
    except OSError as error:
        raise MeasurementError(f"{path} cannot be read: {error.strerror}.", path) from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise MeasurementError(
            f"{path}, line {line}: this is not UTF-8 text. Save the table as CSV in UTF-8.",
            path, line,
        ) from None  # fmt: skip
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise MeasurementError(f"{path}, line {line}: a zero byte: no table as text.", path, line)
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


class _Table:
    """The table of a file, while it is read."""

    def __init__(self, path: Path, lines: list[str], given: Given) -> None:
        self.path, self.lines, self.given = path, lines, given
        self.constants: dict[str, float | str] = {}
        self.header_line = self._read_constants()
        header = lines[self.header_line - 1]
        self.separator = next((c for c in ";\t" if c in header), ",")
        self.columns = self._read_header(header)
        for name in ("width", "thickness", "gauge length"):
            value = getattr(given, name.replace(" ", "_"))
            if value is not None:
                self.constants[name] = value
        if given.direction is not None:
            self.constants["direction"] = given.direction

    def fault(self, line: int | None, what: str, key: str | None = None) -> MeasurementError:
        place = f"{self.path}" if line is None else f"{self.path}, line {line}"
        return MeasurementError(f"{place}: {what}", self.path, line, key)

    def _read_constants(self) -> int:
        """Read the lines before the header, and return the header's line, from 1."""
        for number, line in enumerate(self.lines, start=1):
            if not line.strip():
                continue
            if not line.lstrip().startswith("#"):
                return number
            name, equals, value = line.lstrip().lstrip("#").partition("=")
            kind = known_as(split_header(name)[0])
            if equals and kind in CONSTANTS:
                self.constants[kind] = self._constant(number, kind, value.strip())
        raise self.fault(None, "there is no table: no line but comments.")

    def _constant(self, number: int, kind: str, text: str) -> float | str:
        if kind in WORDS:
            if not text:
                raise self.fault(number, f"the {kind} is empty.", kind)
            return text[:80]
        match = _QUANTITY.fullmatch(text)
        if match is None or match[2] not in LENGTHS:
            raise self.fault(
                number,
                f"{kind} = {shown(text)} must be a length with its unit, as in "
                f"'{kind} = {EXAMPLES[kind]}'.",
                kind,
            )
        value = self._number(number, kind, match[1]) * LENGTHS[match[2]]
        if not value > 0:
            raise self.fault(number, f"{kind} = {shown(text)} must be greater than 0.", kind)
        return value

    def _read_header(self, header: str) -> list[_Column]:
        found: list[_Column] = []
        line = self.header_line
        cells = self._cells(line, header)
        for place, cell in enumerate(cells):
            name, unit = split_header(cell)
            kind = known_as(name)
            if kind is None:
                near = nearest_name(name)
                if near is not None:
                    raise self.fault(
                        line, f"unknown column {shown(cell)}; did you mean {near!r}?", name
                    )
                continue
            if any(other.kind == kind for other in found):
                raise self.fault(line, f"two columns hold the {kind}.", kind)
            found.append(self._column(line, kind, place, unit))
        self._require(line, found, cells)
        return found

    def _column(self, line: int, kind: str, place: int, unit: str | None) -> _Column:
        if kind in WORDS:
            return _Column(kind, place, 1.0, per_width=False)
        unit = self.given.units.get(kind, unit)
        if unit is None and "" in UNITS[kind]:
            unit = ""
        if unit is None:
            first = next(iter(UNITS[kind]))
            raise self.fault(
                line, f"the column {kind!r} has no unit: write '{kind} [{first}]', or give the "
                f"unit by option, --unit \"{kind}={first}\".", kind,
            )  # fmt: skip
        if unit not in UNITS[kind]:
            raise self.fault(line, f"the column {kind!r} is in {unit!r}; {_units(kind)}.", kind)
        return _Column(kind, place, UNITS[kind][unit], per_width=unit in PER_WIDTH)

    def _require(self, line: int, found: list[_Column], cells: list[str]) -> None:
        kinds = [column.kind for column in found]
        for choice, what in ((ALONG, "stretch"), (LOADS, "force"), (ACROSS, "lateral stretch")):
            number = sum(kind in choice for kind in kinds)
            if number == 0 and choice is not ACROSS:
                raise self.fault(
                    line, f"no column holds the {what}: one of {', '.join(choice)} is needed; the "
                    f"header has {shown(', '.join(cell.strip() for cell in cells))}.", what,
                )  # fmt: skip
            if number > 1:
                twice = " and ".join(kind for kind in kinds if kind in choice)
                raise self.fault(line, f"{twice} say the same: leave all but one out.", what)

    def _cells(self, line: int, text: str) -> list[str]:
        try:
            return next(csv.reader([text], delimiter=self.separator, strict=True), [])
        except csv.Error as error:
            raise self.fault(line, f"the line cannot be split: {error}.") from None

    def _number(self, line: int, kind: str, text: str) -> float:
        text = text.strip()
        plain = text.replace(",", ".") if text.count(",") == 1 and "." not in text else text
        try:
            value = float(plain) if "_" not in plain else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            what = "is empty" if not text else f"= {shown(text)} is no finite number"
            raise self.fault(line, f"{kind} {what}.", kind)
        return value

    def _rows(self) -> Iterator[tuple[int, dict[str, float | str]]]:
        width = len(self._cells(self.header_line, self.lines[self.header_line - 1]))
        for number in range(self.header_line + 1, len(self.lines) + 1):
            text = self.lines[number - 1]
            if not text.strip() or text.lstrip().startswith("#"):
                continue
            cells = self._cells(number, text)
            if len(cells) != width:
                raise self.fault(
                    number, f"the line has {len(cells)} values, but the header {width} columns."
                )
            row: dict[str, float | str] = {}
            for column in self.columns:
                cell = cells[column.place]
                if column.kind in WORDS:
                    row[column.kind] = cell.strip()[:80]
                else:
                    row[column.kind] = column.factor * self._number(number, column.kind, cell)
            yield number, row

    def tests(self) -> list[TensileTest]:
        """Return the tests of the table."""
        groups: dict[tuple[str, str], list[tuple[int, dict[str, float | str]]]] = {}
        named = {
            "specimen": self.constants.get("specimen", self.path.stem),
            "direction": self.constants.get("direction", ""),
        }
        overridden = self.given.direction is not None
        for number, row in self._rows():
            if overridden:
                row["direction"] = self.given.direction or ""
            key = (
                str(row.get("specimen") or named["specimen"]),
                str(row.get("direction", named["direction"])).lower(),
            )
            groups.setdefault(key, []).append((number, row))
        if not groups:
            raise self.fault(self.header_line, "the header has no rows of numbers after it.")
        return [self._test(*key, rows) for key, rows in groups.items()]

    def _test(
        self, specimen: str, direction: str, rows: list[tuple[int, dict[str, float | str]]]
    ) -> TensileTest:
        first = rows[0][0]
        if len(rows) < FEWEST:
            raise self.fault(
                first, f"specimen {specimen!r} has {len(rows)} rows; at least {FEWEST} are needed."
            )
        kinds = {column.kind for column in self.columns}
        numbers = np.array([number for number, _ in rows])

        def values(kind: str) -> Floats:
            return np.array([row[kind] for _, row in rows], dtype=np.float64)

        def length(kind: str, why: str) -> Floats | float:
            option = kind.replace(" ", "-")
            if getattr(self.given, kind.replace(" ", "_")) is None and kind in kinds:
                found = values(kind)
                if not (found > 0).all():
                    line = int(numbers[~(found > 0)][0])
                    raise self.fault(line, f"the {kind} must be greater than 0.", kind)
                return found
            if kind not in self.constants:
                raise self.fault(
                    first, f"the {kind} is not known, but {why}: write a line '# {kind} = "
                    f"{EXAMPLES[kind]}', or give --{option}.", kind,
                )  # fmt: skip
            return float(self.constants[kind])

        if "stretch" in kinds:
            stretch = values("stretch")
        elif "strain" in kinds:
            stretch = 1 + values("strain")
        else:
            stretch = np.asarray(
                1 + values("extension") / length("gauge length", "the extension needs it")
            )
        self._check(numbers, stretch, "stretch")
        thickness = float(np.mean(length("thickness", "the modulus needs it")))
        if "force" in kinds:
            stress = np.asarray(values("force") / length("width", "the force needs it"))
        else:
            per_width = next(c.per_width for c in self.columns if c.kind == "stress")
            stress = values("stress") * (1.0 if per_width else thickness)
        lateral = None
        if "lateral stretch" in kinds:
            lateral = values("lateral stretch")
        elif "lateral strain" in kinds:
            lateral = 1 + values("lateral strain")
        elif "lateral width" in kinds:
            lateral = np.asarray(
                values("lateral width") / length("width", "the current width needs it")
            )
        if lateral is not None:
            self._check(numbers, lateral, "lateral stretch")
        if not float(np.max(np.abs(stress))) > 0:
            raise self.fault(first, f"specimen {specimen!r}: all forces are 0.")
        return TensileTest(stretch, stress, thickness, lateral, specimen, direction)

    def _check(self, numbers: Floats, stretch: Floats, what: str) -> None:
        """Refuse stretches that no test has; most come from a wrong unit."""
        low, high = stretch <= 0, stretch > 1 + LARGEST_STRAIN
        if low.any():
            line = int(numbers[low][0])
            raise self.fault(
                line, f"the {what} is {stretch[low][0]:.6g}; it is positive, 1 at rest.", what
            )
        if high.any():
            line = int(numbers[high][0])
            raise self.fault(
                line, f"the {what} is {stretch[high][0]:.6g}. Is the strain in %? Write "
                "'strain [%]'.", what,
            )  # fmt: skip
        if not np.ptp(stretch) > 0:
            raise self.fault(int(numbers[0]), f"the {what} is the same in all rows.", what)


def _units(kind: str) -> str:
    return "known are " + ", ".join(word for word in UNITS[kind] if word)
