"""The memory that a small design takes, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.scenes import ROOT

pytestmark = [pytest.mark.slow]

# Says its peak in MB, and how many forms it had to compile, which takes memory too.
DESIGN = """
import resource, sys
import cffi
from mpi4py import MPI
from pathlib import Path
from kit.scene_runs import run_scene
compiled, compile_form = [], cffi.FFI.compile
cffi.FFI.compile = lambda *a, **k: (compiled.append(1), compile_form(*a, **k))[1]
sys.modules["matplotlib"] = None  # as where it is missing
run_scene(MPI.COMM_SELF, "twist", Path(sys.argv[1]))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, len(compiled))
"""


def peak(folder: Path) -> tuple[float, int]:
    """Return the peak of a short twist in MB, and the number of forms it compiled."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    # With a shell between: a peak begins with that of the process which this one came from.
    shell = ["sh", "-c", '"$0" "$@"; exit $?']
    done = subprocess.run(
        [*shell, sys.executable, "-c", DESIGN, str(folder)],
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    megabytes, compiled = done.stdout.split()[-2:]
    return float(megabytes), int(compiled)


def test_peak_memory_of_a_coarse_twist(tmp_path: Path, pinned: Callable[..., None]) -> None:
    """Measurements differ by 0.1 %. Other versions of what is below take others."""
    found, compiled = peak(tmp_path / "one")
    if compiled:
        found, compiled = peak(tmp_path / "two")
    pinned("memory", {"peak memory of a coarse twist, MB": found}, rel=0.1)
