"""The sewn skin has the same mesh on any number of ranks, which own compact parts."""

import dolfinx
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from toros_fem.base.mpi import total
from toros_fem.meshes import Skin, Tile, cylinder, sew, tile, walker
from toros_fem.meshes.outlines import Star
from toros_fem.meshes.skin import concatenated_index_map, parts_of
from toros_fem.meshes.tiles import KINDS
from toros_fem.meshes.unwrapped import Distortion

SIZE = (0.03, 0.02)
EDGE = 3e-3


@pytest.mark.parametrize("mesh", KINDS)
def test_sewn_torus_is_the_same_on_all_ranks(comm: MPI.Comm, mesh: str) -> None:
    found = tile(comm, SIZE, EDGE, mesh)
    first: Tile = comm.bcast(found, root=0)
    for name in ("flat_points", "flat_triangles", "sewn", "points"):
        assert (getattr(found.pattern, name) == getattr(first.pattern, name)).all()
    assert (found.wraps == first.wraps).all()
    for pattern in (found.pattern, found.repeated(2, 1).tile.pattern):
        skin = sew(comm, pattern)
        area = dolfinx.fem.assemble_scalar(
            dolfinx.fem.form(1.0 * ufl.dx(domain=skin.mesh, degree=1))
        )
        assert total(comm, area) == pytest.approx(pattern.areas.sum(), rel=1e-12)
        topology = skin.mesh.topology
        topology.create_entities(1)
        counts = [topology.index_map(k).size_global for k in range(3)]
        assert counts[0] - counts[1] + counts[2] == 0
        assert counts[0] == len(pattern.points)
        assert counts[2] == len(pattern.panel)
        topology.create_connectivity(1, 2)
        assert total(comm, len(dolfinx.mesh.exterior_facet_indices(topology))) == 0


@pytest.fixture(scope="module")
def skin(comm: MPI.Comm) -> Skin:
    return sew(comm, cylinder(comm, 0.06, 0.02, 5e-3))


def test_each_vertex_and_triangle_is_owned_once(comm: MPI.Comm, skin: Skin) -> None:
    for owned, count in (
        (skin.owned_vertices, len(skin.pattern.points)),
        (skin.owned_cells, len(skin.pattern.panel)),
    ):
        everywhere = np.concatenate(comm.allgather(owned))
        assert np.array_equal(np.sort(everywhere), np.arange(count))


def test_values_are_gathered(skin: Skin) -> None:
    pattern = skin.pattern
    positions = skin.gather_vertices(pattern.points[skin.owned_vertices])
    assert np.array_equal(positions, pattern.points)
    assert np.array_equal(skin.gather_cells(pattern.areas[skin.owned_cells]), pattern.areas)


def test_geometry_is_flat_and_topology_assembled(comm: MPI.Comm, skin: Skin) -> None:
    """Flat areas of each triangle, and F of the assembled shape: its stretches are near 1."""
    pattern = skin.pattern
    assert skin.mesh.geometry.dim == skin.mesh.topology.dim == 2
    test = ufl.TestFunction(skin.density_space)
    area = dolfinx.fem.assemble_vector(dolfinx.fem.form(test * ufl.dx(skin.mesh, degree=1)))
    count = len(skin.owned_cells)
    assert area.array[:count] == pytest.approx(pattern.areas[skin.owned_cells], rel=1e-12)
    x = dolfinx.fem.Function(skin.position_space)
    x.x.array[:] = pattern.points[skin.vertex].ravel()
    gradient = ufl.grad(x)
    square = dolfinx.fem.form(ufl.inner(gradient, gradient) * ufl.dx(degree=1))
    stretches = Distortion(pattern).stretches
    exact = (pattern.areas * (stretches**2).sum(axis=1)).sum()
    assert total(comm, dolfinx.fem.assemble_scalar(square)) == pytest.approx(exact, rel=1e-12)


def test_concatenated_index_maps(comm: MPI.Comm, skin: Skin) -> None:
    """Ghosts refer to their owners: global numbers, sent there and back, agree."""
    cells = skin.mesh.topology.index_map(2)
    nodes = skin.position_space.dofmap.index_map
    whole, (first, second) = concatenated_index_map(comm, [(cells, 2), (nodes, 3)])
    assert whole.size_global == 2 * cells.size_global + 3 * nodes.size_global
    assert whole.size_local == 2 * cells.size_local + 3 * nodes.size_local
    local = np.concatenate([first, second])
    assert np.array_equal(np.sort(local), np.arange(whole.size_local + whole.num_ghosts))
    number = whole.local_to_global(local.astype(np.int32))
    one, two = (m.local_to_global(np.arange(m.size_local + m.num_ghosts, dtype=np.int32))
                for m in (cells, nodes))  # fmt: skip
    origin = np.concatenate([2 * np.repeat(one, 2), 3 * np.repeat(two, 3) + 1])
    mine = dict(zip(number.tolist(), origin.tolist(), strict=True))
    for other in comm.allgather(mine):
        assert all(other[key] == value for key, value in mine.items() if key in other)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_parts_have_equal_sizes_and_short_borders(count: int) -> None:
    pattern = cylinder(MPI.COMM_SELF, 0.15, 0.02, 4e-3)
    part = parts_of(pattern, count)
    sizes = np.bincount(part, minlength=count)
    assert len(sizes) == count
    assert np.ptp(sizes) <= count.bit_length()
    one, two = part[pattern.edges.twins[pattern.edges.inner] // 3].T
    around = np.pi * 0.02 / 4e-3
    assert (one != two).sum() <= 2.5 * around * (count - 1), "cuts go around, not along"


def test_ranks_own_their_parts_in_every_run(comm: MPI.Comm) -> None:
    star = Star(4, 0.04, 0.02, 0.02, 6e-3, np.pi / 4)
    pattern = walker(comm, 5e-3, star)
    part = parts_of(pattern, comm.size)
    for _ in range(3):
        skin = sew(comm, pattern)
        assert np.array_equal(np.sort(skin.owned_cells), np.flatnonzero(part == comm.rank))
        # Ghosts are the neighbours across edges.
        ghosts = skin.cell[len(skin.owned_cells) :]
        twins = pattern.edges.twins[pattern.edges.inner] // 3
        near = np.concatenate([twins, twins[:, ::-1]])
        across = near[(part[near[:, 0]] == comm.rank) & (part[near[:, 1]] != comm.rank), 1]
        assert np.array_equal(np.sort(ghosts), np.unique(across))
