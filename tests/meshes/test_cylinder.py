"""A capped tube: closed, of the given size, and rolled up without stretch."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder, mirrored


def volume(tube: Pattern) -> float:
    a, b, c = np.moveaxis(tube.points[tube.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("mesh", ["structured", "unstructured"])
@pytest.mark.parametrize("planes", [(1,), (0, 1)])
@pytest.mark.parametrize("edge", [2.5e-3, 4.5e-3, 1.1e-2])
def test_part_of_a_cylinder(
    alone: MPI.Comm, mesh: str, planes: tuple[int, ...], edge: float
) -> None:
    """Its whole is a tube like the one made at once, with the seam at the same place."""
    length, parts = 0.06, 2 ** len(planes)
    part = cylinder(alone, length, 0.02, edge, mesh=mesh, planes=planes)
    found = mirrored(part, planes)
    whole = found.pattern
    whole.require_closed()
    assert whole.panel_names == ("wall", "base", "tip")
    assert volume(whole) == pytest.approx(parts * volume(part), rel=1e-12)
    for axis in planes:
        assert part.points[:, axis].min() == 0, "the cut is exactly in its plane"
    around = _around(whole)
    assert around % parts == 0
    assert abs(around - np.pi * 0.02 / edge) <= parts
    width = around * 0.02 * np.sin(np.pi / around)
    wall = whole.corners[whole.cells_of("wall")].reshape(-1, 2)
    assert wall.min(axis=0) == pytest.approx([0, 0], abs=1e-12)
    assert wall.max(axis=0) == pytest.approx([width, length], rel=1e-12)
    assert np.array_equal(part.corners, whole.corners[: len(part.panel)])
    seam = whole.points[np.unique(whole.sewn[whole.seams])]
    inner = seam[(seam[:, 2] > 1e-9) & (seam[:, 2] < length - 1e-9)]
    assert len(inner) == max(2, round(length / edge)) - 1
    assert inner[:, 0] == pytest.approx(-0.01)
    assert np.abs(inner[:, 1]).max() == 0
    # Rolled up as the whole tube: the angle about z follows from the flat place.
    angle = np.pi + 2 * np.pi * whole.flat_points[:, 0] / width
    rim = np.unique(whole.flat_triangles[whole.cells_of("wall")])
    expected = 0.01 * np.stack([np.cos(angle), np.sin(angle)], axis=1)[rim]
    assert whole.points[whole.sewn[rim], :2] == pytest.approx(expected, abs=1e-12)


def _around(tube: Pattern) -> int:
    """Number of edges around the rim of the tip."""
    tip = tube.vertices_of("tip")
    return len(np.intersect1d(tip, tube.vertices_of("wall")))


def test_diagonals_of_the_wall() -> None:
    """Each rectangle is cut the other way by "left"; by turns; or in four."""
    rising = {}
    for mesh in ("structured", "left", "union-jack", "crossed"):
        tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3, mesh=mesh, caps=None)
        sides = tube.corners - np.roll(tube.corners, 1, axis=1)
        across = sides[(np.abs(sides) > 1e-6).all(axis=2)]
        rising[mesh] = (across[:, 0] * across[:, 1] > 0).mean()
    assert rising == pytest.approx(
        {"structured": 0, "left": 1, "union-jack": 0.5, "crossed": 0.5}, abs=0.01
    )
