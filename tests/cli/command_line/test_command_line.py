"""The command line of scripts: options from fields, help, errors in one line."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.base.keys import Count, In, Length, OneOf, Table, key
from toros_fem.cli.command_line.scripts import run_from_command_line


@dataclass(frozen=True)
class Base(Table):
    """Numbers of all samples; SI units."""

    width: Length = key(0.5, "width of the sample")
    growth: Annotated[float, In("%", below=100)] = key(8.0, "growth of the sample")
    load: Annotated[float, In("N", above=0)] | None = key(None, "load; none leaves it out")


@dataclass(frozen=True)
class Sample(Base):
    """Numbers of this sample."""

    count: Count = key(3, "number of samples")
    kind: Annotated[str, OneOf(("round", "square"))] = key("round", "shape")
    rigid: bool = key(False, "also stiffen the sample")

    def coarse(self) -> Self:
        """A narrow one."""
        return self.updated(width=1.0, count=2)


class Script:
    """A script that records what it is given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, comm: MPI.Comm = MPI.COMM_SELF) -> None:
        self.patch, self.comm = monkeypatch, comm
        self.given: list[Any] = []

    def run(
        self, comm: MPI.Comm, output: Path, config: Sample, files: Any, *, verbose: bool
    ) -> str:
        self.given = [output, config, verbose, files]
        if config.count == 13:
            raise OutputError("nothing could be written.")
        return f"{config.count} made"

    def __call__(self, *words: str, **options: Any) -> int:
        self.patch.setattr(sys, "argv", ["sample.py", *words])
        return run_from_command_line(
            self.comm,
            "A sample.",
            Sample(),
            self.run,
            Path("out"),
            **options,
        )


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Script:
    """Each rank runs one for itself, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return Script(monkeypatch, MPI.COMM_SELF)


def test_defaults(script: Script, capsys: pytest.CaptureFixture[str]) -> None:
    assert script() == 0
    assert script.given == [Path("out"), Sample(), False, {}]
    assert capsys.readouterr().out == "3 made; see out/\n"


def test_options(script: Script) -> None:
    words = "--width 2e-1 --load 5 --count 4 --kind square --rigid --verbose --output there"
    assert script(*words.split()) == 0
    expected = Sample(width=0.2, load=5.0, count=4, kind="square", rigid=True)
    assert script.given == [Path("there"), expected, True, {}]
    assert script("--load", "none", "--no-rigid") == 0
    assert script.given[1] == Sample()
    assert script("--count", "9", "--coarse") == 0
    assert script.given[1] == Sample(width=1.0, count=9), "options override the coarse variant"


def test_files(script: Script) -> None:
    files = {"mesh": "a mesh", "target": "a target"}
    assert script("--mesh", "b.stl", files=files) == 0
    assert script.given[3] == {"mesh": Path("b.stl")}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--widht 3", "unknown option --widht; did you mean --width?"),
        ("--coars", "unknown option --coars; did you mean --coarse?"),
        ("--zzz 3", "unknown option --zzz; --help lists all options."),
        ("--count wide", "argument --count: count = 'wide' must be a whole number."),
        ("--width -1", "argument --width: width = -1 m must be a finite number, above 0."),
        ("--kind oval", "argument --kind: kind = 'oval' must be one of 'round', 'square'."),
        ("extra", "unrecognized arguments: extra"),
    ],
)
def test_bad_options(
    script: Script, capsys: pytest.CaptureFixture[str], words: str, message: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        script(*words.split())
    assert caught.value.code == 2
    assert capsys.readouterr().err == f"sample.py: {message}\n"
    assert script.given == []


def test_only_the_first_rank_prints(
    comm: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(shared(comm, tmp_path))
    script = Script(monkeypatch, comm)
    assert script() == 0
    assert script("--count", "13") == 4
    with pytest.raises(SystemExit):
        script("--widht", "3")
    captured = capsys.readouterr()
    assert bool(captured.out) == bool(captured.err) == (comm.rank == 0)
    assert comm.rank or captured.err.startswith(
        "OutputError: nothing could be written.\nsample.py:"
    )


def test_help_groups_options(script: Script, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        script("--help")
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith("usage: sample.py [options]\n\nA sample.\n")
    assert text.index("Numbers of this sample:") < text.index("--width") < text.index("--count")
    assert "growth of the sample; in %; below 100; default 8 %" in text
