"""CSV files of tests: units, specimens, and what is wrong with a file, by its line."""

from pathlib import Path

import numpy as np
import pytest

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.products.fitting.reading import Given, read_tensile_tests
from toros_fem.products.fitting.samples import TensileTest

STRAIN = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
FORCE = np.array([0.0, 1.0, 2.1, 3.3, 4.8, 7.0])
WIDTH, THICKNESS = 0.025, 0.5e-3


def written(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


def rows(*columns: np.ndarray, separator: str = ",") -> str:
    table = np.column_stack(columns)
    return "".join(separator.join(f"{value:.9g}" for value in row) + "\n" for row in table)


def one(path: Path, text: str, **values: object) -> TensileTest:
    (test,) = read_tensile_tests([written(path, text)], Given(**values))  # type: ignore[arg-type]
    return test


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("strain [%],force [N]", (100 * STRAIN, FORCE)),
        ("Stretch,Load (N)", (1 + STRAIN, FORCE)),
        ("extension [\N{GREEK SMALL LETTER MU}m],force [mN]", (6e4 * STRAIN, 1e3 * FORCE)),
        ("strain,stress [MPa]", (STRAIN, 1e-6 * FORCE / (WIDTH * THICKNESS))),
        ("strain,stress [N/mm]", (STRAIN, 1e-3 * FORCE / WIDTH)),
        ("time [s],engineering strain [%],Force [cN]", (STRAIN, 100 * STRAIN, 100 * FORCE)),
    ],
)
def test_units(tmp_path: Path, header: str, columns: tuple[np.ndarray, ...]) -> None:
    constants = "# width = 25 mm\n# thickness = 0.5 mm\n# gauge length = 6 cm\n"
    test = one(tmp_path / "a.csv", f"{constants}{header}\n{rows(*columns)}")
    assert test.stretch == pytest.approx(1 + STRAIN, rel=1e-8)
    assert test.stress == pytest.approx(FORCE / WIDTH, rel=1e-8)
    assert (test.thickness, test.lateral, test.specimen) == (THICKNESS, None, "a")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("lateral stretch", 1 - 0.3 * STRAIN),
        ("transverse strain [%]", -30 * STRAIN),
        ("current width [mm]", 25 * (1 - 0.3 * STRAIN)),
    ],
)
def test_lateral_stretch(tmp_path: Path, name: str, values: np.ndarray) -> None:
    text = f"strain,force [N],{name}\n{rows(STRAIN, FORCE, values)}"
    test = one(tmp_path / "a.csv", text, width=WIDTH, thickness=THICKNESS)
    assert test.lateral == pytest.approx(1 - 0.3 * STRAIN, rel=1e-8)


def test_semicolons_decimal_commas_and_old_line_ends(tmp_path: Path) -> None:
    body = rows(100 * STRAIN, FORCE, separator=";").replace(".", ",")
    text = f"\ufeffstrain [%];force [N]\n{body}".replace("\n", "\r\n")
    test = one(tmp_path / "a.csv", text, width=WIDTH, thickness=THICKNESS)
    assert test.stress == pytest.approx(FORCE / WIDTH, rel=1e-8)


def test_units_and_lengths_by_option_come_first(tmp_path: Path) -> None:
    text = f"# width = 1 m\n# thickness = 1 m\nstrain,force\n{rows(100 * STRAIN, FORCE)}"
    test = one(
        tmp_path / "a.csv", text,
        width=WIDTH, thickness=THICKNESS, direction="wale", units={"force": "N", "strain": "%"},
    )  # fmt: skip
    assert test.stretch == pytest.approx(1 + STRAIN)
    assert test.stress == pytest.approx(FORCE / WIDTH)
    assert (test.thickness, test.direction) == (THICKNESS, "wale")


def test_specimens_and_directions_of_one_file(tmp_path: Path) -> None:
    lines = "".join(
        f"{name},{way},{1 + e},{f},{w}\n"
        for name, way, w in (("A", "Course", 25), ("B", "wale", 50))
        for e, f in zip(STRAIN, FORCE, strict=True)
    )
    path = written(tmp_path / "a.csv", f"specimen,direction,stretch,force [N],width [mm]\n{lines}")
    tests = read_tensile_tests([path], Given(thickness=THICKNESS))
    assert [(t.specimen, t.direction) for t in tests] == [("A", "course"), ("B", "wale")]
    assert tests[0].stress == pytest.approx(2 * tests[1].stress)


BODY = rows(STRAIN, FORCE)
FAULTS = {
    "empty": ("", None, "no table"),
    "no rows": ("strain,force [N]\n", 1, "no rows of numbers"),
    "no force": (f"strain,time\n{BODY}", 1, "no column holds the force"),
    "no stretch": (f"force [N],time\n{BODY}", 1, "no column holds the stretch"),
    "twice": (
        f"strain,strain [%],load [N]\n{rows(STRAIN, STRAIN, FORCE)}", 1, "columns hold the strain"
    ),
    "no unit": (f"strain,force\n{BODY}", 1, r"'force' has no unit; .* Write 'force \[N\]'"),
    "wrong unit": (f"strain,force [lb]\n{BODY}", 1, "'force' is in 'lb'; known are N, mN"),
    "misspelt": (f"strian,force [N]\n{BODY}", 1, "did you mean 'strain' by 'strian'"),
    "word": (f"strain,force [N]\n{BODY}0.6,seven\n", 8, "force = 'seven' is no finite number"),
    "nan": (f"strain,force [N]\n{BODY}0.6,nan\n", 8, "force = 'nan' is no finite number"),
    "infinite": (f"strain,force [N]\n{BODY}0.6,1e999\n", 8, "no finite number"),
    "gap": (f"strain,force [N]\n0.1,\n{BODY}", 2, "force is empty"),
    "short": (f"strain,force [N]\n{BODY}0.6\n", 8, "the line has 1 values, but the header 2"),
    "long": (f"strain,force [N]\n{BODY}0.6,1,2\n", 8, "the line has 3 values"),
    "compressed": (f"strain,force [N]\n{BODY}-0.99,1\n-1,1\n", 9, "the stretch is 0; it is"),
    "percent of a stretch": (
        f"stretch,force [N]\n{rows(1 + STRAIN, FORCE)}13,8\n", 8, "the stretch is 13; is it in %"
    ),
    "few percent": (f"strain,force [N]\n{BODY}1.3,8\n", 8, "the strain is 1.3; is it in %"),
    "percent": (f"strain,force [N]\n{BODY}12,8\n", 8, "the strain is 12; is it in %.*'strain .1.'"),
    "too far": (f"strain [1],force [N]\n{BODY}16,8\n", 8, "stretch is 17; .* at most 16. Is"),
    "a stretch": (
        f"strain,force [N]\n{rows(1 + STRAIN, FORCE)}", 3, "1.1; is it in %.*if it is 1 at"
    ),
    "a lateral stretch": (
        "stretch,force [N],lateral strain\n" + rows(1 + STRAIN, FORCE, 1 - 0.3 * STRAIN),
        1, "lateral strain is never below .*'lateral stretch'",
    ),
    "a wrong sign": (
        "strain,force [N],lateral strain\n" + rows(STRAIN, FORCE, 0.3 * STRAIN),
        2, "grows with the stretch: is its sign right",
    ),
    "mixed units": (
        "strain [%],force [N],lateral strain\n" + rows(100 * STRAIN, FORCE, -30 * STRAIN),
        1, "'lateral strain' has no unit beside one in %",
    ),
    "decimal comma": (
        f'strain,force [N]\n{BODY}0.6,"1,037"\n', 8, "'1,037' is no .* a comma, .* semicolons"
    ),
    "constant": ("strain,force [N]\n" + 6 * "0.1,1\n", 2, "the same at all points"),
    "no load": ("strain,force [N]\n" + rows(STRAIN, 0 * FORCE), 2, "all forces .* are 0"),
    "few": (f"strain,force [N]\n{rows(STRAIN[:3], FORCE[:3])}", 2, "stretch .* at least 5"),
    "no unit of a size": (
        f"# gauge length = 25\nextension [mm],force [N]\n{BODY}", 1, "no unit; .*= 100 mm'"
    ),
    "negative": (
        f"# gauge length = -25 mm\nextension [mm],force [N]\n{BODY}", 3, "must be at least 0.001 m"
    ),
    "gauge": (f"extension [mm],force [N]\n{BODY}", 2, "the gauge length is not known.*--gauge-len"),
    "zero byte": (f"strain,force [N]\n0.1,\0\n{BODY}", 2, "no finite number"),
    "quote": (f'strain,force [N]\n0.1,"1\n{BODY}', 2, "cannot be split"),
}  # fmt: skip


def test_specimens_are_not_as_large_as_a_wrong_unit_makes_them(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", f"strain,force [N]\n{BODY}")
    for given in (
        Given(width=25.0, thickness=THICKNESS),
        Given(width=25e-6, thickness=THICKNESS),
        Given(width=WIDTH, thickness=0.5),
    ):
        with pytest.raises(FileError, match="line 2: the .* Is its unit right"):
            read_tensile_tests([path], given)


@pytest.mark.parametrize("name", FAULTS)
def test_faults_name_their_line(tmp_path: Path, name: str) -> None:
    text, line, message = FAULTS[name]
    path = written(tmp_path / "bad.csv", text)
    with pytest.raises(FileError, match=message) as caught:
        read_tensile_tests([path], Given(width=WIDTH, thickness=THICKNESS))
    assert caught.value.path == path
    assert caught.value.line == line
    assert str(path) in str(caught.value)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", f"strain,force [N]\n{BODY}")
    latin, none = tmp_path / "latin.csv", tmp_path / "none.csv"
    latin.write_bytes(b"strain,force [N]\n0.1,1 \xb5\n")
    for paths, given, message in (
        ([path], Given(width=WIDTH), "line 2: the thickness is not known.*--thickness"),
        ([path], Given(thickness=THICKNESS), "line 2: the width is not known.*--width"),
        ([none], Given(), "there is no .*none.csv"),
        ([latin], Given(), "line 2: force = '1 µ' is no finite number"),
    ):
        with pytest.raises(FileError, match=message):
            read_tensile_tests(paths, given)
    with pytest.raises(ParameterError, match="a list of files, at least one"):
        read_tensile_tests([])
