"""Prescribed displacement of fixed components, and its extension to the free ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from toros_fem._mpi import largest
from toros_fem._types import Floats
from toros_fem.mechanics.model import SkinModel
from toros_fem.meshes.harmonic_extension import flat_laplacian, harmonic_extension
from toros_fem.meshes.mirror import FLAT


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
            laplacian = flat_laplacian(self._model.skin.pattern)
            for fixed in self._model.supports.fixed.T:
                self._solvers.append(harmonic_extension(laplacian, fixed))
        return np.stack([f(jump[:, k]) for k, f in enumerate(self._solvers)], axis=1)
