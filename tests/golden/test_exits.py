"""How commands end: the exit code, and the line that they say on stderr."""

from __future__ import annotations

import io
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.command_runs import changes
from mpi4py import MPI

from toros_fem.cli.commands.main import run

FOLDED = ("edge_length=5 mm", "levels=2", "highest_pressure=49 MPa", "pressure=48 MPa", "c1=1.01")
# Words of each command, in a folder where the first two have made their scenes.
COMMANDS = {
    "scene of a tube": "new bend bend.toml",
    "scene of a plain tube": "new inflate inflate.toml",
    "scene that is there": "new bend bend.toml",
    "no command": "",
    "unknown command": "unwarp bend.stl",
    "unknown option": "doctor --jsn",
    "missing word": "export",
    "missing scene": "check none.toml",
    "missing mesh": "unwrap none.stl",
    "unknown key in a scene": "check key.toml",
    "wrong value in a scene": "check value.toml",
    "wrong unit in a scene": "check unit.toml",
    "wrong type in a scene": "check type.toml",
    "no TOML": "check noise.toml",
    "wrong value of an option": "check bend.toml --set edge_length=-1",
    "unknown material": "check bend.toml --set fabric=jersy-light",
    "kind without a design": "design inflate.toml --output run",
    "too many triangles": "simulate bend.toml --output run --set edge_length=0.02mm",
    "folder that cannot be made": "simulate bend.toml --output bend.toml/run",
    "folder without a run": "resume .",
    "folder without a design": "tolerance .",
    "folder without a print": "export .",
    "folder that is missing": "view nowhere",
}
FILES = {
    "key": "[skin]\nedge_lenght = 3e-3",
    "value": "[skin]\nedge_length = 0",
    "unit": '[skin]\nedge_length = "3 kPa"',
    "type": "[skin]\nedge_length = true",
    "noise": "[skin",
}


class Alarm(io.StringIO):
    """A terminal that is closed when the first step of a design is told."""

    def write(self, text: str) -> int:
        if text[:4].strip() == "1":
            signal.raise_signal(signal.SIGTERM)
        return super().write(text)


@pytest.mark.slow
@pytest.mark.usefixtures("few_pictures")
def test_exits(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    pinned: Callable[..., None],
) -> None:
    """Done, wrong input, no equilibrium, not written, stopped; and a stopped run goes on."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(f"{name}.toml").write_text(f'kind = "bend"\n{text}\n', encoding="utf-8")
    found: dict[str, str] = {}

    def end(name: str, words: list[str]) -> None:
        code = run(MPI.COMM_SELF, words)
        said = capsys.readouterr().err.replace(str(tmp_path), "FOLDER").splitlines()
        last = re.sub(r"[\d.e+]+(?= (Pa|%|steps))", "N", said[-1]) if code else ""
        found[name] = f"{code} {last}".rstrip()

    for name, words in COMMANDS.items():
        end(name, [*words.split(), "--quiet"])
    folded = [word for change in FOLDED for word in ("--set", change)]
    end("no equilibrium", ["simulate", "inflate.toml", "--output", "folded", "--quiet", *folded])
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", Alarm())
        end("stopped design", ["design", "bend.toml", "--output", "run", *changes()])
    end("stopped design goes on", ["resume", "run", "--quiet"])
    end("finished design", ["resume", "run", "--quiet"])
    pinned("exits", found)
