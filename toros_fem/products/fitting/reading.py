"""Tensile tests from CSV files: each row is a point of a test, and faults are told by line."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.base.toml_files.document import read_text
from toros_fem.base.units import read_quantity
from toros_fem.base.validation import require_kind, require_positive, shown
from toros_fem.products.fitting.columns import (
    FORMULAS,
    KINDS,
    LONGEST,
    SIZES,
    WORDS,
    Column,
    columns_of,
    pointed,
    split_header,
)
from toros_fem.products.fitting.tensile_test import TensileTest

# No sheet is pulled further.
LARGEST_STRETCH = 16.0
# A strain without a unit that never comes below is most likely a stretch.
LEAST_STRAIN = 0.5
# Sizes of specimens, the least and the largest, in m.
SPECIMENS = {"thickness": (1e-5, 0.02), "width": (1e-3, 1.0), "gauge length": (1e-3, 2.0)}


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
        require_positive(**{kind: size for kind, size in self.values.items() if kind in SIZES})
        for kind, unit in self.units.items():
            Column(kind, unit)

    @property
    def values(self) -> dict[str, Any]:
        """What is said, as columns hold it."""
        said = {name.replace("_", " "): value for name, value in vars(self).items()}
        return {kind: said[kind] for kind in (*SIZES, "direction") if said[kind] is not None}


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
    require_kind("given", given, (Given, type(None)), "a Given, or None")
    require_kind("paths", paths, (list, tuple), "a list of files")
    for path in paths:
        require_kind("paths", path, (str, Path), "a list of files")
    given = given or Given()
    found = [test for path in paths for test in _tests(Path(path), given)]
    if not found:
        raise MeasurementError("no file of a test is given.")
    return found


class _Point(NamedTuple):
    """A row: specimen and direction, stress per width in N/m; NaN where nothing was measured."""

    test: tuple[str, str]
    stretch: float
    stress: float
    thickness: float
    lateral: float


def _tests(path: Path, given: Given) -> list[TensileTest]:
    """Return the tests of a file."""
    points = _points(path, given)
    lines_of: dict[tuple[str, str], list[int]] = {}
    for line, point in points.items():
        lines_of.setdefault(point.test, []).append(line)
    found = []
    for test, lines in lines_of.items():
        stretch, stress, heights, lateral = np.array([points[line][1:] for line in lines]).T
        # The mean of equal numbers may differ from them in the last digit.
        height = float(heights.mean() if np.ptp(heights) > 0 else heights[0])
        across = None if np.isnan(lateral).all() else lateral
        with _at(path, lines[0]):
            found.append(TensileTest(stretch, stress, height, across, *test))
    return found


@contextmanager
def _at(path: Path, line: int) -> Iterator[None]:
    """Name file and line where something is wrong."""
    try:
        yield
    except (ParameterError, csv.Error) as error:
        what = f"the line cannot be split: {error}." if isinstance(error, csv.Error) else error
        raise MeasurementError(f"{path}, line {line}: {what}", path, line) from None


def _points(path: Path, given: Given) -> dict[int, _Point]:
    """Return the points of a file by their lines, from 1."""
    text = read_text(path, "a table of a tensile test", MeasurementError, "table")
    lines = {k: line for k, line in enumerate(re.split("[\r\n]", text), start=1) if line.strip()}
    table = [k for k, line in lines.items() if not line.lstrip().startswith("#")]
    if not table:
        raise MeasurementError(f"{path}: there is no table: no line but comments.", path)
    begin, *places = table
    mark = next((one for one in ";\t" if one in lines[begin]), ",")
    once: dict[str, Any] = {"specimen": path.stem, "direction": ""}
    for k in [k for k in lines if k < begin]:
        with _at(path, k):
            once |= _said_once(lines[k], mark)
    with _at(path, begin):
        header = _cells(lines[begin], mark)
        columns = columns_of(header, given.units)
        if not places:
            raise ParameterError("the header has no rows of numbers after it.")
    found, over = {}, given.values
    strains = ("strain", "lateral strain")
    least = {c.kind: math.inf for c in columns.values() if c.kind in strains and not c.unit}
    for k in places:
        with _at(path, k):
            cells = _cells(lines[k], mark)
            if len(cells) != len(header):
                counts = f"{len(cells)} values, but the header {len(header)} columns"
                raise ParameterError(f"the line has {counts}.")
            own = {c.holds: c.value(cells[at].strip(), mark) for at, c in columns.items()}
            filled = {kind: value for kind, value in own.items() if value != ""}
            found[k] = _point({**once, **filled, **over})
            for kind in least:
                least[kind] = min(least[kind], abs(float(own[kind])))
    with _at(path, begin):
        for kind, value in least.items():
            if value > LEAST_STRAIN:
                raise ParameterError(
                    f"the {kind} is never below {value:.3g}: is it a stretch, which is 1 at rest? "
                    f"Name the column '{kind.replace('strain', 'stretch')}', or give its unit, "
                    f"'{kind} [1]'."
                )
    return found


def _cells(line: str, mark: str) -> list[str]:
    return next(csv.reader([line], delimiter=mark, strict=True))


def _said_once(text: str, mark: str) -> dict[str, Any]:
    """Return what a line "# width = 25 mm" says for the whole file; nothing of other comments."""
    name, equals, value = text.strip().lstrip("#").partition("=")
    kind, value = KINDS.get(split_header(name)[0], ""), value.strip()
    if not equals or kind not in (*WORDS, *SIZES):
        return {}
    if kind in WORDS:
        if not value:
            raise ParameterError(f"the {kind} is empty.")
        return {kind: value[:LONGEST]}
    try:
        size = read_quantity(pointed(kind, value, mark), "m")
    except ParameterError as error:
        raise ParameterError(f"{error} Write '# {kind} = {SIZES[kind]}'.") from None
    if not size > 0:
        raise ParameterError(f"{kind} = {shown(value)} must be greater than 0.")
    return {kind: size}


def _point(row: Mapping[str, Any]) -> _Point:
    """Return the point of a row, by formulas of its values in SI units."""

    def size(kind: str, needed: str) -> float:
        if kind not in row:
            raise ParameterError(
                f"the {kind} is not known, but the {needed} needs it: write a line "
                f"'# {kind} = {SIZES[kind]}', or give --{kind.replace(' ', '-')}."
            )
        found: float = row[kind]
        least, largest = SPECIMENS[kind]
        if not least <= found <= largest:
            raise ParameterError(
                f"the {kind} is {found:.6g} m; it must be at least {least:g} m and at most "
                f"{largest:g} m. Is its unit right? Numbers without a unit are m."
            )
        return found

    thickness, told = size("thickness", "modulus"), {"lateral stretch": math.nan}
    for what, formulas in FORMULAS.items():
        for kind in formulas.keys() & row.keys():
            told[what] = formulas[kind](row[kind], partial(size, needed=kind))
    for kind in ("stretch", "lateral stretch"):
        if told[kind] <= 0:
            raise ParameterError(f"the {kind} is {told[kind]:.6g}; it is positive, 1 at rest.")
        if told[kind] > LARGEST_STRETCH:
            raise ParameterError(f"the {kind} is {told[kind]:.6g}; is its unit right?")
    test = row["specimen"], row["direction"].lower()
    return _Point(test, told["stretch"], told["force"], thickness, told["lateral stretch"])
