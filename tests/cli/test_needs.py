"""`toros` where what it needs is missing: a sentence, not a traceback."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.process import MISSING, lacking, lacking_to_compile

# The command `toros` where modules cannot be imported.
WITHOUT = """
import sys
for name in {names}:
    sys.modules[name] = None
from toros_fem.__main__ import main
sys.argv = ["toros", *{words}]
sys.exit(main())
"""


def toros(*words: str, without: tuple[str, ...], **environment: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `toros` in a process of its own, on one rank."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMI"))}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT.format(names=without, words=words)], cwd=ROOT, text=True,
        capture_output=True, env={**inherited, "PYTHONPATH": str(ROOT), **environment}, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_nothing_is_missing_here() -> None:
    assert lacking() == []
    assert lacking_to_compile() == []


@pytest.mark.parametrize(
    ("without", "named", "remedy"),
    [
        (("mpi4py",), "mpi4py", "pip install '.[fenicsx]'"),
        (("dolfinx",), "dolfinx", "pip install '.[fenicsx]'"),
        (("petsc4py", "dolfinx"), "petsc4py", "pip install '.[fenicsx]'"),
        (("numpy",), "numpy", "pip install numpy"),
        (("gmsh",), "gmsh", "pip install '.[fenicsx]'"),
        (("shapely",), "shapely", "pip install shapely"),
        (("cyclopts",), "cyclopts", "pip install cyclopts"),
    ],
)
def test_doctor_names_what_is_missing(without: tuple[str, ...], named: str, remedy: str) -> None:
    code, out, err = toros("doctor", without=without)
    assert code == MISSING
    assert out == ""
    lines = [line for line in err.splitlines() if line.startswith(f"{named} does not work")]
    assert len(lines) == 1, err
    assert remedy in lines[0]
    assert ("Python 3.12 or newer" in lines[0]) == ("fenicsx" in remedy)
    assert "Traceback" not in err


def test_doctor_says_it_in_json() -> None:
    code, out, _ = toros("doctor", "--json", without=("shapely",))
    assert code == MISSING
    assert any("shapely" in sentence for sentence in json.loads(out)["missing"])


@pytest.mark.parametrize("without", [("mpi4py",), ("dolfinx",)])
def test_other_commands_send_to_the_doctor(without: tuple[str, ...], tmp_path: Path) -> None:
    scene = tmp_path / "bend.toml"
    assert run(MPI.COMM_SELF, ["new", "bend", str(scene)]) == 0
    code, out, err = toros(
        "simulate", str(scene), "--output", str(tmp_path / "run"), without=without
    )
    assert code == MISSING, out + err
    assert "`toros doctor` says what to do" in err
    assert "Traceback" not in err


def test_a_compiler_that_is_not_there(tmp_path: Path) -> None:
    """What is compiled already works without it."""
    code, out, err = toros("doctor", "--no-solve", without=(), PATH=str(tmp_path), CC="no-cc")
    assert code == 0, err
    assert "The C compiler no-cc is not found" in out
    assert "apt-get install gcc" in out


def test_headers_that_are_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysconfig.get_path", lambda name: str(tmp_path))
    assert [text.split()[0] for text in lacking_to_compile()] == ["Python.h"]
    (tmp_path / "Python.h").touch()
    assert lacking_to_compile() == []
