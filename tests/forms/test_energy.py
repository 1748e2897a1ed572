"""Blocks of the tangent that fall together, against `ufl.derivative`."""

import numpy as np
from helpers.models import (
    automatic_tangent,
    pressurize,
    upper_rows,
)
from mpi4py import MPI
from scipy.sparse import csr_matrix, triu

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern, sew


def test_patch_that_meets_a_vertex_twice(comm: MPI.Comm) -> None:
    """On a tetrahedron all three flaps of a triangle are one vertex: blocks fall together."""
    points = 0.01 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    triangles = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    side = np.linalg.norm(points[1] - points[0])
    flat = side * np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    pattern = Pattern(
        flat_points=np.concatenate([flat + [2 * side * k, 0] for k in range(4)]),
        flat_triangles=np.arange(12).reshape(4, 3),
        panel=np.arange(4),
        sewn=triangles.ravel(),
        points=points,
        panel_names=("a", "b", "c", "d"),
    )
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:2] = fixed[2, :2] = True
    thick = Material(young=1e5, poisson=0.3, thickness=5e-3)
    model = SkinModel(sew(MPI.COMM_SELF, pattern), Composite(fabric=thick), Supports(fixed))
    model.set_density(np.zeros(4))
    pressurize(model, 100.0)
    state = model.assembled + 1e-3 * np.random.default_rng(1).standard_normal(18) * model.free
    closed = upper_rows(model, state)
    rows, columns, values = automatic_tangent(model, state).getValuesCSR()
    automatic = triu(csr_matrix((values, columns, rows), shape=closed.shape))
    assert abs(closed - automatic).max() <= 1e-13 * abs(automatic).max()
