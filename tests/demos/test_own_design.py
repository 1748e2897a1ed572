"""The script for a user's own mesh, from an STL file to the files of a print."""

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from demos.own_design import OwnDesignConfig, run, sentence
from toros_fem import errors
from toros_fem.meshes import cylinder

SHORT = OwnDesignConfig(iterations=6, constrained_iterations=3, angle=45.0)


@pytest.mark.slow
def test_default_finger(comm: MPI.Comm, tmp_path: Path) -> None:
    """A few steps come closer to the target; all files are there and hold what is reported."""
    folder = shared(comm, tmp_path) / "finger"
    summary = run(comm, str(folder), SHORT)
    assert summary["objective_last"] < 0.3 * summary["objective_first"]
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["inputs"] == SHORT.as_dict()
    assert written["distance_mm"] == pytest.approx(summary["distance_mm"])
    assert f"{summary['design']['distance_mm']:.1f} mm as designed" in sentence(summary)
    mesh = meshio.read(folder / "skin.vtu")
    printed = mesh.cell_data["printed"][0]
    assert set(np.unique(printed)) == {0.0, 1.0}
    # The region that is fixed by its height does not move.
    still = np.linalg.norm(mesh.point_data["displacement"], axis=1) == 0
    height = (mesh.points - mesh.point_data["displacement"])[:, 2]
    np.testing.assert_array_equal(still, height < SHORT.fixed_height)
    for name in ("shape.png", "pattern.png", "manufacture.png", "convergence.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert (folder / "pattern.svg").exists()


def test_another_file_in_another_place(comm: MPI.Comm, tmp_path: Path) -> None:
    """A tube in metres that does not stand at z = 0: the target follows it."""
    folder = shared(comm, tmp_path)
    tube = cylinder(comm, 0.06, 0.02, 5e-3)
    if comm.rank == 0:
        moved = tube.points + [0.0, 0.0, 0.3]
        meshio.write_points_cells(folder / "tube.stl", moved, [("triangle", tube.triangles)])
    comm.barrier()
    config = replace(SHORT, scale=1.0, filter_radius=7.5e-3, iterations=2, constrained_iterations=1)
    summary = run(comm, folder / "out", config, file=folder / "tube.stl")
    assert summary["objective_last"] < summary["objective_first"]
    two = replace(config, levels=2, level_iterations=1)
    finer = run(comm, folder / "finer", two, file=folder / "tube.stl")
    assert finer["triangles"] == 4 * summary["triangles"]
    assert [level["iterations"] for level in finer["levels"]] == [3, 1]
    assert finer["levels"][0]["objective_last"] == pytest.approx(summary["objective_last"])
    with pytest.raises(errors.SurfaceError, match="nothing.stl"):
        run(comm, folder / "out", config, file=folder / "nothing.stl")
