"""`toros fit`: constants, report and picture of tests in files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import ROOT
from helpers.tensile_tests import JERSEY, pulled_sheet, synthetic
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.materials.library.files import read_library
from toros_fem.products.fitting import strip
from toros_fem.products.tiles.printed_tile import write_tile
from toros_fem.products.tiles.pulled_sheet import cross_tile

DATA = ROOT / "examples" / "stockinette.csv"
FAST = ("--intervals", "hessian")


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
    words = ["--thickness", "0.5 mm", "--output", str(tmp_path / "fit"), *FAST]
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


def test_clamped_strip(alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clamps are as far apart as the gauge length, and it is as wide as is said."""
    strips = []

    def noted(comm: MPI.Comm, length: float, width: float) -> None:
        strips.append((length, width))

    monkeypatch.setattr(strip, "ClampedStrip", noted)
    words = ["fit", str(jersey_file(alone, tmp_path)), "--thickness", "0.5 mm", *FAST]
    words += ["--output", str(tmp_path / "fit"), "--clamped"]
    assert run(alone, [*words, "--gauge-length", "5 cm", "--width", "25 mm"]) == 0
    assert strips == [pytest.approx((0.05, 0.025))]


@pytest.mark.slow
def test_moduli_of_a_printed_sheet(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Data of the sheet's own moduli, which are found again."""
    tile = replace(cross_tile(), edge_length=2e-3)
    path = tmp_path / "sheet.csv"
    strains: np.ndarray = np.linspace(0.02, 0.1, 5)
    test = pulled_sheet(alone, tile, np.ones(2), strains)
    write_tile(tmp_path, tile)
    assert test.lateral is not None
    columns = zip(strains, test.stress, test.lateral, strict=True)
    rows = "".join(f"{e},{1e-3 * p},{w}\n" for e, p, w in columns)
    path.write_text(f"strain,stress [N/mm],lateral stretch\n{rows}")
    words = ["fit", str(path), "--tile", str(tmp_path), "--along", "2", "--across", "1"]
    words += ["--direction", "x"]
    assert run(alone, [*words, "--output", str(tmp_path / "fit"), "--json"]) == 0
    found = capsys.readouterr().out
    figures = json.loads(found)
    assert set(figures["estimates"]) == {"fabric", "reinforcement"}
    assert figures["r2_stress"] > 0.999
    assert figures["inputs"]["intervals"] == "hessian", "of the curvature, whatever is asked for"
    young = figures["estimates"]["reinforcement"]["value"]
    assert young == pytest.approx(tile.composite.reinforcement.young, rel=0.01)
    assert "E of the reinforcement" in (tmp_path / "fit" / "fit.txt").read_text()
    assert run(alone, [*words, "--clamped"]) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--thickness", "3 mm", "--direction", "z"), "directions 'x', 'y'"),
        (("--thickness", "3 kPa"), "a length is needed"),
        (("--thickness", "3 mm", "--name", "a"), "belong together"),
        (("--thickness", "3 mm", "--clamped", "--width", "1 cm"), "--clamped needs"),
        (("--thickness", "3 mm", "--unit", "force"), "must be COLUMN=UNIT"),
        (("--thickness", "3 mm", "--unit", "force=lb"), "known are N"),
        (("--thickness", "3 mm", "--column", "time=t"), "must be COLUMN=NAME"),
        (("--thickness", "3 mm", "--loss", "none"), "must be one of"),
        ((), "line 3: the thickness is not known"),
    ],
)
def test_wrong_values(
    alone: MPI.Comm, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert run(alone, ["fit", str(DATA), *words]) == 2
    assert message in capsys.readouterr().err
