"""Prescribed displacement of fixed components, and its extension to the free ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from toros_fem._mpi import largest
from toros_fem._types import Bools, Floats
from toros_fem.mechanics.model import SkinModel
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.pattern import Pattern

# Damping over the Laplacian's diagonal: without any fixed vertex the extension is zero.
DAMPING = 1e-9


class PrescribedDisplacement:
    """Displacement of the fixed components of a state to their prescribed positions.

    Moved alone, they would stretch the triangles next to them by the whole displacement. So the
    free components follow by the harmonic extension over the flat panels, each component by itself:
    on a strip that is pulled this is the exact solution. The pattern is whole on every rank, so
    that each computes the same.

    Args:
        model: The skin's model.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._solvers: list[Callable[[Floats], Floats]] = []  # made when something first moves

    def __call__(self, state: Floats, displacement: Floats | None) -> Floats:
        """Return the state with its fixed components in place (collective).

        Args:
            state: Owned unknowns.
            displacement: Displacement of each assembled vertex from its assembled position in m,
                (n, 3), read at fixed components; None leaves them there.
        """
        model, skin = self._model, self._model.skin
        goal, fixed = model.assembled, ~model.free
        if displacement is not None:
            model.positions(goal)[:] += displacement[skin.owned_vertices]
        placed = np.where(fixed, goal, state)
        jump = model.positions(placed - state)
        distance = largest(skin.comm, float(np.abs(jump).max(initial=0.0)))
        if distance > FLAT * skin.pattern.size:
            spread = self._extension(skin.gather_vertices(jump))
            along = np.zeros_like(state)
            model.positions(along)[:] = spread[skin.owned_vertices]
            placed += np.where(fixed, 0.0, along)
        return placed

    def _extension(self, jump: Floats) -> Floats:
        if not self._solvers:
            laplacian = _laplacian(self._model.skin.pattern)
            for fixed in self._model.supports.fixed.T:
                self._solvers.append(_extender(laplacian, fixed))
        return np.stack([f(jump[:, k]) for k, f in enumerate(self._solvers)], axis=1)


def _laplacian(pattern: Pattern) -> csr_array:
    """Return the stiffness of linear elements on the flat panels, sewn together, (n, n)."""
    corner, tri = pattern.corners, pattern.triangles
    opposite = np.roll(corner, -1, axis=1) - np.roll(corner, -2, axis=1)  # turned gradients · 2 Ā
    entries = np.einsum("tik,tjk->tij", opposite, opposite) / (4 * pattern.areas[:, None, None])
    rows = np.repeat(tri, 3, axis=1).ravel()
    columns = np.tile(tri, (1, 3)).ravel()
    count = len(pattern.points)
    whole = csr_array(coo_array((entries.ravel(), (rows, columns)), shape=(count, count)))
    return whole + DAMPING * whole.diagonal().mean() * csr_array(eye_array(count))


def _extender(laplacian: csr_array, fixed: Bools) -> Callable[[Floats], Floats]:
    """Return the harmonic extension from the fixed vertices to the others."""
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
