"""Edges, fans, regions and angles on small meshes whose answers are known."""

import numpy as np
import pytest
from helpers import surfaces
from scipy.sparse import csc_array

from toros_fem.meshes import triangles as mesh
from toros_fem.meshes.triangles import barycentric, edges_of, gradients, spd_factor

# Two triangles with a common edge 1-2, counter-clockwise.
PAIR = np.array([[0, 1, 2], [2, 1, 3]])


def test_edges_of_two_triangles() -> None:
    edges = edges_of(PAIR)
    assert edges.ends.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert edges.count.tolist() == [1, 1, 2, 1, 1]
    assert edges.inner.tolist() == [2]
    assert edges.border.tolist() == [0, 1, 3, 4]
    assert edges.of_triangle.tolist() == [[0, 2, 1], [2, 3, 4]]
    assert edges.sides[2].tolist() == [0, 1]
    assert edges.sides[0].tolist() == [0, -1]
    half = mesh.half_edges(PAIR)
    assert half[edges.twins[2]].tolist() == [[1, 2], [2, 1]]
    assert half[mesh.following(np.arange(6))].tolist() == [
        [1, 2], [2, 0], [0, 1], [1, 3], [3, 2], [2, 1]]  # fmt: skip
    assert mesh.users(edges, 2).tolist() == [0, 1]
    keys = mesh.edge_keys(edges.ends, 4)
    assert len(np.unique(keys)) == 5
    assert np.array_equal(keys, mesh.edge_keys(edges.ends[:, ::-1], 4))


def test_angles_and_shapes() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [0.5, 1e-9, 0]])
    triangles = np.array([[0, 1, 2], [0, 1, 3]])
    angles = mesh.corner_angles(points, triangles)
    assert angles[0] == pytest.approx(np.pi / 3, rel=1e-14)
    assert angles[1] == pytest.approx([2e-9, 2e-9, np.pi - 4e-9], rel=1e-9), "no digits are lost"
    assert mesh.corner_angles(points[:, :2], triangles) == pytest.approx(angles, rel=1e-9)
    assert mesh.shapes(points, triangles) == pytest.approx([np.sqrt(0.75), 1e-9])
    corners = points[triangles][:, :, :2]
    assert mesh.flat_areas(corners) == pytest.approx([np.sqrt(0.75) / 2, 5e-10])
    assert mesh.flat_areas(corners[:, ::-1]) == pytest.approx([-np.sqrt(0.75) / 2, -5e-10])


def test_curvature_and_creases() -> None:
    """Gauss and Bonnet: the defects of a sphere add up to 4π; a box has 90° at its creases."""
    ball = surfaces.sphere(2)
    edges = edges_of(ball.triangles)
    angles = mesh.corner_angles(ball.points, ball.triangles)
    defects = mesh.angle_defects(ball.triangles, edges, angles)
    assert defects.sum() == pytest.approx(4 * np.pi, rel=1e-12)
    box = surfaces.welded_box(2)
    edges = edges_of(box.triangles)
    dihedral = mesh.dihedral_angles(box.points, box.triangles, edges)
    creases = dihedral > 1
    assert dihedral[creases] == pytest.approx(np.pi / 2, rel=1e-12)
    assert dihedral[~creases] == pytest.approx(0, abs=1e-12)
    length = mesh.lengths(box.points, edges.ends[creases]).sum()
    assert length == pytest.approx(4 * (0.03 + 0.02 + 0.01), rel=1e-12)
    tube = surfaces.prism(12, 3)
    edges = edges_of(tube.triangles)
    angles = mesh.corner_angles(tube.points, tube.triangles)
    defects = mesh.angle_defects(tube.triangles, edges, angles)
    assert defects == pytest.approx(0, abs=1e-12), "also at its borders"


CORNERS = np.random.default_rng(1).normal(size=(4, 5, 3, 2))


def test_barycentric() -> None:
    """They sum up to 1, give the point back, and are 1 or 0 at the corners."""
    points = np.random.default_rng(2).normal(size=(4, 5, 7, 2))
    found = barycentric(CORNERS, points)
    assert found.sum(axis=-1) == pytest.approx(np.ones((4, 5, 7)), rel=1e-12)
    assert np.einsum("...kc,...cx->...kx", found, CORNERS) == pytest.approx(points, abs=1e-11)
    assert barycentric(CORNERS, CORNERS) == pytest.approx(
        np.broadcast_to(np.eye(3), (4, 5, 3, 3)), abs=1e-12
    )
    one = barycentric(CORNERS, points[0, 0, :1])  # the same point in all triangles
    assert one[0, 0] == pytest.approx(found[0, 0, :1], rel=1e-12)


def test_gradients_are_those_of_the_barycentric_coordinates() -> None:
    found = gradients(CORNERS)
    ahead = barycentric(CORNERS, np.eye(2)) - barycentric(CORNERS, np.zeros((1, 2)))
    assert found == pytest.approx(np.swapaxes(ahead, -1, -2), rel=1e-9)


@pytest.mark.parametrize("kind", [np.float64, np.complex128])
def test_spd_factor(kind: type) -> None:
    rng = np.random.default_rng(3)
    half = rng.normal(size=(20, 20)) + (
        1j * rng.normal(size=(20, 20)) if kind is np.complex128 else 0
    )
    matrix = (half @ half.conj().T + np.eye(20)).astype(kind)
    right = rng.normal(size=20).astype(kind)
    found = spd_factor(csc_array(matrix)).solve(right)
    assert matrix @ found == pytest.approx(right, abs=1e-9)
