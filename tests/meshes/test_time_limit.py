"""Actions that never end are interrupted."""

import time
from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes import mesh_file, read_surface
from toros_fem.meshes.time_limit import TimeLimitError, within


def forever() -> None:
    while True:
        time.sleep(0.01)


def test_a_loop_is_interrupted() -> None:
    with pytest.raises(TimeLimitError):
        within(0.2, forever)


def test_a_result_and_an_error_pass() -> None:
    assert within(30.0, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        within(30.0, lambda: 1 // 0)
    time.sleep(0.05)  # an interrupt that is late would come here


def test_a_file_that_ends_too_early(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here meshio looks for the next line for ever."""
    monkeypatch.setattr(mesh_file, "SECONDS", 0.5)
    path = tmp_path / "short.off"
    path.write_text("OFF\n")
    with pytest.raises(SurfaceError, match="in a reasonable time: it ends too early"):
        read_surface(alone, path)
