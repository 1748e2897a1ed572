"""`toros fit`: constants, report and picture of tests in files."""

from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import ROOT
from helpers.tensile_tests import JERSEY, synthetic
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.materials.library.files import read_library

DATA = ROOT / "examples" / "stockinette.csv"
FAST = ("--draws", "40")


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
        ((), "line 3: the thickness is not known"),
    ],
)
def test_wrong_values(
    alone: MPI.Comm, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert run(alone, ["fit", str(DATA), *words]) == 2
    assert message in capsys.readouterr().err
