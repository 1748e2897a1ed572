"""Runs of a script that are killed or stopped by signals, and go on."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run_files import content
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.results.runs.stored_run import summary_of

# Under mpirun a child process would act as one of its ranks.
pytestmark = [
    pytest.mark.slow,
]

OPTIONS = {
    "length": "0.05", "angle": "40", "edge_length": "6e-3", "filter_radius": "9.1e-3",
    "levels": "1", "iterations": "2", "constrained_iterations": "1", "polish_iterations": "0",
    "corrections": "0", "curve_pressure": "none", "estimate_error": "false",
}  # fmt: skip
ROWS = 5  # of a whole run: two stages, each with its start
# The command `toros` where matplotlib is missing: pictures would take longer than the design.
UNDRAWN = """
import sys
sys.modules["matplotlib"] = None
from toros_fem.__main__ import main
sys.argv[0] = "toros"
sys.exit(main())
"""


def toros(*words: str, ranks: int = 1) -> subprocess.Popen[str]:
    python = [sys.executable] if ranks == 1 else ["mpirun", "-n", str(ranks), sys.executable]
    return subprocess.Popen(
        [*python, "-c", UNDRAWN, *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def start(folder: Path, *more: str, ranks: int = 1) -> subprocess.Popen[str]:
    words = [word for key, value in OPTIONS.items() for word in ("--set", f"{key}={value}")]
    scene = "demos/scenes/bend.toml"
    return toros("design", scene, "--output", str(folder), *words, *more, ranks=ranks)


def is_row(line: str) -> bool:
    return line[:4].strip().isdigit()


def finish(process: subprocess.Popen[str]) -> tuple[int, int, str]:
    """Return how many rows are left, the exit code, and what stderr says."""
    with process:
        out, err = process.communicate(timeout=200)
    return sum(map(is_row, out.splitlines())), process.returncode, err


def stop(process: subprocess.Popen[str], number: int, rows: int, later: float = 0.0) -> Any:
    """Send a signal after some rows, `later` times the time of the last one; return as `finish`.

    SIGUSR1 after the first row does not stop it.
    """
    assert process.stdout is not None
    times: list[float] = []
    for line in process.stdout:
        if is_row(line):
            times.append(time.monotonic())
            if len(times) == 1:
                process.send_signal(signal.SIGUSR1)
        if len(times) == rows:
            break
    time.sleep(later * (times[-1] - times[-2]) if later else 0.0)
    process.send_signal(number)
    left, code, err = finish(process)
    return len(times) + left, code, err


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("whole")
    rows, code, err = finish(start(folder))
    assert (rows, code) == (ROWS, 0), err
    return content(folder)


def test_killed_at_any_moment_a_run_loses_at_most_two_steps(tmp_path: Path, whole: Any) -> None:
    """And nothing is damaged: in the end all is the same, to the last bit."""
    rows, code, err = stop(start(tmp_path), signal.SIGKILL, 3, np.random.default_rng(5).uniform())
    assert code == -signal.SIGKILL, err
    left, code, err = finish(toros("resume", str(tmp_path)))
    assert code == 0, err
    assert left <= ROWS - (rows - 2)
    assert content(tmp_path) == whole
    assert not list(tmp_path.glob("earlier-*"))


def test_a_signal_ends_the_step_and_a_line_says_how_to_go_on(tmp_path: Path, whole: Any) -> None:
    """Of both ranks, to which mpirun passes it on; one goes on alone, to the tolerance."""
    # Open MPI's mpirun ends the ranks itself at SIGTERM, that of MPICH itself at SIGUSR2.
    number = signal.SIGUSR2 if MPI.get_vendor()[0] == "Open MPI" else signal.SIGTERM
    rows, code, err = stop(start(tmp_path, ranks=2), number, 2)
    assert code == 128 + number
    assert f"stopped by {number.name}; the state is on disk. Go on with: toros resume " in err
    assert "Traceback" not in err
    left, code, err = finish(toros("resume", str(tmp_path)))
    assert (rows + left, code) == (ROWS, 0), err
    objective = float(content(tmp_path)[0][-1]["objective"])
    assert objective == pytest.approx(float(whole[0][-1]["objective"]), rel=0.02)


def test_what_follows_a_design_stops_at_once(tmp_path: Path) -> None:
    """In the middle of a solve; design and pattern are on disk."""
    process = start(tmp_path, "--set", "estimate_error=true")
    rows = 0
    while rows < ROWS:
        rows += is_row(process.stdout.readline())
    while not (tmp_path / "summary.json").exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, code, err = finish(process)
    assert code == 128 + signal.SIGINT, err
    assert err.splitlines()[-1].startswith("stopped by SIGINT; the state is on disk")
    assert "Traceback" not in err
    assert (summary_of(tmp_path).value("angle_deg") or 0.0) > 0
    assert (tmp_path / "skin.vtu").exists(), "the summary is the last"
