"""Tensile tests from CSV files: columns as arrays first, then formulas; faults by their line."""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.base.toml_files.document import read_text
from toros_fem.base.units import read_quantity, spelt
from toros_fem.base.validation import require_positive, shown
from toros_fem.products.fitting.columns import (
    ACROSS,
    ALONG,
    KINDS,
    LOADS,
    PER_WIDTH,
    SIZES,
    WORDS,
    factor_of,
    split_header,
)
from toros_fem.products.fitting.tensile_test import TensileTest

# Largest file in bytes: a machine's test has some thousand rows.
LARGEST = 50_000_000
# No sheet is pulled further. A strain without a unit is most likely in % from the second on.
LARGEST_STRAIN, LARGEST_PLAIN_STRAIN = 15.0, 2.0


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
            factor_of(name, unit)


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
    found = [test for path in paths for test in _tests(read_table(Path(path), given))]
    if not found:
        raise MeasurementError("no file of a test is given.")
    return found


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file.

    Attributes:
        path: The file.
        lines: Line of each row in the file, from 1, (n,).
        columns: Words, and numbers in SI units, by what they are, (n,) each. What is said once for
            the file fills a column.
        units: Units of the columns as the file has them; empty where there is none.
    """

    path: Path
    lines: Ints
    columns: Mapping[str, Any]
    units: Mapping[str, str]

    def require(self, fine: Bools, kind: str, values: Floats, why: str) -> None:
        """Check that all rows are fine; the error names the first other one."""
        if not fine.all():
            row = int(np.argmin(fine))
            with _at(self.path, self.lines[row]):
                raise ParameterError(f"the {kind} is {values[row]:.6g}; {why}")

    def size(self, kind: str, why: str) -> Floats:
        """Return a size of each row; `why` says what needs it."""
        if kind not in self.columns:
            with _at(self.path, self.lines[0]):
                raise ParameterError(
                    f"the {kind} is not known, but {why}: write a line '# {kind} = {SIZES[kind]}', "
                    f"or give --{kind.replace(' ', '-')}."
                )
        values: Floats = self.columns[kind]
        self.require(values > 0, kind, values, "it must be greater than 0.")
        return values


@contextmanager
def _at(path: Path, line: int) -> Iterator[None]:
    """Name file and line where something is wrong."""
    try:
        yield
    except (ParameterError, csv.Error) as error:
        what = f"the line cannot be split: {error}." if isinstance(error, csv.Error) else error
        raise MeasurementError(f"{path}, line {line}: {what}", path, int(line)) from None


def read_table(path: Path, given: Given) -> Table:
    """Read the columns of a file, with what the file or the caller says once.

    Raises:
        MeasurementError: The file is no table of a test, or a cell is no number.
    """
    text = read_text(path, "a table of a tensile test", MeasurementError, LARGEST)
    lines = {k: line for k, line in enumerate(re.split("[\r\n]", text), start=1) if line.strip()}
    filled = [k for k, line in lines.items() if not line.lstrip().startswith("#")]
    if not filled:
        raise MeasurementError(f"{path}: there is no table: no line but comments.", path)
    begin, *places = filled
    mark = next((one for one in ";\t" if one in lines[begin]), ",")
    once: dict[str, Any] = {"specimen": path.stem, "direction": ""}
    for k in [k for k in lines if k < begin]:
        with _at(path, k):
            once |= _said_once(lines[k], mark)
    with _at(path, begin):
        cells = _cells(lines[begin], mark)
        header, width = _header(cells, given), len(cells)
        if not places:
            raise ParameterError("the header has no rows of numbers after it.")
    rows = []
    for k in places:
        with _at(path, k):
            cells = _cells(lines[k], mark)
            if len(cells) != width:
                counts = f"{len(cells)} values, but the header {width} columns"
                raise ParameterError(f"the line has {counts}.")
            rows.append([_value(kind, cells[place].strip(), mark) for place, kind, _ in header])
    units = {kind: unit for _, kind, unit in header}
    table = Table(path, np.array(places), _columns(units, rows, once, given), units)
    for kind in ("strain", "lateral strain"):
        if units.get(kind) == "":
            strain = table.columns[kind]
            advice = f"is it in %? Write '{kind} [%]', or '{kind} [1]' if it is a ratio."
            table.require(np.abs(strain) <= LARGEST_PLAIN_STRAIN, kind, strain, advice)
    return table


def _said_once(text: str, mark: str) -> dict[str, float | str]:
    """Return what a line "# width = 25 mm" says for the whole file; nothing of other comments."""
    name, equals, value = text.strip().lstrip("#").partition("=")
    kind, value = KINDS.get(split_header(name)[0], ""), value.strip()
    if not equals or kind not in (*WORDS, *SIZES):
        return {}
    if kind in WORDS:
        if not value:
            raise ParameterError(f"the {kind} is empty.")
        return {kind: value[:80]}
    try:
        size = read_quantity(_pointed(kind, value, mark), "m")
    except ParameterError as error:
        raise ParameterError(f"{error} Write '# {kind} = {SIZES[kind]}'.") from None
    if not size > 0:
        raise ParameterError(f"{kind} = {shown(value)} must be greater than 0.")
    return {kind: size}


def _cells(line: str, mark: str) -> list[str]:
    return next(csv.reader([line], delimiter=mark, strict=True))


def _pointed(kind: str, text: str, mark: str) -> str:
    """Return a number's text with a decimal point; a comma is one where it separates no columns."""
    if mark == "," and "," in text:
        raise ParameterError(
            f"{kind} = {shown(text)} has a comma, which separates the columns here: write a "
            "decimal point, or separate the columns by semicolons."
        )
    return text.replace(",", ".")


def _value(kind: str, text: str, mark: str) -> float | str:
    """Return the finite number of a cell, or its words."""
    if kind in WORDS:
        return text[:80]
    plain = _pointed(kind, text, mark)
    try:
        value = float(plain) if "_" not in plain else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        what = f"= {shown(text)} is no finite number" if text else "is empty"
        raise ParameterError(f"{kind} {what}.")
    return value


def _header(cells: Sequence[str], given: Given) -> list[tuple[int, str, str]]:
    """Return place, kind and unit of the columns that are known."""
    found: dict[str, tuple[int, str, str]] = {}
    for place, cell in enumerate(cells):
        name, unit = split_header(cell)
        kind = KINDS.get(name, "")
        if kind in found:
            raise ParameterError(f"two columns hold the {kind}.")
        if kind:
            unit = "" if kind in WORDS else given.units.get(kind, unit)
            found[kind] = place, kind, spelt(unit)
            factor_of(*found[kind][1:])
        elif near := difflib.get_close_matches(name, KINDS, n=1, cutoff=0.8):
            raise ParameterError(f"unknown column {shown(cell)}; did you mean {near[0]!r}?")
    for choice, what in ((ALONG, "stretch"), (LOADS, "force"), (ACROSS, "lateral stretch")):
        same = [kind for kind in found if kind in choice]
        if len(same) > 1:
            raise ParameterError(f"{' and '.join(same)} say the same: leave all but one out.")
        if not same and choice is not ACROSS:
            raise ParameterError(
                f"no column holds the {what}: one of {', '.join(choice)} is needed; the header has "
                f"{shown(', '.join(cell.strip() for cell in cells))}."
            )
    return list(found.values())


def _columns(
    units: Mapping[str, str],
    rows: Sequence[Sequence[float | str]],
    once: Mapping[str, Any],
    given: Given,
) -> dict[str, Any]:
    """Return the columns of all rows in SI units, with those that file or caller say once."""
    found: dict[str, Any] = {
        kind: values if kind in WORDS else factor_of(kind, unit) * np.array(values)
        for (kind, unit), values in zip(units.items(), zip(*rows, strict=True), strict=True)
    }
    for kind in SIZES:
        size = getattr(given, kind.replace(" ", "_"))
        if size is not None or (kind in once and kind not in found):
            found[kind] = np.full(len(rows), once[kind] if size is None else size)
    for kind in WORDS:
        found.setdefault(kind, [once[kind]] * len(rows))
    found["specimen"] = [name or once["specimen"] for name in found["specimen"]]
    if given.direction is not None:
        found["direction"] = [given.direction] * len(rows)
    return found


def _tests(table: Table) -> list[TensileTest]:
    """Return the tests of a table, by formulas of its columns."""
    columns = table.columns
    if "extension" in columns:
        stretch = 1 + columns["extension"] / table.size("gauge length", "the extension needs it")
    else:
        stretch = columns["stretch"] if "stretch" in columns else 1 + columns["strain"]
    thickness = table.size("thickness", "the modulus needs it")
    if "force" in columns:
        stress = columns["force"] / table.size("width", "the force needs it")
    else:
        stress = columns["stress"] * (1.0 if table.units["stress"] in PER_WIDTH else thickness)
    lateral = columns.get("lateral stretch")
    if "lateral strain" in columns:
        lateral = 1 + columns["lateral strain"]
    elif "lateral width" in columns:
        lateral = columns["lateral width"] / table.size("width", "the current width needs it")
    for kind, values in (("stretch", stretch), ("lateral stretch", lateral)):
        if values is not None:
            table.require(values > 0, kind, values, "it is positive, 1 at rest.")
            table.require(values <= 1 + LARGEST_STRAIN, kind, values, "is its unit right?")
    groups: dict[tuple[str, str], list[int]] = {}
    for row, name in enumerate(zip(columns["specimen"], columns["direction"], strict=True)):
        groups.setdefault((name[0], name[1].lower()), []).append(row)
    found = []
    for name, rows in groups.items():
        across = None if lateral is None else lateral[rows]
        # The mean of equal numbers may differ from them in the last digit.
        own = thickness[rows]
        height = float(own.mean() if np.ptp(own) > 0 else own[0])
        with _at(table.path, table.lines[rows[0]]):
            found.append(TensileTest(stretch[rows], stress[rows], height, across, *name))
    return found
