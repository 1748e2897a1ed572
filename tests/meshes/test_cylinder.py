"""A capped tube: closed, of the given size, and rolled up without stretch."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import cylinder


@pytest.mark.parametrize("mesh", ["structured", "unstructured"])
def test_cylinder(comm: MPI.Comm, mesh: str) -> None:
    tube = cylinder(comm, 0.06, 0.02, 4e-3, mesh=mesh)
    sides = round(np.pi * 0.02 / 4e-3)
    perimeter = sides * 0.02 * np.sin(np.pi / sides)
    wall = tube.cells_of("wall")
    assert tube.areas[wall].sum() == pytest.approx(perimeter * 0.06, rel=1e-12)
    assert len(tube.free_edges) == 0
    # Euler characteristic of a sphere, and the seams: two rims and one cut.
    edges = 3 * len(tube.panel) // 2
    assert len(tube.points) - edges + len(tube.panel) == 2
    assert len(tube.seams) == 2 * sides + round(0.06 / 4e-3)
    a, b, c = np.moveaxis(tube.points[tube.triangles], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(np.pi * 0.01**2 * 0.06, rel=0.04)
    assert volume > 0, "normals point outwards"
    flat = tube.corners[wall].reshape(-1, 2)
    assert flat.min(axis=0) == pytest.approx([0, 0], abs=1e-12)
    assert flat.max(axis=0) == pytest.approx([perimeter, 0.06], rel=1e-12)


def test_structured_cylinder_is_isometric() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3, mesh="structured", caps=False)
    for i in range(3):
        flat = tube.corners[:, i] - tube.corners[:, i - 1]
        round_ = tube.points[tube.triangles[:, i]] - tube.points[tube.triangles[:, i - 1]]
        lengths = np.linalg.norm(flat, axis=1), np.linalg.norm(round_, axis=1)
        assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)
    assert len(tube.free_edges) == 2 * round(np.pi * 0.02 / 4e-3)


@pytest.mark.parametrize(
    "sizes", [(-1.0, 0.02, 4e-3), (0.06, float("nan"), 4e-3), (0.06, 0.02, 0.0), (0.06, 0.02, 0.1)]
)
def test_cylinder_sizes(comm: MPI.Comm, sizes: tuple[float, float, float]) -> None:
    with pytest.raises(errors.ParameterError, match=r"= .* must be a finite number"):
        cylinder(comm, *sizes)
