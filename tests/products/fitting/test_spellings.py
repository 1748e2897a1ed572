"""One test in the spellings of many machines: it is read as the same numbers, or refused."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from toros_fem.base.errors import FileError
from toros_fem.products.fitting.reading import Given, read_tensile_tests

STRAIN: np.ndarray = np.linspace(0, 0.7, 71)
FORCE = 1.2 * STRAIN / (1 - 1.2 * STRAIN**2)
GAUGE, WIDTH, THICKNESS = 0.1, 0.025, 5e-4
INCH = 0.0254
# Names, and numbers over strain and force in SI units.
STRETCHES = {
    "strain [%]": 100.0,
    "strain [1]": 1.0,
    "Tensile strain (Extension) (%)": 100.0,
    "Tensile strain mm/mm": 1.0,
    "Dehnung [%]": 100.0,
    "Nominelle_Dehnung in %": 100.0,
    "Dehnung [mm]": 1e3 * GAUGE,
    "Extension (mm)": 1e3 * GAUGE,
    "Standardweg [µm]": 1e6 * GAUGE,
    "C_1_Verlängerung[mm]": 1e3 * GAUGE,
    "C_1_Laengenaenderung[mm]": 1e3 * GAUGE,
    "Stroke/mm": 1e3 * GAUGE,
    "Disp.(inch)": GAUGE / INCH,
    "Traversenweg, mm": 1e3 * GAUGE,
    "Déplacement [cm]": 1e2 * GAUGE,
}
FORCES = {
    "Load [N]": 1.0,
    "Standardkraft [mN]": 1e3,
    "C_1_Kraft[kN]": 1e-3,
    "Force(N)": 1.0,
    "Prüfkraft in N": 1.0,
    "Force (lbf)": 1 / 4.4482216152605,
    "Tensile stress (MPa)": 1e-6 / WIDTH / THICKNESS,
    "stress per width [N/mm]": 1e-3 / WIDTH,
}
TITLES = {
    "none": [],
    "comments": ["# width = 25 mm", "# thickness = 0.5 mm", "# gauge length = 10 cm"],
    "cells": [
        "Specimen label;A", "Rate 1;100;mm/min", "Width;25.0;mm", "Thickness;mm;0.5",
        "Length;100.0;mm", "",
    ],
    "german": ["Probenbreite b0: 25,0 mm", "Probendicke a0: 0,5 mm", "Messlänge L0 = 100 mm"],
    "brackets": ["Width (mm);25", "Thickness [mm];0.5", "Gauge length (in);3.937007874"],
    "table": [
        "Name;Thickness;Width;Gauge_Length", "Units;mm;mm;mm", "1 _ 1;0.5;25.0;100.0", "1 _ 1",
    ],
}  # fmt: skip
GIVEN = Given(THICKNESS, WIDTH, GAUGE)


def text(stretch: str, force: str, mark: str, comma: bool, units_below: bool, quoted: bool) -> str:
    """The test as a table, with a column of times that nobody needs."""
    names, units = ["Time [s]", stretch, force], ["", "", ""]
    if units_below:
        pairs = [name.rstrip("])").replace("(", "[").rpartition("[") for name in names]
        names, units = [pair[0].strip() for pair in pairs], [f"({pair[2]})" for pair in pairs]
    columns = [np.arange(71.0), STRETCHES[stretch] * STRAIN, FORCES[force] * FORCE]
    cells = [[f"{value:.12g}" for value in row] for row in zip(*columns, strict=True)]
    if comma:
        cells = [[cell.replace(".", ",") for cell in row] for row in cells]
    rows = [names, *([units] if units_below else []), *cells]
    own = '"' if quoted else ""
    return "\n".join(mark.join(f"{own}{cell}{own}" for cell in row) for row in rows) + "\n"


def matches(path: Path, given: Given | None) -> None:
    (found,) = read_tensile_tests([path], given)
    assert found.stretch == pytest.approx(1 + STRAIN, rel=1e-8)
    assert found.stress == pytest.approx(FORCE / WIDTH, rel=1e-8, abs=1e-9)
    assert found.doubts == ()


@pytest.mark.parametrize("stretch", STRETCHES)
def test_names_and_units(tmp_path: Path, stretch: str) -> None:
    path = tmp_path / "a.csv"
    for force, mark, comma, below, quoted in itertools.product(
        FORCES, ";\t,", (False, True), (False, True), (False, True)
    ):
        bracketed = all(name[-1] in "])" for name in (stretch, force))
        split = mark == "," and not quoted and (comma or "," in stretch)
        if split or (below and not bracketed):
            continue
        path.write_text(text(stretch, force, mark, comma, below, quoted), encoding="utf-8")
        matches(path, GIVEN)


@pytest.mark.parametrize("title", TITLES)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("sep", ["", "sep=;\n"])
def test_titles_and_encodings(tmp_path: Path, title: str, encoding: str, sep: str) -> None:
    path, comma = tmp_path / "a.csv", title == "german"
    lines = "".join(f"{line}\n" for line in TITLES[title])
    for end in ("\n", "\r\n"):
        body = text("C_1_Verlängerung[mm]", "Prüfkraft in N", ";", comma, False, False)
        path.write_bytes((sep + lines + body).replace("\n", end).encode(encoding))
        matches(path, GIVEN if title == "none" else None)


def test_marks_between_thousands_and_at_line_ends(tmp_path: Path) -> None:
    path, names = tmp_path / "a.csv", "strain [%],force [mN]"
    for numbers in ('"1,037.5"', "1'037.5", "1037.5", '"1 037.5",'):
        rows = "".join(f"{5 * k}.5,{k}.5\n" for k in range(1, 6))
        path.write_text(f"{names},\n{rows}30.5,{numbers}\n")
        (found,) = read_tensile_tests([path], GIVEN)
        assert found.stress[-1] == pytest.approx(1.0375 / WIDTH)


def test_specimens_side_by_side_and_below(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [
        f"{k},{f:.9g},{100 * e:.9g}" for k, (e, f) in enumerate(zip(STRAIN, FORCE, strict=True))
    ]
    heads = ['"1 _ 1",,,"1 _ 2",,', "Time,Force,Stroke,Time,Force,Stroke", "sec,N,mm,sec,N,mm"]
    path.write_text("\n".join([*heads, *[f"{row},{row}" for row in rows]]))
    found = read_tensile_tests([path], GIVEN)
    assert [test.specimen for test in found] == ["1 _ 1", "1 _ 2"]
    head = "Time,Force,Stroke\nsec,N,mm\n"
    table = head + "\n".join(rows)
    path.write_text(f"{table}\n\nsecond strip\n{table}\n\nend of the record\n")
    found += read_tensile_tests([path], GIVEN)
    assert [test.specimen for test in found[2:]] == ["a 1", "a 2"]
    for test in found:
        assert test.stretch == pytest.approx(1 + STRAIN)
        assert test.stress == pytest.approx(FORCE / WIDTH)


def test_a_column_by_option(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    body = text("strain [%]", "Load [N]", ";", False, False, False).replace("Load [N]", "Channel 3")
    path.write_text(body)
    with pytest.raises(FileError, match='--column "force=NAME"'):
        read_tensile_tests([path], GIVEN)
    units, columns = {"force": "N"}, {"force": "Channel 3"}
    matches(path, Given(THICKNESS, WIDTH, units=units, columns=columns))
    with pytest.raises(FileError, match="no column is named 'Channel 4'"):
        read_tensile_tests([path], Given(columns={"force": "Channel 4"}))


def test_a_fraction_in_a_column_of_percents_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    text_of = text("strain [1]", "Load [N]", ";", False, False, False).replace("[1]", "[%]")
    path.write_text(text_of)
    (found,) = read_tensile_tests([path], GIVEN)
    assert found.stretch == pytest.approx(1 + STRAIN)
    assert "taken for a ratio" in found.doubts[0]
    (said,) = read_tensile_tests([path], Given(THICKNESS, WIDTH, units={"strain": "%"}))
    assert (said.stretch.max(), said.doubts) == (pytest.approx(1.007), ())


def test_all_that_lacks_is_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text("Extension (mm)", "Load [N]", ";", False, False, False))
    with pytest.raises(FileError) as caught:
        read_tensile_tests([path])
    for option in ("--width", "--thickness", "--gauge-length"):
        assert option in str(caught.value)
