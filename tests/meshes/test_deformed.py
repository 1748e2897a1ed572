"""Target shapes from deformed meshes."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import TargetError
from toros_fem.meshes import bend, cylinder, from_mesh


@pytest.mark.parametrize("suffix", ["obj", "ply", "vtu"])
def test_target_from_a_mesh(alone: MPI.Comm, tmp_path: Path, suffix: str) -> None:
    pattern = cylinder(alone, 0.03, 0.02, 6e-3, mesh="structured")
    path = tmp_path / f"deformed.{suffix}"
    bent = bend(1.0, 0.03)(pattern.points)

    def write(points: np.ndarray, triangles: np.ndarray) -> None:
        meshio.write_points_cells(path, points, [("triangle", triangles)])

    shuffled = np.roll(pattern.triangles[::-1], 1, axis=1)
    write(bent, shuffled)
    assert from_mesh(alone, path, pattern) == pytest.approx(bent, abs=1e-8)
    write(bent, shuffled[:-1])
    with pytest.raises(TargetError, match=f"has {len(shuffled) - 1} triangles; the skin has"):
        from_mesh(alone, path, pattern)
    write(bent[:-1], np.array([[0, 1, 2]]))
    with pytest.raises(TargetError, match=f"has {len(bent) - 1} vertices in 3 dimensions"):
        from_mesh(alone, path, pattern)
    write(bent, np.concatenate([pattern.triangles[:7], pattern.triangles[7:, ::-1]]))
    with pytest.raises(TargetError, match="triangle 7 of the skin"):
        from_mesh(alone, path, pattern)
