"""Patch space, in which a triangle sees corners, far vertices and more unknowns; coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import cpp, fem
from mpi4py import MPI

from toros_fem.base import fenicsx
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import gather_by_index
from toros_fem.base.validation import Bools, Floats, Ints, LocalInts
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.skin import Skin, concatenated_index_map
from toros_fem.meshes.triangles import edge_keys, opposite_edges


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknowns beside the positions, in blocks.

    Attributes:
        index_map: Blocks of this rank.
        fixed: Fixed ones among the local ones, (blocks, size).
        seen: Blocks that each triangle sees, (cells, k); None if it sees none.
        original: Returns the number of each local block in an order that no partition changes,
            and how many there are; None where all ranks know all blocks, in one order.
        placed: Whether triangles see them only in where `Term.place` puts their nodes, so that
            they have no entries of their own in the tangents of triangles.
    """

    index_map: Any
    fixed: Bools
    seen: LocalInts | None = None
    original: Callable[[], tuple[Ints, int]] | None = None
    placed: bool = False

    @property
    def size(self) -> int:
        """Unknowns of a block."""
        return int(self.fixed.shape[1])


@dataclass(frozen=True, eq=False)
class Patch:
    """Unknowns of a skin, and the function space by which its triangles see them.

    The unknowns a rank owns are the positions of its nodes, x, y, z of each, then the others in
    their given order. Ghosts follow in the same order.

    Attributes:
        skin, unknowns: As given.
        space: On a triangle, the positions of its corners and flaps, then the other unknowns.
        position_dofs: Local unknowns of each local node of the position space, (n, 3).
        numbers: Global unknowns of each owned node, (k, 3).
        dofs: Local unknowns of the blocks of each of the others, (blocks, size).
        components: Number of components with entries in the tangent of a triangle.
    """

    skin: Skin
    unknowns: Sequence[Unknowns]
    space: fem.FunctionSpace
    position_dofs: LocalInts
    numbers: Ints
    dofs: Sequence[LocalInts]
    components: int

    def gather(self, state: Floats) -> Floats:
        """Return all unknowns of a state on every rank, in an order that no partition changes.

        It is that of the pattern: positions of the vertices, then the other unknowns (collective).
        """
        parts: list[Floats] = []
        for dofs, numbers, count in self._kinds():
            owned = dofs[:, 0] < len(state)
            rows = gather_by_index(self.skin.comm, numbers[owned], state[dofs[owned]], count)
            parts.append(rows.ravel())
        return np.concatenate(parts)

    def scatter(self, unknowns: Floats) -> Floats:
        """Return the state of this rank from all unknowns, as of `gather`."""
        kinds = self._kinds()
        sizes = [count * dofs.shape[1] for dofs, _, count in kinds]
        if unknowns.shape != (sum(sizes),):
            raise ParameterError(
                f"the unknowns have shape {unknowns.shape}; this skin has ({sum(sizes)},)."
            )
        state = np.zeros(self.space.dofmap.index_map.size_local)
        parts = np.split(unknowns, np.cumsum(sizes)[:-1])
        for part, (dofs, numbers, count) in zip(parts, kinds, strict=True):
            owned = dofs[:, 0] < len(state)
            state[dofs[owned]] = part.reshape(count, dofs.shape[1])[numbers[owned]]
        return state

    def _kinds(self) -> list[tuple[LocalInts, Ints, int]]:
        """Of each kind the local unknowns of blocks, the blocks' original numbers, how many."""
        found = [(self.position_dofs, self.skin.vertex, len(self.skin.pattern.points))]
        for dofs, more in zip(self.dofs, self.unknowns, strict=True):
            known = np.arange(len(dofs)), len(dofs)
            found.append((dofs, *(known if more.original is None else more.original())))
        return found


def positions(skin: Skin, state: Floats) -> Floats:
    """Return the positions (n, 3) of the owned nodes in a state, as a view; also of forces."""
    return state[: 3 * len(skin.owned_vertices)].reshape(-1, 3)


def make_patch(skin: Skin, flaps: LocalInts | None, unknowns: Sequence[Unknowns]) -> Patch:
    """Return the patch of a skin (collective).

    The space is a DG0 mixed element: everything a triangle sees is constant on it, and the dofmap
    points at the unknowns. So an energy of a triangle and its neighbours is an ordinary cell
    integral. Flaps are the nodes across the edges of each triangle, (cells, 3); None where it sees
    none. What it sees of one kind of unknowns is a multiple of three.
    """
    nodes = skin.position_space.dofmap.index_map
    index_map, numbers = concatenated_index_map(
        skin.comm, [(nodes, 3), *((more.index_map, more.size) for more in unknowns)]
    )
    corners = skin.position_space.dofmap.list
    seen = corners if flaps is None else np.hstack([corners, flaps])
    cells = len(seen)
    parts = [numbers[0].reshape(-1, 3)[seen].reshape(cells, -1)]
    components = parts[0].shape[1]
    dofs = [of.reshape(-1, more.size) for of, more in zip(numbers[1:], unknowns, strict=True)]
    for of, more in zip(dofs, unknowns, strict=True):
        if more.seen is not None:
            parts.append(of[more.seen].reshape(cells, -1))
            components += 0 if more.placed else parts[-1].shape[1]
    whole = np.ascontiguousarray(np.hstack(parts), dtype=np.int32)
    element = basix.ufl.mixed_element(
        [basix.ufl.element("DG", "triangle", 0, shape=(3,))] * (whole.shape[1] // 3)
    )
    plain = fem.functionspace(skin.mesh, element)
    dofmap = cpp.fem.DofMap(
        plain.dofmap._cpp_object.dof_layout,
        index_map,
        1,
        cpp.graph.AdjacencyList_int32(whole),
        1,
    )
    first = index_map.local_range[0]
    return Patch(
        skin,
        unknowns,
        space=fenicsx.function_space(skin.mesh, element, dofmap, plain),
        position_dofs=numbers[0].reshape(-1, 3),
        numbers=first + np.arange(3 * nodes.size_local).reshape(-1, 3),
        dofs=dofs,
        components=components,
    )


def blocks_of_first_rank(comm: MPI.Comm, count: int) -> Any:
    """Return an index map of blocks that the first rank owns and all others have as ghosts."""
    first = comm.rank == 0
    ghosts: npt.NDArray[np.int64] = np.arange(0 if first else count, dtype=np.int64)
    owners: LocalInts = np.zeros(len(ghosts), dtype=np.int32)
    return fenicsx.index_map(comm, count if first else 0, ghosts, owners)


def pattern_edges(skin: Skin) -> tuple[Ints, int]:
    """Return the pattern's edge of each local edge of the mesh, and the number of all edges.

    The edges of a pattern are numbered by their two assembled vertices.
    """
    triangles, count = skin.pattern.triangles, len(skin.pattern.points)

    def keys(corner: Ints) -> Ints:
        return edge_keys(opposite_edges(corner), count)

    known = np.unique(keys(triangles))
    facets = skin.mesh.topology.connectivity(2, 1).array.reshape(-1, 3)
    edges = np.zeros(int(facets.max(initial=-1)) + 1, dtype=np.int64)
    found = keys(skin.vertex[skin.position_space.dofmap.list])
    edges[facets.ravel()] = np.searchsorted(known, found).ravel()
    return edges, len(known)


def cell_space(skin: Skin, size: int) -> fem.FunctionSpace:
    """Return the space of functions with rows of so many values."""
    return fem.functionspace(skin.mesh, basix.ufl.element("DG", "triangle", 0, shape=(size,)))


def cell_function(space: fem.FunctionSpace, rows: Floats, name: str | None = None) -> fem.Function:
    """Return a function with the rows of all local triangles, (cells, size)."""
    function = fem.Function(space, name=name)
    set_cells(function, rows)
    return function


def set_cells(function: fem.Function, rows: Floats) -> None:
    """Set the rows of all local triangles, (cells, size), in the order of the mesh."""
    place = function.function_space.dofmap.list[:, 0]
    function.x.array.reshape(-1, rows.shape[1])[place] = rows


def constants(skin: Skin, *values: float) -> list[fem.Constant]:
    """Return numbers as constants, so that forms are compiled once for all values."""
    return [fem.Constant(skin.mesh, value) for value in values]


def lame_constants(
    skin: Skin, composite: Composite, factors: Sequence[float]
) -> tuple[list[fem.Constant], list[fem.Constant]]:
    """Return μ and λ, each of fabric and print, times a factor for each of the materials."""
    pairs = list(zip(factors, (composite.fabric, composite.reinforcement), strict=True))
    return (
        constants(skin, *(factor * material.mu for factor, material in pairs)),
        constants(skin, *(factor * material.lam for factor, material in pairs)),
    )
