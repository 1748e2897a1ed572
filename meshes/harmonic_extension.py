"""Harmonic extension over the flat panels, from fixed vertices to the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Bools, Floats
from toros_fem.meshes.pattern import Pattern

# Damping over the Laplacian's diagonal: without any fixed vertex the extension is zero.
DAMPING = 1e-9


def flat_laplacian(pattern: Pattern) -> csr_array:
    """Return the stiffness of linear elements on the flat panels, sewn together, (n, n)."""
    corner, tri = pattern.corners, pattern.triangles
    opposite = np.roll(corner, -1, axis=1) - np.roll(corner, -2, axis=1)  # turned gradients · 2 Ā
    entries = np.einsum("tik,tjk->tij", opposite, opposite) / (4 * pattern.areas[:, None, None])
    rows = np.repeat(tri, 3, axis=1).ravel()
    columns = np.tile(tri, (1, 3)).ravel()
    count = len(pattern.points)
    whole = csr_array(coo_array((entries.ravel(), (rows, columns)), shape=(count, count)))
    return whole + DAMPING * whole.diagonal().mean() * csr_array(eye_array(count))


def harmonic_extension(laplacian: csr_array, fixed: Bools) -> Callable[[Floats], Floats]:
    """Return a function that replaces the values (n,) of free vertices by harmonic ones.

    Args:
        laplacian: Matrix of `flat_laplacian`.
        fixed: Vertices that keep their values, (n,).
    """
    free = ~fixed
    if not free.any():
        return lambda values: values
    rows = laplacian[free]
    inner, border = splu(rows[:, free].tocsc()), rows[:, fixed]

    def extend(values: Floats) -> Floats:
        out = values.copy()
        out[free] = -inner.solve(border @ values[fixed])
        return out

    return extend
