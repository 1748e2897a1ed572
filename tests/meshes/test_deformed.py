"""Target shapes from deformed meshes."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import TargetError
from toros_fem.meshes import bend, cylinder, from_mesh


@pytest.mark.parametrize("suffix", ["obj", "ply", "vtu"])
def test_target_from_a_mesh(comm: MPI.Comm, tmp_path: Path, suffix: str) -> None:
    pattern = cylinder(comm, 0.03, 0.02, 6e-3, mesh="structured")
    path = Path(comm.bcast(str(tmp_path / f"deformed.{suffix}")))
    bent = bend(1.0, 0.03)(pattern.points)

    def write(points: np.ndarray, triangles: np.ndarray) -> None:
        if comm.rank == 0:
            meshio.write_points_cells(path, points, [("triangle", triangles)])

    shuffled = np.roll(pattern.triangles[::-1], 1, axis=1)
    write(bent, shuffled)
    assert from_mesh(comm, path, pattern) == pytest.approx(bent, abs=1e-8)
    write(bent, shuffled[:-1])
    with pytest.raises(TargetError, match=f"has {len(shuffled) - 1} triangles; the skin has"):
        from_mesh(comm, path, pattern)
    write(bent[:-1], np.array([[0, 1, 2]]))
    with pytest.raises(TargetError, match=f"has {len(bent) - 1} vertices in 3 dimensions"):
        from_mesh(comm, path, pattern)
    write(bent, np.concatenate([pattern.triangles[:7], pattern.triangles[7:, ::-1]]))
    with pytest.raises(TargetError, match="triangle 7 of the skin"):
        from_mesh(comm, path, pattern)


def test_mesh_that_is_none(
    comm: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pattern = cylinder(comm, 0.03, 0.02, 6e-3, mesh="structured")
    folder = Path(comm.bcast(str(tmp_path)))
    if comm.rank == 0:
        (folder / "notes.txt").write_text("no mesh", encoding="utf-8")
        (folder / "broken.ply").write_text("no mesh", encoding="utf-8")
    for name in ("notes.txt", "broken.ply"):
        with pytest.raises(TargetError, match="cannot be read as a mesh"):
            from_mesh(comm, folder / name, pattern)
    assert capsys.readouterr().out == "", "the error says it all"
    with pytest.raises(TargetError, match="there is no file"):
        from_mesh(comm, folder / "missing.obj", pattern)
