"""Spheres, boxes and cylinders: exact sizes, even triangles; bodies from files."""

from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import write
from mpi4py import MPI

from toros_fem import errors
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_mesh, rigid_sphere
from toros_fem.meshes.triangles import edges_of, lengths, shapes

CENTRE = (0.1, -0.2, 0.3)


@pytest.fixture
def folder(alone: MPI.Comm, tmp_path: Path) -> Path:
    """One folder for all ranks."""
    return Path(alone.bcast(tmp_path, root=0))


def edge_lengths(body: RigidBody) -> np.ndarray:
    return lengths(body.points, edges_of(body.triangles).ends)


@pytest.mark.parametrize("radius", [0.002, 0.02, 0.1])
def test_spheres(radius: float) -> None:
    ball = rigid_sphere("ball", radius, CENTRE)
    assert ball.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=1e-12)
    assert ball.centre == pytest.approx(np.array(CENTRE), abs=1e-14)
    out = np.linalg.norm(ball.points - CENTRE, axis=1)
    assert np.ptp(out) < 1e-14, "all vertices at one distance"
    middles = ball.points[ball.triangles].mean(axis=1) - CENTRE
    deviation = max(out[0] - radius, radius - np.linalg.norm(middles, axis=1).min())
    assert deviation < 0.01 * radius
    assert deviation < 5e-5 or len(ball.triangles) > 3000
    assert len(ball.triangles) <= 4000
    edges = edge_lengths(ball)
    assert edges.max() < 1.2 * edges.min()


@pytest.mark.parametrize("edge", [None, 1.0, 4e-3])
def test_boxes(edge: float | None) -> None:
    box = rigid_box("box", (0.04, 0.03, 0.02), CENTRE, edge_length=edge)
    assert box.volume == pytest.approx(2.4e-5, rel=1e-12)
    assert box.centre == pytest.approx(np.array(CENTRE), abs=1e-14)
    assert np.ptp(box.points, axis=0) == pytest.approx([0.04, 0.03, 0.02], rel=1e-14)
    assert len(box.triangles) == {None: pytest.approx(1000, rel=0.1), 1.0: 12}.get(
        edge, 4 * (10 * 8 + 8 * 5 + 10 * 5)
    )
    assert shapes(box.points, box.triangles).min() > 0.4


@pytest.mark.parametrize("axis", [(0.0, 0.0, 2.0), (-1.0, 0.0, 0.0), (1.0, 2.0, -3.0)])
@pytest.mark.parametrize("radius", [0.002, 0.02, 0.1])
def test_cylinders(radius: float, axis: tuple[float, float, float]) -> None:
    rod = rigid_cylinder("rod", radius, 3 * radius, axis, CENTRE)
    assert rod.volume == pytest.approx(3 * np.pi * radius**3, rel=1e-12)
    assert rod.centre == pytest.approx(np.array(CENTRE), abs=1e-14)
    direction = np.array(axis) / np.linalg.norm(axis)
    along = (rod.points - CENTRE) @ direction
    assert np.abs(along).max() == pytest.approx(1.5 * radius, rel=1e-12)
    out = np.linalg.norm(rod.points - CENTRE - along[:, None] * direction, axis=1).max()
    assert 0 < out - radius < 0.01 * radius
    assert len(rod.triangles) <= 4200
    assert shapes(rod.points, rod.triangles).min() > 0.35


def test_given_edge_lengths() -> None:
    assert len(rigid_sphere("ball", 1.0, edge_length=9.0).triangles) == 20
    assert len(rigid_cylinder("rod", 1.0, 1.0, edge_length=9.0).triangles) == 6 + 6 + 12
    ball = rigid_sphere("ball", 0.02, edge_length=3e-3)
    assert np.median(edge_lengths(ball)) == pytest.approx(3e-3, rel=0.1)
    rod = rigid_cylinder("rod", 0.02, 0.05, edge_length=3e-3)
    assert np.percentile(edge_lengths(rod), 33) == pytest.approx(3e-3, rel=0.1), "not diagonals"


def test_bodies_from_files(alone: MPI.Comm, folder: Path) -> None:
    """A torus in mm, facing inwards, comes out in m, outwards and where it is asked for."""
    torus = surfaces.torus()
    size = 40 / np.ptp(torus.points[:, 0])
    path = write(
        alone,
        folder / "ring.stl",
        size * torus.points,
        [("triangle", torus.triangles[:, ::-1])],
    )
    body = rigid_mesh(alone, "ring", path, scale=1e-3, centre=CENTRE)
    assert np.ptp(body.points[:, 0]) == pytest.approx(0.04, rel=1e-5)
    assert body.centre == pytest.approx(np.array(CENTRE), abs=1e-12)
    whole = RigidBody("ring", 1e-3 * size * torus.points, torus.triangles)
    assert body.volume == pytest.approx(whole.volume, rel=1e-5)
    there = rigid_mesh(alone, "ring", path, scale=1e-3)
    assert there.centre == pytest.approx(whole.centre, abs=1e-8)
    open_file = write(alone, folder / "open.ply", size * torus.points,
                      [("triangle", torus.triangles[1:])])  # fmt: skip
    with pytest.raises(errors.SurfaceError, match="'ring': its surface has a border"):
        rigid_mesh(alone, "ring", open_file, scale=1e-3)
