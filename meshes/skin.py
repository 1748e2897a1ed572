"""The sewn skin: a mesh with the topology of the assembled surface and the flat geometry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import cpp, fem, mesh
from mpi4py import MPI

from toros_fem.base import fenicsx
from toros_fem.base.errors import PatternError
from toros_fem.base.mpi import gather_by_index, require_comm
from toros_fem.base.validation import Floats, Ints, LocalInts, require_kind
from toros_fem.meshes.pattern import Pattern

# Sizes in m, of the bounding box's diagonal, beyond which a unit is wrong.
SMALLEST, LARGEST = 1e-4, 20.0


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

    @cached_property
    def neighbours(self) -> tuple[LocalInts, LocalInts]:
        """Local triangle across each edge, or itself, and its corner off the edge, (cells, 3)."""
        topology = self.mesh.topology
        topology.create_connectivity(2, 1)
        topology.create_connectivity(1, 2)
        facets = topology.connectivity(2, 1).array.reshape(-1, 3)
        around = topology.connectivity(1, 2)
        start, count = around.offsets[:-1], np.diff(around.offsets)
        first = around.array[start]
        second = around.array[np.minimum(start + 1, len(around.array) - 1)]
        cell = np.arange(len(facets))[:, None]
        other = np.where(first[facets] == cell, second[facets], first[facets])
        other = np.where(count[facets] == 2, other, cell)
        return other, np.argmax(facets[other] == facets[:, :, None], axis=2)

    def gather_vertices(self, owned: Floats) -> Floats:
        """Return values at all vertices on every rank, from owned ones, (k, …) (collective)."""
        return gather_by_index(self.comm, self.owned_vertices, owned, len(self.pattern.points))

    def gather_cells(self, owned: Floats) -> Floats:
        """Return values at all triangles on every rank, from owned ones, (k, …) (collective)."""
        return gather_by_index(self.comm, self.owned_cells, owned, len(self.pattern.panel))


def sew(comm: MPI.Comm, pattern: Pattern) -> Skin:
    """Sew a pattern into a skin, distributed over a communicator (collective).

    Raises:
        ParameterError: The pattern is no `Pattern`.
        PatternError: There are more ranks than triangles, or the skin is smaller than 0.1 mm or
            larger than 20 m.
    """
    require_comm(comm)
    require_kind("pattern", pattern, Pattern, "a Pattern, by meshes.cylinder for instance")
    if comm.size > len(pattern.panel):
        raise PatternError(
            f"{len(pattern.panel)} triangles cannot be shared by {comm.size} ranks, since each "
            "needs one. Use fewer ranks, or a finer mesh."
        )
    if not SMALLEST <= pattern.size <= LARGEST:
        raise PatternError(
            f"the skin is {pattern.size:.3g} m across; possible is {SMALLEST:g} to {LARGEST:g} m. "
            "All lengths are in m. From millimetres? Give scale = 1e-3 where it is read."
        )
    root = comm.rank == 0
    points, triangles = pattern.points, pattern.triangles
    # A mesh of the embedded surface gives topology, partition and numbering.
    embedded = mesh.create_mesh(
        comm,
        cells=triangles if root else np.zeros((0, 3), dtype=np.int64),
        x=points if root else np.zeros((0, 3)),
        e=ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))),
        partitioner=_partitioner(pattern),
    )
    topology = embedded.topology
    original = np.asarray(topology.original_cell_index, dtype=np.int64)
    nodes = fenicsx.geometry_dofmap(embedded.geometry)
    corner = np.asarray(embedded.geometry.input_global_indices, dtype=np.int64)[nodes]
    # A second geometry on it puts each corner at its place on the flat panel.
    place = np.argmax(triangles[original][:, None, :] == corner[:, :, None], axis=2)
    flat = np.take_along_axis(pattern.corners[original], place[:, :, None], axis=1)
    cells = topology.index_map(2)
    count = cells.size_local + cells.num_ghosts
    geometry = cpp.mesh.Geometry_float64(
        concatenated_index_map(comm, [(cells, 3)])[0],
        np.arange(3 * count, dtype=np.int32).reshape(count, 3),
        fenicsx.coordinate_map(embedded.geometry),
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
    vertex = _by_dof(position_space, corner)
    cell = _by_dof(density_space, original)
    return Skin(pattern, domain, position_space, density_space, vertex, cell)


def concatenated_index_map(
    comm: MPI.Comm, parts: list[tuple[Any, int]]
) -> tuple[Any, list[npt.NDArray[np.int32]]]:
    """Concatenate index maps, each unrolled by its block size (collective).

    A rank owns its entries of the first part, then those of the second; ghosts follow in the same
    order. Returned are the index map, and the local indices in it of each part's entries.
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
    concatenated = fenicsx.index_map(
        comm,
        int(owned.sum()),
        np.concatenate(ghosts).astype(np.int64),
        np.concatenate(owners).astype(np.int32),
    )
    return concatenated, numbers


def _by_dof(space: fem.FunctionSpace, numbers: Ints) -> Ints:
    """Return numbers by local dof, (n,), from those at the dofs of each cell."""
    index_map = space.dofmap.index_map
    found: Ints = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    found[space.dofmap.list.ravel()] = numbers.ravel()
    return found


def parts_of(pattern: Pattern, count: int) -> Ints:
    """Return the part of each triangle, (t,): compact parts of nearly equal sizes.

    Recursive bisection by inertia: the assembled triangles are divided across the axis along which
    they extend most (Simon 1991). Graph partitioners give shorter borders on branched shapes, but
    on several ranks not the same ones in every run.
    """
    middles = pattern.points[pattern.triangles].mean(axis=1)
    found = np.zeros(len(middles), dtype=np.int64)
    everything: Ints = np.arange(len(middles), dtype=np.int64)
    left = [(everything, 0, count)]
    while left:
        cells, first, number = left.pop()
        if number == 1:
            found[cells] = first
            continue
        away = middles[cells] - middles[cells].mean(axis=0)
        axis = np.linalg.eigh(away.T @ away)[1][:, -1]
        ordered = cells[np.argsort(away @ axis, kind="stable")]
        half = number // 2
        size = round(len(cells) * half / number)
        left.append((ordered[:size], first, half))
        left.append((ordered[size:], first + half, number - half))
    return found


def _partitioner(pattern: Pattern) -> Any:
    """Return a partitioner for `dolfinx.mesh.create_mesh` with a ghost layer across edges.

    The first rank must give all triangles, in the pattern's order, and the others none.
    """

    def destinations(_comm: Any, ranks: int, _types: Any, cells: Any) -> Any:
        if len(cells[0]) == 0:
            return fenicsx.adjacency(np.zeros(0, np.int32), np.zeros(1, np.int32))
        part = parts_of(pattern, ranks)
        sides = pattern.edges.sides[pattern.edges.inner]
        both = np.concatenate([sides, sides[:, ::-1]])
        seen = np.unique(np.column_stack([both[:, 0], part[both[:, 1]]]), axis=0)
        seen = seen[part[seen[:, 0]] != seen[:, 1]]  # ghosts of other ranks
        own = np.column_stack([np.arange(len(part)), part])
        rows = np.concatenate([own, seen])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]  # the owner comes first
        offsets = np.concatenate([[0], np.cumsum(np.bincount(rows[:, 0]))])
        return fenicsx.adjacency(rows[:, 1].astype(np.int32), offsets.astype(np.int32))

    return destinations
