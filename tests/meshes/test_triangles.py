"""Edges, angles and shape functions whose answers are known; the limit on triangles."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers import surfaces
from mpi4py import MPI
from scipy.sparse import csc_array

from toros_fem.base.errors import MeshSizeError
from toros_fem.meshes import cylinder, disc, finger, rectangle, tile, triangle_limit
from toros_fem.meshes import triangles as mesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import (
    barycentric,
    edges_of,
    expected_triangles,
    gradients,
    harmonic_extension,
    spd_factor,
)

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
    matrix: np.ndarray = (half @ half.conj().T + np.eye(20)).astype(kind)
    right: np.ndarray = rng.normal(size=20).astype(kind)
    found = spd_factor(csc_array(matrix)).solve(right)
    assert matrix @ found == pytest.approx(right, abs=1e-9)


def test_a_linear_function_is_harmonic() -> None:
    pattern = rectangle(MPI.COMM_SELF, 0.1, 0.04, 6e-3, mesh="unstructured")
    x, y, _ = pattern.points.T
    values = 2 * x - 3 * y
    fixed = (np.minimum(x, x.max() - x) < 1e-9) | (np.minimum(y, y.max() - y) < 1e-9)
    assert 0 < fixed.sum() < len(fixed) / 2
    extend = harmonic_extension(pattern.flat_laplacian(), fixed)
    assert extend(np.where(fixed, values, 7.0)) == pytest.approx(values, abs=1e-8)


TINY = 1e-7
MAKERS: dict[str, Callable[[MPI.Comm, float], object]] = {
    "tube": lambda comm, h: cylinder(comm, 0.15, 0.02, h),
    "rows": lambda comm, h: cylinder(comm, 0.15, 0.02, h, mesh="structured"),
    "finger": lambda comm, h: finger(comm, h, length=0.09, width=0.025, root=0.015),
    "tile": lambda comm, h: tile(comm, 0.01, h),
    "unstructured tile": lambda comm, h: tile(comm, 0.01, h, "unstructured"),
    "rectangle": lambda comm, h: rectangle(comm, 0.1, 0.1, h),
    "disc": lambda comm, h: disc(comm, 0.1, h, "unstructured"),
}


@pytest.mark.parametrize("name", list(MAKERS))
def test_too_fine_meshes_are_refused(alone: MPI.Comm, name: str) -> None:
    with pytest.raises(MeshSizeError, match=r"triangles on .* more than 2000000. Give at least"):
        MAKERS[name](alone, TINY)


def test_the_edge_length_that_the_message_gives_is_accepted(alone: MPI.Comm) -> None:
    with triangle_limit(2000):
        with pytest.raises(MeshSizeError, match="Give at least") as caught:
            cylinder(alone, 0.15, 0.02, 1e-3)
        longest = float(str(caught.value).split("Give at least ")[1].split(" m")[0])
        assert len(cylinder(alone, 0.15, 0.02, 1.05 * longest).panel) < 2300


def test_the_limit_can_be_lifted_and_comes_back(alone: MPI.Comm) -> None:
    with triangle_limit(100):
        with triangle_limit(None):
            assert len(cylinder(alone, 0.06, 0.02, 5e-3).panel) > 300
        with pytest.raises(MeshSizeError):
            cylinder(alone, 0.06, 0.02, 5e-3)
    assert len(cylinder(alone, 0.06, 0.02, 5e-3).panel) > 300


@pytest.mark.parametrize("edge", [5e-3, 2.5e-3])
def test_expected_number(alone: MPI.Comm, edge: float) -> None:
    """The number is that of gmsh's meshes to a tenth."""
    pattern: Pattern = cylinder(alone, 0.15, 0.02, edge)
    count = len(pattern.panel)
    assert np.isclose(expected_triangles(pattern.areas.sum(), edge), count, rtol=0.1)


def test_refinements_and_copies_keep_the_limit(alone: MPI.Comm) -> None:
    with triangle_limit(1000):
        sheet = tile(alone, 0.01, 1e-3)
        with pytest.raises(MeshSizeError, match="triangles are more than 1000") as caught:
            sheet.repeated(10, 1)
        assert caught.value.area == pytest.approx(10 * 0.01**2)
        with pytest.raises(MeshSizeError, match="triangles are more than 1000") as caught:
            refine(refine(sheet.pattern).pattern)
        assert caught.value.area == pytest.approx(0.01**2)
