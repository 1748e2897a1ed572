"""Patch space: each triangle sees its corners, its neighbours' far vertices and its edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import cpp, fem
from mpi4py import MPI

from toros_fem.base import compat
from toros_fem.base.array_types import Ints, LocalInts
from toros_fem.mechanics.skin.hinges import Hinges
from toros_fem.meshes.skin import Skin, concatenated_index_map
from toros_fem.meshes.topology import edge_keys


@dataclass(frozen=True, eq=False)
class Patch:
    """Unknowns of a skin, and the function space by which its triangles see them.

    The unknowns a rank owns are the positions of its nodes, x, y, z of each, then the rotations
    of its edges, if there are any. The first rank also owns those of no place on the skin: the
    columns of a mean deformation gradient, and the motions of rigid bodies. Ghosts follow in the
    same order.

    Attributes:
        space: On a triangle, the positions of its corners, of its flaps, and one vector of its
            edges' rotations; without bending the corners alone.
        position_count: Number of the owned unknowns that are positions.
        position_dofs: Local unknowns of each local node of the position space, shape (n, 3).
        rotation_dofs: Local unknown of each local edge; empty without rotations.
        lattice_dofs: Local unknowns of F̄n and F̄t, (2, 3), known on every rank and owned by the
            first; empty for a skin that does not repeat.
        body_dofs: Local unknowns of k free rigid bodies, (k, 6), known on every rank and owned by
            the first: translation, then rotation. No triangle sees them.
    """

    space: fem.FunctionSpace
    position_count: int
    position_dofs: LocalInts
    rotation_dofs: LocalInts
    lattice_dofs: LocalInts
    body_dofs: LocalInts

    @property
    def shared_dofs(self) -> LocalInts:
        """Local unknowns that the first rank owns and every rank knows."""
        return np.concatenate([self.lattice_dofs.ravel(), self.body_dofs.ravel()])


def make_patch(
    skin: Skin, hinges: Hinges | None, *, rotations: bool, lattice: bool = False, bodies: int = 0
) -> Patch:
    """Return the patch of a skin (collective).

    The space is a DG0 mixed element: everything a triangle sees is constant on it, and the dofmap
    points at the unknowns. So an energy of a triangle and its neighbours is an ordinary cell
    integral.

    Args:
        skin: The sewn skin.
        hinges: Hinges of the triangles; None for a skin without bending: corners alone.
        rotations: Whether each edge has a rotation, the same on all ranks.
        lattice: Whether all triangles see the two columns of a mean deformation gradient.
        bodies: Number of free rigid bodies.
    """
    nodes = skin.position_space.dofmap.index_map
    parts: list[tuple[Any, int]] = [(nodes, 3)]
    if rotations:
        skin.mesh.topology.create_entities(1)
        parts.append((skin.mesh.topology.index_map(1), 1))
    if lattice:
        parts.append((_on_first_rank(skin.comm, 2), 3))
    if bodies:
        parts.append((_on_first_rank(skin.comm, bodies), 6))
    index_map, numbers = concatenated_index_map(skin.comm, parts)
    seen = skin.position_space.dofmap.list
    if hinges is not None:
        seen = np.hstack([seen, hinges.flap])
    dofs = numbers[0].reshape(-1, 3)[seen].reshape(len(seen), 3 * seen.shape[1])
    if rotations:
        facets = skin.mesh.topology.connectivity(2, 1).array.reshape(-1, 3)
        dofs = np.hstack([dofs, numbers[1][facets]])
    none: LocalInts = np.zeros(0, dtype=np.int32)
    columns = numbers[2 if rotations else 1] if lattice else none
    dofs = np.hstack([dofs, np.tile(columns, (len(dofs), 1))])
    element = basix.ufl.mixed_element(
        [basix.ufl.element("DG", "triangle", 0, shape=(3,))] * (dofs.shape[1] // 3)
    )
    plain = fem.functionspace(skin.mesh, element)
    dofmap = cpp.fem.DofMap(
        plain.dofmap._cpp_object.dof_layout,
        index_map,
        1,
        cpp.graph.AdjacencyList_int32(np.ascontiguousarray(dofs, dtype=np.int32)),
        1,
    )
    return Patch(
        space=compat.function_space(skin.mesh, element, dofmap, plain),
        position_count=3 * nodes.size_local,
        position_dofs=numbers[0].reshape(-1, 3),
        rotation_dofs=numbers[1] if rotations else none,
        lattice_dofs=columns.reshape(-1, 3),
        body_dofs=(numbers[-1] if bodies else none).reshape(-1, 6),
    )


def _on_first_rank(comm: MPI.Comm, count: int) -> Any:
    """Return an index map of entries that the first rank owns and all others have as ghosts."""
    first = comm.rank == 0
    ghosts: npt.NDArray[np.int64] = np.arange(0 if first else count, dtype=np.int64)
    owners: LocalInts = np.zeros(len(ghosts), dtype=np.int32)
    return compat.index_map(comm, count if first else 0, ghosts, owners)


def pattern_edges(skin: Skin) -> tuple[Ints, int]:
    """Return the pattern's edge of each local edge of the mesh, and the number of all edges.

    The edges of a pattern are numbered by their two assembled vertices.
    """
    triangles, count = skin.pattern.triangles, len(skin.pattern.points)

    def keys(corner: Ints) -> Ints:
        """Return the keys of the edges opposite each corner, (cells, 3)."""
        ends = np.stack([np.roll(corner, -1, axis=1), np.roll(corner, -2, axis=1)], axis=2)
        return edge_keys(ends, count)

    known = np.unique(keys(triangles))
    facets = skin.mesh.topology.connectivity(2, 1).array.reshape(-1, 3)
    edges = np.zeros(int(facets.max(initial=-1)) + 1, dtype=np.int64)
    found = keys(skin.vertex[skin.position_space.dofmap.list])
    edges[facets.ravel()] = np.searchsorted(known, found).ravel()
    return edges, len(known)
