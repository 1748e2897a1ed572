"""From a user's two mesh files, skin and target, to a printable pattern."""

import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.measures.metrics import Metric, distance
from toros_fem.mechanics.skin.supports import pin
from toros_fem.meshes import bend, cylinder, from_mesh, read_surface, unwrap
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.config import ActuatorConfig
from toros_fem.products.actuators.run import design_actuator


@pytest.fixture
def folder(comm: MPI.Comm, tmp_path: Path) -> Path:
    return Path(comm.bcast(tmp_path, root=0))


@pytest.mark.slow
def test_design_from_files(comm: MPI.Comm, folder: Path) -> None:
    tube = cylinder(comm, 0.08, 0.02, 4.5e-3)
    if comm.rank == 0:
        cells = [("triangle", tube.triangles)]
        meshio.write_points_cells(folder / "skin.stl", 1e3 * tube.points, cells)
    comm.barrier()
    pattern = unwrap(comm, read_surface(comm, folder / "skin.stl", scale=1e-3)).pattern
    # Triangles across the generators of the wall are not exactly those of a prism.
    assert pattern.areas.sum() == pytest.approx(tube.areas.sum(), rel=5e-3)
    # Another program bends it and moves it elsewhere.
    turn = Rotation.from_rotvec([1.0, 0.5, -0.3]).as_matrix()
    if comm.rank == 0:
        bent = bend(np.radians(40.0), 0.08, neutral=0.01)(pattern.points) @ turn.T + 0.3
        meshio.write_points_cells(folder / "bent.obj", bent, [("triangle", pattern.triangles)])
    comm.barrier()
    target = from_mesh(comm, folder / "bent.obj", pattern)
    off = Metric("distance", "mm", 0.0, lambda of, x: 1e3 * distance(of, x, target, aligned=True))
    plain = off.measure(pattern, pattern.points)
    case = ActuatorCase(pattern, target, pin(pattern), metrics=(off,), aligned=True)
    config = ActuatorConfig(
        filter_radius=7e-3, pressure=3e3, iterations=8, constrained_iterations=0,
        polish_iterations=0, **DESIGN_ALONE,
    )  # fmt: skip
    done = design_actuator(comm, folder / "out", lambda *_: case, config)
    first, last = done.summary["objective_first"], done.summary["objective_last"]
    assert last < 0.5 * first
    assert done.summary["design"]["distance_mm"] < plain
    comm.barrier()
    drawing = ET.parse(folder / "out" / "pattern.svg").getroot()
    names = {group.get("id") for group in drawing.iter("{http://www.w3.org/2000/svg}g")}
    assert names == set(pattern.panel_names)
