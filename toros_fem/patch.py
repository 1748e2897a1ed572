"""The patch space: each triangle sees its corners and its neighbours' far vertices."""

from __future__ import annotations

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import cpp, fem

from toros_fem import _compat
from toros_fem.meshes.skin import Skin, blocked_index_map


def patch_space(skin: Skin, *, flaps: bool) -> tuple[fem.FunctionSpace, npt.NDArray[np.float64]]:
    """A space of three or six points a triangle, on the dofs of the positions (collective).

    A DG0 mixed element holds the points as constants of the triangle; its dofmap points at the
    dofs of the continuous position field, unrolled. An energy of a triangle and its neighbours
    thus is an ordinary cell integral.

    Args:
        skin: The sewn skin.
        flaps: Whether the three flap vertices follow the three corners; flap i lies across the
            edge opposite corner i. Where an edge is free, a corner stands in.

    Returns:
        The space, and for each local triangle and edge whether there is a flap, shape (cells, 3).
    """
    corner = skin.position_space.dofmap.list
    nodes = corner
    has_flap = np.zeros(corner.shape)
    if flaps:
        flap, has_flap = _flap_nodes(skin, corner)
        nodes = np.hstack([corner, flap])
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    element = basix.ufl.mixed_element(
        [basix.ufl.element("DG", "triangle", 0, shape=(3,))] * nodes.shape[1]
    )
    plain = fem.functionspace(skin.mesh, element)
    dofmap = cpp.fem.DofMap(
        plain.dofmap._cpp_object.dof_layout,
        blocked_index_map(skin.comm, skin.position_space.dofmap.index_map, 3),
        1,
        cpp.graph.AdjacencyList_int32(np.ascontiguousarray(dofs, dtype=np.int32)),
        1,
    )
    return _compat.function_space(skin.mesh, element, dofmap, plain), has_flap


def _flap_nodes(
    skin: Skin, corner: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    topology = skin.mesh.topology
    topology.create_connectivity(2, 1)
    topology.create_connectivity(1, 2)
    facets = topology.connectivity(2, 1).array.reshape(-1, 3)
    around = topology.connectivity(1, 2)
    start, count = around.offsets[:-1], np.diff(around.offsets)
    first = around.array[start]
    second = around.array[np.minimum(start + 1, len(around.array) - 1)]
    cell = np.arange(len(facets))[:, None]
    has_flap = count[facets] == 2
    other = np.where(first[facets] == cell, second[facets], first[facets])
    other = np.where(has_flap, other, cell)
    opposite = np.argmax(facets[other] == facets[:, :, None], axis=2)
    return corner[other, opposite], has_flap.astype(np.float64)
