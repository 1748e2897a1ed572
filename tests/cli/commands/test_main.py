"""The command line `toros`: help, suggestions, exit codes, JSON."""

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.base import fenicsx
from toros_fem.base.errors import NoEquilibriumError, OutputError, ParameterError
from toros_fem.cli.command import Answer
from toros_fem.cli.commands.main import COMMANDS, application, command_of, run
from toros_fem.cli.process import MEANING
from toros_fem.making.options import ManufactureOptions
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import sew
from toros_fem.meshes.sheets import rectangle

ALONE = MPI.COMM_SELF


def replaced(monkeypatch: pytest.MonkeyPatch, action: Callable[[], Answer]) -> None:
    """Let a command do something else."""
    monkeypatch.setattr(command_of("doctor"), "__call__", lambda self, comm: action())


def test_help_lists_commands_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ALONE, ["--help"]) == 0
    text = capsys.readouterr().out
    for name, about in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(about)}$", text, re.MULTILINE)
        assert command_of(name).holds() == about
        assert all(f"toros {name}" in line for line in command_of(name).EXAMPLES)
    for code, meaning in MEANING.items():
        assert f"{code:3d}  {meaning}" in text


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ParameterError("width = −1 m must be above 0."), 2),
        (NoEquilibriumError("nothing holds it."), 3),
        (OutputError("the disk is full."), 4),
        (KeyboardInterrupt(), 130),
        (ZeroDivisionError("division by zero"), 1),
    ],
)
def test_exit_codes(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
) -> None:
    def fail() -> Answer:
        raise error

    replaced(monkeypatch, fail)
    assert run(ALONE, ["doctor"]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert str(error) in captured.err
    assert ("Traceback" in captured.err) == (code == 1), "a traceback is for faults of the program"
    assert run(ALONE, ["doctor", "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    assert found["command"] == "doctor"
    assert found["exit_code"] == code
    assert found["error"] == {"type": type(error).__name__, "message": str(error)}


def test_json_alone_is_on_stdout(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def chatty() -> Answer:
        print("a line of the library")
        figures = {"path": Path("a"), "x": np.float64(0.1), "n": np.arange(2), "nan": np.nan}
        return Answer("done", figures)

    replaced(monkeypatch, chatty)
    assert run(ALONE, ["doctor", "--json"]) == 0
    captured = capsys.readouterr()
    expected: dict[str, Any] = {"command": "doctor", "exit_code": 0, "path": "a", "x": 0.1}
    assert json.loads(captured.out) == {**expected, "n": [0, 1], "nan": None}
    assert "a line of the library" in captured.err
    assert run(ALONE, ["doctor"]) == 0
    assert capsys.readouterr().out == "a line of the library\ndone\n"
    assert run(ALONE, ["doctor", "--quiet"]) == 0
    captured = capsys.readouterr()
    assert captured.out == "done\n"
    assert captured.err == ""


def test_options_have_units(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A command knows its values, and which of them were given."""

    def told(self: Any, comm: MPI.Comm) -> Answer:
        others = ManufactureOptions(copies=3, cross_size=5e-3)
        return Answer("", {**self.as_dict(), "asked": self.updating(others)})

    monkeypatch.setattr(command_of("export"), "__call__", told)
    words = ["export", "a/run", "--bed-width", "20 cm", "--grain", "none", "--copies=1", "--json"]
    assert run(ALONE, words) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["run"], found["output"], found["bed_width"]) == ("a/run", None, 0.2)
    asked = ManufactureOptions(bed_width=0.2, grain=None, cross_size=5e-3)
    assert found["asked"] == str(asked), "one copy is the default, and was given"
    monkeypatch.setattr(command_of("fit"), "__call__", told)
    assert run(ALONE, ["fit", "a.csv", "b.csv", "--unit", "force=N", "--unit=x=m", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["data"], found["unit"]) == (["a.csv", "b.csv"], ["force=N", "x=m"])


def test_log_and_warnings_go_to_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import logging
    import warnings

    def spoken() -> Answer:
        logging.getLogger("toros_fem.mine").info("half of it")
        warnings.warn("odd, but legal", UserWarning, stacklevel=1)
        return Answer("done")

    replaced(monkeypatch, spoken)
    assert run(ALONE, ["doctor"]) == 0
    captured = capsys.readouterr()
    assert captured.out == "done\n"
    first, second = captured.err.splitlines()
    assert first.endswith(" half of it"), "a batch job's lines begin with the time"
    assert second.endswith(" warning: odd, but legal")
    assert run(ALONE, ["doctor", "--quiet"]) == 0
    assert "half of it" not in capsys.readouterr().err


def test_only_the_first_rank_prints(comm: MPI.Comm, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(comm, ["unwrap", "nothing.stl"]) == 2
    captured = capsys.readouterr()
    assert ("there is no file nothing.stl" in captured.err) == (comm.rank == 0)


def started(
    *words: str, out: int = subprocess.PIPE, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python as a shell does, in a process that no mpirun knows of."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX"))}
    return subprocess.run(
        [sys.executable, *words], text=True, stdout=out, stderr=subprocess.PIPE, check=False,
        env={**environment, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "", **variables},
    )  # fmt: skip


@pytest.mark.slow
def test_a_process_of_its_own() -> None:
    """The entry point, as a shell sees it."""
    done = started("-m", "toros_fem", "unwrap", "nothing.stl", "--json")
    assert done.returncode == 2, done.stderr
    assert json.loads(done.stdout)["error"]["type"] == "SurfaceError"
    assert "Traceback" not in done.stderr


def test_what_solves_is_not_loaded_for_a_text() -> None:
    """For the help of any command, in one process that asks for all of them."""
    texts = [*([name, "--help"] for name in COMMANDS), ["--version"], ["materials"]]
    heavy = {"dolfinx", "petsc4py", "scipy", "shapely", "toros_fem.public"}
    code = f"""
import sys
from mpi4py import MPI
from toros_fem.cli.commands.main import run
for words in {texts}:
    assert run(MPI.COMM_SELF, words) == 0
    print(words, {heavy} & {{*sys.modules}}, file=sys.stderr)"""
    done = started("-c", code)
    assert done.stderr.splitlines() == [f"{words} set()" for words in texts]


@pytest.mark.parametrize("word", ["--help", "-h", "--version"])
def test_the_first_help_loads_neither_numpy_nor_mpi(word: str) -> None:
    done = started("-X", "importtime", "-m", "toros_fem", word)
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "toros_fem.cli.commands.main" in loaded
    assert not loaded & {"numpy", "mpi4py", "mpi4py.MPI", "pydantic", "cyclopts", "rich"}
    assert ("new " if word != "--version" else "toros_fem 0") in done.stdout


def test_shells_complete_options_and_choices() -> None:
    script = application("").generate_completion(shell="bash")
    for word in ("export", "--bed-width", "first-loading", "--set"):
        assert word in script


def test_the_first_help_is_told_on_any_stream() -> None:
    """On one that lacks letters, and on a full disk."""
    done = started("-m", "toros_fem", "--help", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith(r"mpirun -n 2 toros COMMAND \u2026" + "\n")
    with Path("/dev/full").open("w") as full:
        done = started("-m", "toros_fem", "--help", out=full.fileno())
    assert done.returncode == 4
    assert done.stderr.startswith("the answer cannot be written: [Errno 28]")


@pytest.mark.parametrize("words", ["--help", "materials", "materials --json", "check SCENE"])
def test_a_reader_that_goes_ends_nothing(words: str) -> None:
    """As `toros materials | head -1` does: no error, no traceback, exit code 0; with PETSc too."""
    read, write = os.pipe()
    os.close(read)
    scene = str(ROOT / "demos" / "scenes" / "inflate.toml")
    every = [scene if word == "SCENE" else word for word in words.split()]
    done = started("-m", "toros_fem", *every, out=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["materials"], 4),
        (["materials", "--json"], 4),
        (["--help"], 4),
        (["check", "nothing.toml"], 2),
    ],
)
def test_a_full_disk_is_told_in_a_line(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch, words: list[str], code: int
) -> None:
    told = io.StringIO()
    with Path("/dev/full").open("w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        monkeypatch.setattr(sys, "stderr", told)
        assert run(alone, words) == code
    expected = "nothing.toml" if code == 2 else "the answer cannot be written: [Errno 28]"
    assert expected in told.getvalue()
    assert told.getvalue().count("\n") == 1


def test_a_stream_that_lacks_letters(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    content = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(content, encoding="ascii"))
    assert run(alone, ["materials"]) == 0
    assert rb"g/cm\xb3" in content.getvalue()


@pytest.mark.parametrize(
    "name", ["a\udcff.toml", 300 * "a" + ".toml", 3000 * "a/" + "x", "", ".", "/dev/zero", "a\nb"]
)
def test_odd_names_are_told_in_a_line(
    alone: MPI.Comm, capsys: pytest.CaptureFixture[str], name: str, tmp_path: Path
) -> None:
    for words in (["check", name], ["new", "bend", name], ["view", name], ["resume", name]):
        if words[0] == "new" and name == "a\nb":
            continue  # such a name is allowed
        assert run(alone, words) in (2, 4)
        assert "Traceback" not in capsys.readouterr().err
    scene = str(ROOT / "demos" / "scenes" / "inflate.toml")
    output = [] if name in (".", "a\nb") else ["simulate", scene, "--output", name]
    assert not output or run(alone, output) in (2, 4)


def test_a_name_that_is_no_utf8_is_told_before_anything_is_loaded() -> None:
    """DOLFINx cannot start with such a command line."""
    words = [
        sys.executable,
        "-m",
        "toros_fem",
        "design",
        "x.toml",
        "--output",
        os.fsdecode(b"a\xff"),
    ]
    found = subprocess.run(words, cwd=ROOT, capture_output=True, check=False, timeout=60)
    assert found.returncode == 2
    assert found.stderr.splitlines() == [
        rb"'a\udcff' is no UTF-8; give files and folders other names."
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("home", "cache"), [(None, None), ("/dev/null", None), ("/", "/proc/no")])
def test_without_a_home_and_a_cache(home: str | None, cache: str | None, tmp_path: Path) -> None:
    """A temporary folder takes their place, and Open MPI says nothing."""
    places = {"HOME": home, "XDG_CACHE_HOME": cache, "TMPDIR": str(tmp_path)}
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **places}
    environment = {name: value for name, value in environment.items() if value is not None}
    found = subprocess.run(
        [sys.executable, "-m", "toros_fem", "materials"],
        env=environment, capture_output=True, check=False, timeout=60, cwd=ROOT,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert found.stderr == b""
    assert (tmp_path / f"toros_fem-{os.getuid()}").stat().st_mode & 0o777 == 0o700


def test_a_cache_that_cannot_be_made_is_told(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fenicsx, "form_cache", lambda: Path("/proc/no/forms"))
    monkeypatch.setattr(fenicsx, "_KERNELS", {})
    pattern = rectangle(alone, 0.02, 0.02, 0.01)
    with pytest.raises(OutputError, match="/proc/no/forms cannot be made, .* XDG_CACHE_HOME"):
        EquilibriumSolver(sew(alone, pattern), Composite(bending=None), clamp(pattern, ["sheet"]))
