"""Pictures of a gripper: fingers around the object, and the files."""

import json
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.actuators.gripper import _body_mesh, _in_room, write_grasp
from toros_fem.fabrication.contours import panel_outline
from toros_fem.meshes import cylinder
from toros_fem.objectives.gap import Body


def test_fingers_are_shown_from_outside() -> None:
    """Turning a finger into the room must not turn it inside out."""
    ball = Body("sphere", 0.04, (0.03, 0.0, 0.02))
    points, faces = _body_mesh(ball)
    for angle in (0.0, 1.0):
        a, b, c = np.moveaxis(_in_room(points, ball, angle)[faces], 1, 0)
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        assert volume == pytest.approx(4 / 3 * np.pi * 0.02**3, rel=0.02)


def test_three_fingers_stand_around_the_object() -> None:
    """A point of the finger at the object's height is as far from its axis at every angle."""
    ball = Body("sphere", 0.04, (0.03, 0.0, 0.02))
    point = np.array([[0.03, 0.002, 0.001]])
    places = np.concatenate(
        [_in_room(point, ball, angle) for angle in 2 * np.pi * np.arange(3) / 3]
    )
    assert places.sum(axis=0)[:2] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(places[:, :2], axis=1) == pytest.approx(np.hypot(0.019, 0.002))
    assert places[:, 2] == pytest.approx(-0.03), "the finger hangs down along its own x"


def test_files_of_a_grasp(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path, root=0)
    ball = Body("sphere", 0.04, (0.03, 0.0, 0.02))
    finger = cylinder(comm, 0.03, 0.01, 5e-3)
    regions = [panel_outline(finger, panel) for panel in range(3)]
    write_grasp(comm, folder, finger, finger.points, regions, ball, {"sag_mm": 1.5})
    comm.barrier()
    assert json.loads((folder / "load.json").read_text(encoding="utf-8")) == {"sag_mm": 1.5}
    for name in ("grasp.png", "finger.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
