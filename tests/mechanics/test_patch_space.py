"""Patch space: numbers of unknowns, and what triangles see of each other."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem._mpi import total
from toros_fem.materials import CURVATURES, Bending
from toros_fem.mechanics.hinges import find_hinges
from toros_fem.mechanics.patch_space import Patch, make_patch
from toros_fem.mechanics.supports import clamp
from toros_fem.meshes import Skin


def patch_of(skin: Skin, curvature: str | None, *, lattice: bool = False) -> Patch:
    if curvature is None:
        return make_patch(skin, None, rotations=False, lattice=lattice)
    hinges = find_hinges(skin, Bending(curvature), clamp(skin.pattern, ["base"]), 0.3)
    return make_patch(skin, hinges, rotations=curvature == "midedge", lattice=lattice)


@pytest.mark.parametrize("curvature", [None, *CURVATURES])
@pytest.mark.parametrize("lattice", [False, True])
def test_number_of_unknowns(tube: Skin, curvature: str | None, lattice: bool) -> None:
    """Three a vertex; with rotations one an edge (Euler: E = V + F − 2); six of a lattice."""
    vertices, cells = len(tube.pattern.points), len(tube.pattern.panel)
    expected = 3 * vertices + 6 * lattice
    expected += (vertices + cells - 2) * (curvature == "midedge")
    patch = patch_of(tube, curvature, lattice=lattice)
    assert patch.space.dofmap.index_map.size_global == expected
    seen = {None: 9, "average": 18, "quadratic": 18, "midedge": 21}[curvature] + 6 * lattice
    assert patch.space.dofmap.list.shape[1] == seen
    assert total(tube.comm, patch.position_count) == 3 * vertices
    assert patch.lattice_dofs.shape == ((2, 3) if lattice else (0, 3))


def test_triangles_see_their_corners_and_flaps(tube: Skin, comm: MPI.Comm) -> None:
    """The vertex across each edge is the far one of the neighbour in the pattern."""
    patch = patch_of(tube, "average")
    vertex = np.full(patch.space.dofmap.list.max() + 1, -1)
    vertex[patch.position_dofs] = tube.vertex[:, None]
    owned = len(tube.owned_cells)
    seen = vertex[patch.space.dofmap.list[:owned].reshape(owned, 6, 3)[:, :, 0]]
    across: dict[frozenset[int], set[int]] = {}
    for row in tube.pattern.triangles:
        triangle = [int(v) for v in row]
        for i in range(3):
            edge = frozenset((triangle[i], triangle[(i + 1) % 3]))
            across.setdefault(edge, set()).add(triangle[(i + 2) % 3])
    own = {frozenset(int(v) for v in tube.pattern.triangles[cell]) for cell in tube.owned_cells}
    assert {frozenset(int(v) for v in corners) for corners in seen[:, :3]} == own
    for row in seen:
        corners, flaps = [int(v) for v in row[:3]], [int(v) for v in row[3:]]
        for i in range(3):
            edge = frozenset((corners[(i + 1) % 3], corners[(i + 2) % 3]))
            assert across[edge] == {corners[i], flaps[i]}
