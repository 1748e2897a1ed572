"""Patch space: numbers of unknowns, and what triangles see of each other."""

import numpy as np
import pytest
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.mpi import total
from toros_fem.materials.sheet import CURVATURES, Bending, Composite
from toros_fem.mechanics.skin.patch_space import (
    Patch,
    Unknowns,
    blocks_of_first_rank,
    make_patch,
)
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.mechanics.terms.sheet import Bend
from toros_fem.meshes import Skin


def patch_of(skin: Skin, curvature: str | None, *, lattice: bool = False, bodies: int = 0) -> Patch:
    """Rotations of the edges, two columns that all triangles see, and motions of bodies."""
    unknowns, flaps = [], None
    if curvature is not None:
        bend = Bend(skin, Composite(), Bending(curvature), clamp(skin.pattern, ["base"]))
        flaps = bend.hinges.flap
        unknowns = [] if bend.unknowns is None else [bend.unknowns]
    if lattice:
        seen = np.tile(np.arange(2, dtype=np.int32), (len(skin.cell), 1))
        columns = blocks_of_first_rank(skin.comm, 2)
        unknowns.append(Unknowns(columns, np.zeros((2, 3), dtype=bool), seen, placed=True))
    if bodies:
        fixed = np.zeros((bodies, 6), dtype=bool)
        unknowns.append(Unknowns(blocks_of_first_rank(skin.comm, bodies), fixed))
    return make_patch(skin, flaps, unknowns)


@pytest.mark.parametrize("curvature", [None, *CURVATURES])
@pytest.mark.parametrize("lattice", [False, True])
def test_number_of_unknowns(short_tube: Skin, curvature: str | None, lattice: bool) -> None:
    """Three a vertex; with rotations one an edge (Euler: E = V + F − 2); six of a lattice."""
    vertices, cells = len(short_tube.pattern.points), len(short_tube.pattern.panel)
    expected = 3 * vertices + 6 * lattice
    expected += (vertices + cells - 2) * (curvature == "midedge")
    patch = patch_of(short_tube, curvature, lattice=lattice)
    assert patch.space.dofmap.index_map.size_global == expected
    seen = {None: 9, "average": 18, "midedge": 21}[curvature] + 6 * lattice
    assert patch.space.dofmap.list.shape[1] == seen
    assert total(short_tube.comm, patch.numbers.size) == 3 * vertices
    assert patch.components == seen - 6 * lattice
    if lattice:
        assert patch.dofs[-1].shape == (2, 3)


def test_triangles_see_their_corners_and_flaps(short_tube: Skin, alone: MPI.Comm) -> None:
    """The vertex across each edge is the far one of the neighbour in the pattern."""
    patch = patch_of(short_tube, "average")
    vertex = np.full(patch.space.dofmap.list.max() + 1, -1)
    vertex[patch.position_dofs] = short_tube.vertex[:, None]
    owned = len(short_tube.owned_cells)
    seen = vertex[patch.space.dofmap.list[:owned].reshape(owned, 6, 3)[:, :, 0]]
    across: dict[frozenset[int], set[int]] = {}
    for row in short_tube.pattern.triangles:
        triangle = [int(v) for v in row]
        for i in range(3):
            edge = frozenset((triangle[i], triangle[(i + 1) % 3]))
            across.setdefault(edge, set()).add(triangle[(i + 2) % 3])
    own = {
        frozenset(int(v) for v in short_tube.pattern.triangles[cell])
        for cell in short_tube.owned_cells
    }
    assert {frozenset(int(v) for v in corners) for corners in seen[:, :3]} == own
    for row in seen:
        corners, flaps = [int(v) for v in row[:3]], [int(v) for v in row[3:]]
        for i in range(3):
            edge = frozenset((corners[(i + 1) % 3], corners[(i + 2) % 3]))
            assert across[edge] == {corners[i], flaps[i]}


@pytest.mark.parametrize("curvature", [None, "midedge"])
@pytest.mark.parametrize("lattice", [False, True])
def test_unknowns_of_bodies(short_tube: Skin, curvature: str | None, lattice: bool) -> None:
    """The first rank owns them, all know them, and no triangle sees them."""
    comm = short_tube.comm
    plain = patch_of(short_tube, curvature, lattice=lattice)
    patch = patch_of(short_tube, curvature, lattice=lattice, bodies=2)
    index_map = patch.space.dofmap.index_map
    assert index_map.size_global == plain.space.dofmap.index_map.size_global + 12
    bodies = patch.dofs[-1]
    assert bodies.shape == (2, 6)
    assert len(patch.dofs) == len(plain.dofs) + 1
    assert not np.isin(patch.space.dofmap.list, bodies).any()
    if lattice:
        assert np.isin(patch.space.dofmap.list, patch.dofs[-2]).any()
    assert (bodies < index_map.size_local).all() == (comm.rank == 0)
    known = index_map.local_to_global(bodies.ravel())
    assert np.array_equal(known, comm.bcast(known, root=0))

    state = fem.Function(patch.space)
    if comm.rank == 0:
        state.x.array[bodies] = np.arange(12.0).reshape(2, 6)
    state.x.scatter_forward()
    assert np.array_equal(state.x.array[bodies], np.arange(12.0).reshape(2, 6))
    # Forms see the skin alone: what they assemble is zero there.
    form = fem.form(ufl.dot(state, ufl.TestFunction(patch.space)) * ufl.dx)
    assembled = fem.assemble_vector(form)
    assembled.scatter_reverse(la.InsertMode.add)
    assert not assembled.array[bodies].any()
