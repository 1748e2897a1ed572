"""`toros materials`: tables of the library."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.commands.materials import material_details, table_text
from toros_fem.materials.library.files import read_library, write_material
from toros_fem.materials.library.material import TRUSTS


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


LIBRARY = read_library()


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
