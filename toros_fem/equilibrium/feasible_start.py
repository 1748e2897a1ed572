"""Shapes that leave the stretch bounds in a few triangles, relaxed until they are inside."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from toros_fem._types import Bools, Floats, Ints
from toros_fem.materials import Composite
from toros_fem.mechanics.stretch_bounds import StretchBounds
from toros_fem.meshes.pattern import Pattern

# Fraction of the bounds above which a triangle is relaxed.
RELAXED = 0.95
# Number of relaxations, each over one more ring of triangles around.
ROUNDS = 8


def relaxed_into_bounds(
    pattern: Pattern, composite: Composite, fixed: Bools, positions: Floats
) -> Floats | None:
    """Return a shape inside the stretch bounds, near a shape that leaves them in some triangles.

    A shape that is interpolated from a coarser mesh stretches the few triangles most that lie
    across a kink of it. Around these the map from the flat panels is made harmonic.

    Args:
        pattern: The pattern.
        composite: Its stretch bounds.
        fixed: Components that keep their positions, (n, 3).
        positions: Positions of all assembled vertices, (n, 3), in m.

    Returns:
        Positions of all vertices; None if the bounds cannot be met in this way.
    """
    triangles, points = pattern.triangles, pattern.corners
    chart = np.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], axis=2)
    inverse = np.asarray(np.linalg.inv(chart), dtype=np.float64)
    bounds = StretchBounds(MPI.COMM_SELF, inverse, composite.c1, composite.c2)
    found, laplacian = np.array(positions), None
    for rings in range(1, ROUNDS + 1):
        use = bounds.use(found[triangles])
        if use.max(initial=0.0) <= RELAXED:
            break
        if laplacian is None:
            laplacian = _laplacian(triangles, points, len(found))
        near = np.zeros(len(found), dtype=bool)
        near[triangles[~(use <= RELAXED)]] = True
        for _ in range(rings):
            near[triangles[near[triangles].any(axis=1)]] = True
        for k in range(3):
            free = near & ~fixed[:, k]
            rest = laplacian[free] @ np.where(free, 0.0, found[:, k])
            found[free, k] = spsolve(laplacian[free][:, free].tocsc(), -rest)
    return found if bounds.worst(found[triangles]) < 1 else None


def _laplacian(triangles: Ints, corners: Floats, count: int) -> csr_array:
    """Return the matrix of the Dirichlet integral on the flat panels, (n, n)."""
    edges = np.stack([corners[:, (i + 2) % 3] - corners[:, (i + 1) % 3] for i in range(3)], axis=1)
    area = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    values = np.einsum("tik,tjk->tij", edges, edges) / (4 * area[:, None, None])
    rows = np.repeat(triangles, 3, axis=1).ravel()
    columns = np.tile(triangles, 3).ravel()
    return csr_array((values.ravel(), (rows, columns)), shape=(count, count))
