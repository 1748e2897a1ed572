"""Forces that keep their direction."""

from __future__ import annotations

from typing import override

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import total
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import positions
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


class DeadForce(Term):
    """Dead forces on the vertices; their work counts from the assembled positions."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._force: Floats | None = None

    @override
    def set_load(self, load: Load) -> None:
        self._force = None if load.force is None else load.force[self._skin.owned_vertices]

    def _moved(self, x: Floats) -> Floats:
        skin = self._skin
        return np.asarray(positions(skin, x) - skin.pattern.points[skin.owned_vertices])

    @override
    def energy(self, x: Floats) -> float:
        if self._force is None:
            return 0.0
        return -total(self._skin.comm, float((self._force * self._moved(x)).sum()))

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        if self._force is not None:
            positions(self._skin, out)[:] -= self._force

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        if self._force is not None:
            positions(self._skin, out)[:] += self._force

    @override
    def load_energy(self, x: Floats) -> float:
        if self._force is None:
            return 0.0
        return total(self._skin.comm, float(np.abs(self._force * self._moved(x)).sum()))
