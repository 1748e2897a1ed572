"""The sewn skin has the same mesh on any number of ranks."""

import dolfinx
import pytest
import ufl
from mpi4py import MPI

from toros_fem._mpi import total
from toros_fem.meshes import Tile, sew, tile
from toros_fem.meshes.tile import KINDS

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
