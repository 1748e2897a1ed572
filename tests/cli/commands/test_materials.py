"""`toros materials`: tables of the library."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import ROOT
from helpers.tensile_tests import JERSEY, synthetic
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.commands.materials import material_details, table_text
from toros_fem.materials.library.files import read_library, write_material
from toros_fem.materials.library.material import TRUSTS

LIBRARY = read_library()
DATA = ROOT / "examples" / "stockinette.csv"
FAST = ("--draws", "40")


def test_table_with_a_file_of_ones_own(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    write_material(path, replace(read_library()["tpu-85a"], name="my-print"))
    assert run(alone, ["materials", "--kind", "print", "--file", str(path)]) == 0
    text = capsys.readouterr().out
    assert (text == "") == (alone.rank > 0)
    assert run(alone, ["materials", "--kind", "print", "--file", str(path), "--json"]) == 0
    assert "\nmy-print " in text
    assert "jersey-light" not in text
    found = json.loads(capsys.readouterr().out)["materials"]
    assert {entry["kind"] for entry in found} == {"print"}
    assert found[-1]["name"] == "my-print"
    assert found[-1]["young"] == 12e6


def test_one_material(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["materials", "dragon-skin-20"]) == 0
    assert "E           290 kPa\n" in capsys.readouterr().out
    assert run(MPI.COMM_SELF, ["materials", "dragon-skin-20", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stretch_range"] == [1.0, 1.3]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dragon-skin-2"], "FileError: 'dragon-skin-2' is no material .* did you mean"),
        (["tpu-85a", "--kind", "fabric"], "'tpu-85a' is a print, and a fabric is asked for"),
        (["--kind", "fabrics"], '"fabrics" for --kind. Choose from: .* Did you mean "fabric"'),
        (["--file", "nowhere.toml"], "there is no nowhere.toml"),
    ],
)
def test_wrong_words(capsys: pytest.CaptureFixture[str], words: list[str], message: str) -> None:
    assert run(MPI.COMM_SELF, ["materials", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error)


def test_the_page_explains_how_far_to_trust() -> None:
    page = (ROOT / "docs" / "materials.md").read_text(encoding="utf-8")
    for word, meaning in TRUSTS.items():
        assert f"| {word} | {meaning} |\n" in page


def test_each_material_is_in_the_table() -> None:
    text = table_text(LIBRARY.values())
    for name, entry in LIBRARY.items():
        assert f"\n{name} " in text
        assert entry.trust in material_details(entry)
    assert max(map(len, text.splitlines())) <= 96
    fabrics = [entry for entry in LIBRARY.values() if entry.kind == "fabric"]
    assert "Prints" not in table_text(fabrics)
    assert table_text(fabrics).startswith("Fabrics\nname ")


def test_details() -> None:
    both = replace(LIBRARY["tpu-95a-on-jersey"], c1=1.5, density=0.3, note="a note")
    text = material_details(both)
    for line in (
        "tpu-95a-on-jersey: TPU 95A", "E h         13 kN/m", "c1          1.5",
        "mass        300 g/m²", "sheet       print and fabric as one", "note        a note",
        "stretches   1 to 1.1",
    ):  # fmt: skip
        assert f"\n{line}" in f"\n{text}"
    assert "knit ratio  1.52" in material_details(LIBRARY["rib-knit"])


def jersey_file(comm: MPI.Comm, folder: Path) -> Path:
    path = folder / "jersey.csv"
    if comm.rank == 0:
        test = synthetic(0)
        assert test.lateral is not None
        columns = np.column_stack([100 * (test.stretch - 1), test.stress * 0.025, test.lateral])
        lines = "".join(",".join(f"{v:.8g}" for v in row) + "\n" for row in columns)
        path.write_text(f"# width = 25 mm\nstrain [%],force [N],lateral stretch\n{lines}")
    comm.barrier()
    return path


def test_entry_of_a_library(alone: MPI.Comm, tmp_path: Path) -> None:
    path, library = jersey_file(alone, tmp_path), tmp_path / "mine.toml"
    words = ["fit", str(path), "--thickness", "0.5 mm", "--output", str(tmp_path / "fit"), *FAST]
    words += ["--name", "my-jersey", "--library", str(library), "--source", "three strips"]
    assert run(alone, words) == 0
    found = read_library(library)["my-jersey"]
    assert found.material.young == pytest.approx(JERSEY.young, rel=0.1)
    assert found.c1 is not None
    assert 1.8 < found.c1 < 2.0
    assert found.stretch_range == pytest.approx((1.0, 1.8))
    assert (found.trust, found.source, found.kind) == ("measured", "three strips", "fabric")
    assert "R² of the stress 0.99" in str(found.note)
    assert "young" not in str(found.note), "it is identified"


def test_a_doubtful_entry_says_so(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A preload is refused until it is told; a fraction under % is in doubt until it is told."""
    data, library = ROOT / "tests" / "data" / "tensile", tmp_path / "mine.toml"
    words = ["--thickness", "0.5 mm", "--output", str(tmp_path / "fit"), "--overwrite", *FAST]
    words += ["--name", "a", "--library", str(library)]
    assert run(alone, ["fit", str(data / "preload.csv"), *words]) == 2
    assert "--offset preload" in capsys.readouterr().err
    assert not library.exists()
    path = str(data / "strain_fraction_as_pct.csv")
    assert run(alone, ["fit", path, *words]) == 0
    assert 'marked as "doubted"' in capsys.readouterr().out
    assert read_library(library)["a"].trust == "doubted"
    assert run(alone, ["fit", path, *words, "--unit", "strain=1"]) == 0
    assert read_library(library)["a"].trust == "measured"
    assert run(alone, ["fit", path, *words, "--column", "force=lateral"]) == 2
    assert "no column is named 'lateral'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--thickness", "3 mm", "--direction", "z"), "directions 'x', 'y'"),
        (("--thickness", "3 kPa"), "a length is needed"),
        (("--thickness", "3 mm", "--name", "a"), "belong together"),
        (("--thickness", "3 mm", "--unit", "force"), "must be COLUMN=UNIT"),
        (("--thickness", "3 mm", "--unit", "force=lb"), "known are N"),
        (("--thickness", "3 mm", "--column", "time=t"), "must be COLUMN=NAME"),
        (("--thickness", "3 mm", "--loss", "none"), "Choose from"),
        (("--scene", "tube.toml", "--draws", "40"), "with --scene, `toros fit` takes no --draws"),
        (("--coarse",), "--pattern and --coarse belong to --scene"),
        ((), "line 3: the thickness is not known"),
    ],
)
def test_wrong_values(
    alone: MPI.Comm, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert run(alone, ["fit", str(DATA), *words]) == 2
    assert message in capsys.readouterr().err
