"""Tensile tests from text tables: each row is a point of a test, and faults are told by line.

A table may be one's own or a test machine's. Its separator and its header are found together: they
split a line into cells that name a stretch and a force. Below may be a row of units, above what is
said once, as the width.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.keys import read_quantity
from toros_fem.base.scene import read_text
from toros_fem.base.validation import checked_list, require_choice, require_kind, require_positive
from toros_fem.products.fitting.columns import (
    FORMULAS,
    LONGEST,
    NEEDED,
    SIZES,
    UNITS,
    WORDS,
    Column,
    are_units,
    columns_of,
    found_columns,
    known_kind,
    number_of,
    split_header,
    unit_of,
)
from toros_fem.products.fitting.samples import TensileTest

# No sheet is pulled further.
LARGEST_STRETCH = 16.0
# A strain without a unit that never comes below is most likely a stretch.
LEAST_STRAIN = 0.5
# A strain in % that never comes above is most likely a fraction.
LEAST_PERCENT = 1.5
# What may separate columns, and lines in which a header is looked for.
MARKS, TITLE = ";\t,|", 500
# Sizes of specimens, the least and the largest, in m.
SPECIMENS = {"thickness": (1e-5, 0.02), "width": (1e-3, 1.0), "gauge length": (1e-3, 2.0)}


@dataclass(frozen=True)
class Given:
    """What the tables do not say; it overrides what they do.

    Attributes:
        thickness, width, gauge_length: In m; None leaves them to the files.
        direction: Direction of the pull in all files; None leaves it to them.
        units: Unit of a column by what it holds, {"force": "N"}.
        columns: Name of a column by what it holds, {"force": "Channel 3"}.

    Raises:
        ParameterError: A length is not positive, or a unit or what it is for is unknown.
    """

    thickness: float | None = None
    width: float | None = None
    gauge_length: float | None = None
    direction: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_positive(**{kind: size for kind, size in self.values.items() if kind in SIZES})
        for kind, unit in self.units.items():
            require_choice("a column of units", kind, tuple(UNITS))
            Column(kind, unit)
        for kind in self.columns:
            require_choice("a column of columns", kind, (*UNITS, *WORDS))

    @property
    def values(self) -> dict[str, Any]:
        """What is said, as columns hold it."""
        said = {name.replace("_", " "): value for name, value in vars(self).items()}
        return {kind: said[kind] for kind in (*SIZES, "direction") if said[kind] is not None}


def read_tensile_tests(
    paths: Sequence[str | Path], given: Given | None = None
) -> list[TensileTest]:
    """Read tensile tests from text tables, one's own or those of test machines.

    The columns are named in a header: stretch, strain or extension; force or stress; if measured
    lateral stretch, lateral strain or current width; specimen and direction where a file holds
    several. Names are also those of Bluehill, Trapezium, testXpert and walter+bai. Other columns
    are left out. Units stand in brackets, "force [N]", or in a row below. Lines before the header,
    "# width = 25 mm" or "Width;25;mm", hold for the whole file, as do lengths given here.
    Separator, decimal mark and encoding are found.

    Args:
        paths: Files.
        given: What the files do not say.

    Returns:
        One test for each specimen and direction of each file.

    Raises:
        FileError: A file cannot be read, a line is wrong, or something is missing.
    """
    require_kind("given", given, (Given, type(None)), "a Given, or None")
    what = "files, at least one"
    files = [Path(path) for path in checked_list("paths", paths, str | Path, what, least=1)]
    return [test for path in files for test in _tests(path, given or Given())]


_Point = tuple[tuple[str, str], float, float, float, float]
"""A row: specimen and direction, stretch, stress per width in N/m, thickness, and lateral stretch,
NaN where it was not measured."""


class _Table(NamedTuple):
    """A table of numbers: its header, the cells of its rows by line, and what was said above."""

    path: Path
    line: int
    mark: str
    header: list[str]
    rows: dict[int, list[str]]
    once: dict[str, Any]


def _tests(path: Path, given: Given) -> list[TensileTest]:
    """Return the tests of a file."""
    found: list[TensileTest] = []
    tables = list(_tables(path, given))
    for number, table in enumerate(tables, start=1):
        name = path.stem if len(tables) == 1 else f"{path.stem} {number}"
        found += _tests_of(
            table._replace(once={"specimen": name, "direction": "", **table.once}), given
        )
    return found


def _tests_of(table: _Table, given: Given) -> list[TensileTest]:
    points, remarks, doubts = _points(table, given)
    lines_of: dict[tuple[str, str], list[int]] = {}
    for line, point in points.items():
        lines_of.setdefault(point[0], []).append(line)
    found = []
    for test, lines in lines_of.items():
        stretch, stress, heights, lateral = np.array([points[line][1:] for line in lines]).T
        # The mean of equal numbers may differ from them in the last digit.
        height = float(heights.mean() if np.ptp(heights) > 0 else heights[0])
        across = None if np.isnan(lateral).all() else lateral
        with _at(table.path, lines[0]):
            one = TensileTest(stretch, stress, height, across, *test)
        found.append(replace(one, remarks=remarks, doubts=doubts))
    return found


@contextmanager
def _at(path: Path, line: int) -> Iterator[None]:
    """Name file and line where something is wrong."""
    try:
        yield
    except (ParameterError, csv.Error) as error:
        what = f"the line cannot be split: {error}." if isinstance(error, csv.Error) else error
        raise FileError(f"{path}, line {line}: {what}", path, line) from None


def _decoded(content: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16, or what Western Windows writes."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    zeros = [content[:1000][first::2].count(0) for first in (0, 1)]
    if max(zeros) > 0.8 * min(len(content), 1000) / 2:  # no mark at its start
        return content.decode("utf-16-be" if zeros[0] > zeros[1] else "utf-16-le", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def _tables(path: Path, given: Given) -> Iterator[_Table]:
    """Yield the tables of a file, one below the other or side by side."""
    text = read_text(path, "a table of a tensile test", "table", _decoded)
    lines = {k: line for k, line in enumerate(re.split("[\r\n]", text), start=1) if line.strip()}
    marks = MARKS
    if lines and (match := re.fullmatch(r'"?sep=(.)"?', lines[first := min(lines)].strip(), re.I)):
        marks = match[1]
        del lines[first]
    if all(line.lstrip().startswith("#") for line in lines.values()):
        raise FileError(f"{path}: there is no table: no line but comments.", path)
    begin, mark = _header(lines, marks, given) or _likely_header(lines, marks)
    while True:
        header = _heading(path, lines, begin, mark)
        above = [(k, lines[k]) for k in lines if k < begin]
        with _at(path, begin):
            once = _said_above(path, above, mark, given)
        names = _try_cells(above[-1][1], mark) if above else []
        places = [k for k in lines if k > begin and not lines[k].lstrip().startswith("#")]
        units, places = _units_below(lines, places, mark)
        header = [_with_unit(name, unit) for name, unit in zip(header, units, strict=False)] + [
            *header[len(units) :]
        ]
        rest = {}
        for last, k in zip([begin, *places], places, strict=False):
            ended = k > last + 1 and all(part not in lines for part in range(last + 1, k))
            if ended and not _numbers(_try_cells(lines[k], mark)):
                rest = {at: lines[at] for at in lines if at >= k}
                break
        rows = {}
        for k in places:
            if k not in rest:
                with _at(path, k):
                    rows[k] = _cells(lines[k], mark)
        yield from _side_by_side(_Table(path, begin, mark, header, rows, once), names)
        following = _header(rest, mark, given)
        if following is None:
            return
        begin, mark = following
        lines = {k: line for k, line in lines.items() if k in rest or k < min(places)}


def _heading(path: Path, lines: Mapping[int, str], line: int, mark: str) -> list[str]:
    with _at(path, line):
        cells = _cells(lines[line].lstrip("# "), mark)
    while cells and not cells[-1].strip():
        cells.pop()
    return cells


def _header(lines: Mapping[int, str], marks: str, given: Given) -> tuple[int, str] | None:
    """Return line and separator of the first header, which names a stretch and a force."""
    for k in list(lines)[:TITLE]:
        for mark in marks:
            cells = _try_cells(lines[k].lstrip("# "), mark)
            kinds = {one[1] for one in found_columns(cells, given.units, given.columns)}
            if all(kinds & FORMULAS[what].keys() for what in ("stretch", "force")):
                return k, mark
    return None


def _likely_header(lines: Mapping[int, str], marks: str) -> tuple[int, str]:
    """Return the line above the first numbers, of which something will be said."""
    table = [k for k in lines if not lines[k].lstrip().startswith("#")]
    mark = next((one for one in marks if one in lines[table[0]]), marks[-1])
    for above, k in pairwise(table):
        for one in marks:
            if len(_numbers(_try_cells(lines[k], one))) > 1:
                row = _try_cells(lines[above], one)
                before = [at for at in table if at < above]
                return (before[-1] if are_units(row) and before else above), one
    return table[0], mark


def _units_below(
    lines: Mapping[int, str], places: list[int], mark: str
) -> tuple[list[str], list[int]]:
    """Return the row of units below a header, and the lines of numbers."""
    units: list[str] = []
    for k in places[:3]:
        cells = _try_cells(lines[k], mark)
        if are_units(cells):
            units = cells
        elif not cells or _numbers(cells):
            break
        places = places[1:]
    return units, places


def _with_unit(name: str, unit: str) -> str:
    """Return a name of a header with the unit that stands below it."""
    return f"{name} [{unit_of(unit)}]" if unit.strip() and not split_header(name)[1] else name


def _side_by_side(table: _Table, names: Sequence[str]) -> Iterator[_Table]:
    """Yield a table, or each of several alike that stand side by side with names above them."""
    header = table.header
    plain = [cell.strip() for cell in header]
    again = [k for k in range(1, len(plain)) if plain[k] == plain[0] and plain[0]]
    width = again[0] if again else len(plain)
    padded = [*plain, *[""] * (-len(plain) % width)] if width else plain
    if not again or any(cell != padded[k % width] for k, cell in enumerate(plain)):
        yield table
        return
    for begin in range(0, len(padded), width):
        rows = {k: cells[begin : begin + width] for k, cells in table.rows.items()}
        rows = {k: cells for k, cells in rows.items() if any(cell.strip() for cell in cells)}
        name = names[begin].strip() if begin < len(names) else ""
        own = {"specimen": name[:LONGEST]} if name and known_kind(name) == "" else {}
        once = {**table.once, **own}
        yield table._replace(header=header[begin : begin + width], rows=rows, once=once)


def _cells(line: str, mark: str) -> list[str]:
    return next(csv.reader([line], delimiter=mark, strict=True, skipinitialspace=True))


def _try_cells(line: str, mark: str) -> list[str]:
    try:
        return _cells(line, mark)
    except csv.Error:
        return []


def _numbers(cells: Sequence[str]) -> list[str]:
    return [cell for cell in cells if math.isfinite(number_of(cell, comma=True))]


def _said_above(
    path: Path, above: Sequence[tuple[int, str]], mark: str, given: Given
) -> dict[str, Any]:
    """Return what lines above a table say for all of it; what is given is not read."""
    found: dict[str, Any] = {}
    for place, (k, line) in enumerate(above):
        with _at(path, k):
            for kind, value in _said_once(line, [text for _, text in above[place + 1 :]], mark):
                if kind in WORDS:
                    found[kind] = value[:LONGEST]
                    if not value:
                        raise ParameterError(f"the {kind} is empty.")
                elif kind not in given.values:
                    try:
                        found[kind] = _size(kind, value)
                    except ParameterError as error:  # it may not be needed
                        found[kind] = FileError(f"{path}, line {k}: {error}", path, k)
    return found


def _said_once(line: str, below: Sequence[str], mark: str) -> Iterator[tuple[str, str]]:
    """Yield what a line says: "# width = 25 mm", "Width;25;mm", "Width (mm): 25".

    A line may also hold names alone, with units and values in the lines below.
    """
    text = line.strip().lstrip("#").strip()
    match = re.fullmatch(r'"?([^=:]+?)"?\s*[=:]\s*(.*?)[\s;,\t]*', text)
    if match and (kind := known_kind(split_header(match[1].strip())[0])) in (*SIZES, *WORDS):
        yield kind, _quantity([match[1], match[2].replace('"', "").replace(mark, " ")])
        return
    for one in dict.fromkeys([mark, *MARKS]):
        cells = [cell.strip().rstrip(":=").strip() for cell in _try_cells(text, one)]
        kinds = {k: known_kind(split_header(cell)[0]) for k, cell in enumerate(cells)}
        kinds = {k: kind for k, kind in kinds.items() if kind in (*SIZES, *WORDS)}
        values = [cell for cell in cells[1:] if cell]
        if 0 in kinds and values and (len(kinds) == 1):
            if kinds[0] in WORDS:
                yield kinds[0], values[0]
                return
            if any(re.match(r"[+-]?[.,]?\d", cell) for cell in values):
                yield kinds[0], _quantity([cells[0], *values])
                return
        rows = [_try_cells(other, one) for other in below[:3]]
        for k, kind in kinds.items():
            if kind in WORDS:
                continue
            column = [cells[k], *[row[k].strip() for row in rows if k < len(row)]]
            numbers = [k for k, cell in enumerate(column) if _numbers([cell])]
            if numbers:
                yield kind, _quantity(column[: numbers[0] + 1])
        if kinds:
            return


def _quantity(cells: Sequence[str]) -> str:
    """Return the number among cells with its unit, which may stand in the name, the first one."""
    name, *rest = cells
    number = next((cell for cell in rest if re.match(r"\s*[+-]?[.,]?\d", cell)), None)
    if number is None:
        return " ".join(rest).strip()
    own = re.fullmatch(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(.*?)\s*", number)
    value, unit = (own[1], own[2]) if own else (number, "")
    units = [unit, *[cell for cell in rest if cell is not number], split_header(name)[1]]
    plain = number_of(value, comma="," in value and value.rfind(",") > value.rfind("."))
    unit = next((unit_of(one) for one in units if one.strip(" -[]()")), "")
    return f"{plain!r} {unit}".strip() if math.isfinite(plain) else f"{number} {unit}".strip()


def _size(kind: str, value: str) -> float:
    try:
        return read_quantity(value, "m")
    except ParameterError as error:
        raise ParameterError(
            f"{error} Write '# {kind} = {SIZES[kind]}', or give --{kind.replace(' ', '-')}."
        ) from None


def _points(
    table: _Table, given: Given
) -> tuple[dict[int, _Point], tuple[str, ...], tuple[str, ...]]:
    """Return the points of a table by their lines, what was taken, and what of it is in doubt."""
    over = given.values
    with _at(table.path, table.line):
        columns = columns_of(
            table.header, given.units, given.columns, {*table.once, *over} & {*SIZES}
        )
        if not table.rows:
            raise ParameterError("the header has no rows of numbers after it.")
    values, remarks, doubts = _values(table, columns), [], []
    with _at(table.path, table.line):
        _require_strains(columns, values)
    strain = next((one for one in columns.values() if one.kind == "strain"), None)
    if strain is not None and strain.unit == "%" and "strain" not in given.units:
        largest = max(100 * abs(row["strain"]) for row in values.values())
        if largest <= LEAST_PERCENT:
            for kind in ("strain", "lateral strain"):
                if any(one.kind == kind and one.unit == "%" for one in columns.values()):
                    for row in values.values():
                        row[kind] *= 100
            doubts.append(
                f"The strain is said to be in %, but only reaches {largest:.3g}: it was taken for "
                'a ratio. If it is in %, say so by option, --unit "strain=%"; if not, '
                '--unit "strain=1".'
            )
    found = {}
    for k, own in values.items():
        with _at(table.path, k):
            found[k] = _point({**table.once, **own, **over}, columns)
    taken = [one.kind for one in columns.values()]
    left = [
        f"{kind!r} was left out beside {one!r}"
        for _, kind, *_ in found_columns(table.header, given.units, given.columns)
        for choice in FORMULAS.values()
        for one in taken
        if kind in choice and one in choice and kind != one and kind not in taken
    ]
    if left:
        remarks.append(f"{table.path.name}: {', '.join(dict.fromkeys(left))}.")
    return found, tuple(remarks), tuple(doubts)


def _values(table: _Table, columns: Mapping[int, Column]) -> dict[int, dict[str, Any]]:
    """Return the values of all rows by their lines, in SI units."""
    most = max(columns)
    texts = [
        cells[at]
        for cells in table.rows.values()
        for at, one in columns.items()
        if one.kind not in WORDS and at < len(cells)
    ]
    commas = any(text.rfind(",") > text.rfind(".") for text in texts)
    points = any(text.rfind(".") > text.rfind(",") for text in texts)
    # Beside separating commas, "1,037" and "1.5" in one table tell no decimal mark.
    comma = commas and not (points and table.mark == ",")
    found = {}
    for k, cells in table.rows.items():
        with _at(table.path, k):
            while len(cells) > len(table.header) and not cells[-1].strip():
                cells = cells[:-1]
            if len(cells) > len(table.header) or len(cells) <= most:
                advice = ""
                if table.mark == "," and len(cells) > len(table.header):
                    advice = " Are commas decimal marks? Separate the columns by semicolons then."
                raise ParameterError(
                    f"the line has {len(cells)} values, but the header {len(table.header)} "
                    f"columns.{advice}"
                )
            own = {one.holds: one.value(cells[at].strip(), comma) for at, one in columns.items()}
            found[k] = {kind: value for kind, value in own.items() if value != ""}
    return found


def _require_strains(
    columns: Mapping[int, Column], values: Mapping[int, Mapping[str, Any]]
) -> None:
    """Check that strains without a unit are none but strains."""
    for one in columns.values():
        if one.kind not in ("strain", "lateral strain") or one.unit:
            continue
        least = min(abs(row[one.kind]) for row in values.values())
        if least > LEAST_STRAIN:
            raise ParameterError(
                f"the {one.kind} is never below {least:.3g}: is it a stretch, which is 1 at rest? "
                f"Name the column '{one.kind.replace('strain', 'stretch')}', or give its unit, "
                f"'{one.kind} [1]'."
            )


def _point(row: Mapping[str, Any], columns: Mapping[int, Column]) -> _Point:
    """Return the point of a row, by formulas of its values in SI units."""
    kinds = [one.holds for one in columns.values()]
    needed = {"thickness": "modulus", **{NEEDED[kind]: kind for kind in kinds if kind in NEEDED}}
    if lacking := [kind for kind in SIZES if kind in needed and kind not in row]:
        them = "it" if len(lacking) == 1 else "them"
        uses = ", ".join(dict.fromkeys(needed[kind] for kind in lacking))
        raise ParameterError(
            f"the {' and the '.join(lacking)} {'is' if them == 'it' else 'are'} not known, but the "
            f"{uses} need{'s' if len(lacking) == 1 else ''} {them}: write "
            + ", ".join(f"'# {kind} = {SIZES[kind]}'" for kind in lacking)
            + " into a line of its own, or give "
            + " ".join(f'--{kind.replace(" ", "-")} "{SIZES[kind]}"' for kind in lacking)
            + "."
        )

    def size(kind: str) -> float:
        found: float | FileError = row[kind]
        if isinstance(found, FileError):
            raise found
        least, largest = SPECIMENS[kind]
        if not least <= found <= largest:
            raise ParameterError(
                f"the {kind} is {found:.6g} m; it must be at least {least:g} m and at most "
                f"{largest:g} m. Is its unit right? Numbers without a unit are m."
            )
        return found

    thickness, told = size("thickness"), {"lateral stretch": math.nan}
    for what, formulas in FORMULAS.items():
        for kind in formulas:
            if kind in kinds:
                told[what] = formulas[kind](row[kind], size)
    for kind in ("stretch", "lateral stretch"):
        if told[kind] <= 0 or told[kind] > LARGEST_STRETCH:
            raise ParameterError(
                f"the {kind} is {told[kind]:.6g}; it is positive, 1 at rest, and at most "
                f"{LARGEST_STRETCH:g}. Is its unit right? Tell it by option, as in "
                '--unit "strain=%".'
            )
    test = row["specimen"], row["direction"].lower()
    return test, told["stretch"], told["force"], thickness, told["lateral stretch"]
