"""The sewn skin: a mesh with the topology of the assembled surface and the flat geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import cpp, fem, mesh
from mpi4py import MPI

from toros_fem.base import compat
from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import PatternError, UnitWarning
from toros_fem.base.mpi import collective, gather_by_index, warn_together
from toros_fem.base.validation import require_kind
from toros_fem.meshes.partition import partitioner
from toros_fem.meshes.pattern import Pattern

# Sizes in m, of the bounding box's diagonal, beyond which a unit is in doubt.
SMALLEST, LARGEST = 1e-4, 10.0


@dataclass(frozen=True, eq=False)
class Skin:
    """A sewn pattern, distributed over the ranks of a communicator.

    The geometry is the flat pattern (gdim = tdim = 2, three corners per cell), the topology is the
    assembled surface: `ufl.grad` of a position field in R³ is the deformation gradient, and
    `ufl.dx` measures flat area.

    Attributes:
        pattern: The whole pattern, on every rank.
        mesh: The distributed mesh, with a layer of ghost cells across facets.
        position_space: Continuous piecewise linear fields in R³, one node per assembled vertex.
        density_space: Fields with one value per triangle.
        vertex: Assembled vertex of each local node of `position_space`, owned nodes first.
        cell: Pattern triangle of each local dof of `density_space`, owned dofs first.
    """

    pattern: Pattern
    mesh: mesh.Mesh
    position_space: fem.FunctionSpace
    density_space: fem.FunctionSpace
    vertex: Ints
    cell: Ints

    @property
    def comm(self) -> MPI.Comm:
        """Communicator over which the skin is distributed."""
        return self.mesh.comm

    @property
    def owned_vertices(self) -> Ints:
        """Assembled vertices of the nodes that this rank owns."""
        return self.vertex[: self.position_space.dofmap.index_map.size_local]

    @property
    def owned_cells(self) -> Ints:
        """Pattern triangles that this rank owns, in the order of their density dofs."""
        return self.cell[: self.density_space.dofmap.index_map.size_local]

    def gather_vertices(self, owned: Floats) -> Floats:
        """Return values at all vertices on every rank, from owned ones, (k, …) (collective)."""
        return gather_by_index(self.comm, self.owned_vertices, owned, len(self.pattern.points))

    def gather_cells(self, owned: Floats) -> Floats:
        """Return values at all triangles on every rank, from owned ones, (k, …) (collective)."""
        return gather_by_index(self.comm, self.owned_cells, owned, len(self.pattern.panel))


@collective("comm")
def sew(comm: MPI.Comm, pattern: Pattern) -> Skin:
    """Sew a pattern into a skin, distributed over a communicator (collective).

    Args:
        comm: Communicator.
        pattern: The same pattern on every rank.

    Raises:
        ParameterError: The pattern is no `Pattern`, or not the same on all ranks.
        PatternError: There are more ranks than triangles.

    Warns:
        UnitWarning: The skin is smaller than 0.1 mm or larger than 10 m.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern, by meshes.cylinder for instance")
    if comm.size > len(pattern.panel):
        raise PatternError(
            f"{len(pattern.panel)} triangles cannot be shared by {comm.size} ranks, since each "
            "needs one. Use fewer ranks, or a finer mesh."
        )
    if not SMALLEST <= pattern.size <= LARGEST:
        warn_together(
            comm,
            f"the skin is {pattern.size:.3g} m across; skins are {SMALLEST:g} m to {LARGEST:g} m. "
            "All lengths are in m. From millimetres? Give scale = 1e-3 where it is read.",
            UnitWarning,
        )
    root = comm.rank == 0
    points, triangles = pattern.points, pattern.triangles
    # A mesh of the embedded surface gives topology, partition and numbering.
    embedded = mesh.create_mesh(
        comm,
        cells=triangles if root else np.zeros((0, 3), dtype=np.int64),
        x=points if root else np.zeros((0, 3)),
        e=ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))),
        partitioner=partitioner(pattern),
    )
    topology = embedded.topology
    original = np.asarray(topology.original_cell_index, dtype=np.int64)
    nodes = compat.geometry_dofmap(embedded.geometry)
    corner = np.asarray(embedded.geometry.input_global_indices, dtype=np.int64)[nodes]
    # A second geometry on it puts each corner at its place on the flat panel.
    place = np.argmax(triangles[original][:, None, :] == corner[:, :, None], axis=2)
    flat = np.take_along_axis(pattern.corners[original], place[:, :, None], axis=1)
    cells = topology.index_map(2)
    count = cells.size_local + cells.num_ghosts
    geometry = cpp.mesh.Geometry_float64(
        concatenated_index_map(comm, [(cells, 3)])[0],
        np.arange(3 * count, dtype=np.int32).reshape(count, 3),
        compat.coordinate_map(embedded.geometry),
        np.ascontiguousarray(flat.reshape(-1, 2)),
        (3 * original[:, None] + np.arange(3)).ravel(),
    )
    cpp_topology = getattr(topology, "_cpp_object", topology)
    domain = mesh.Mesh(
        cpp.mesh.Mesh_float64(comm, cpp_topology, geometry),
        ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))),
    )
    position_space = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    density_space = fem.functionspace(domain, ("DG", 0))
    vertex = np.zeros(_local_size(position_space), dtype=np.int64)
    vertex[position_space.dofmap.list.ravel()] = corner.ravel()
    cell = np.zeros(_local_size(density_space), dtype=np.int64)
    cell[density_space.dofmap.list.ravel()] = original
    return Skin(pattern, domain, position_space, density_space, vertex, cell)


def concatenated_index_map(
    comm: MPI.Comm, parts: list[tuple[Any, int]]
) -> tuple[Any, list[npt.NDArray[np.int32]]]:
    """Concatenate index maps (collective).

    Args:
        comm: Communicator.
        parts: Index maps, each with the block size by which it is unrolled. A rank owns its entries
            of the first part, then those of the second; ghosts follow in the same order.

    Returns:
        The index map, and the local indices in it of the entries of each part, owned ones first.
    """
    owned = np.array([block * index_map.size_local for index_map, block in parts])
    everywhere = np.array(comm.allgather(owned.tolist()))
    begin = np.concatenate([[0], np.cumsum(everywhere.sum(axis=1))])
    ahead = np.cumsum(everywhere, axis=1) - everywhere  # entries of earlier parts on the same rank
    ghosts, owners, numbers = [], [], []
    before, count = 0, int(owned.sum())
    for p, (index_map, block) in enumerate(parts):
        starts = np.concatenate([[0], np.cumsum(everywhere[:, p])])[:-1]
        owner = np.repeat(np.asarray(index_map.owners), block)
        entry = np.asarray(index_map.ghosts)[:, None] * block + np.arange(block)
        ghosts.append(entry.ravel() - starts[owner] + ahead[owner, p] + begin[owner])
        owners.append(owner)
        here = before + np.arange(owned[p])
        there = count + np.arange(entry.size)
        numbers.append(np.concatenate([here, there]).astype(np.int32))
        before, count = before + int(owned[p]), count + entry.size
    concatenated = compat.index_map(
        comm,
        int(owned.sum()),
        np.concatenate(ghosts).astype(np.int64),
        np.concatenate(owners).astype(np.int32),
    )
    return concatenated, numbers


def _local_size(space: fem.FunctionSpace) -> int:
    index_map = space.dofmap.index_map
    return int(index_map.size_local + index_map.num_ghosts)
