"""Dead loads: the weight of the skin itself, and forces that keep their direction."""

from __future__ import annotations

from typing import override

import numpy as np
from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import total
from toros_fem.forms.interpolation import interpolate
from toros_fem.forms.jets import Jet
from toros_fem.forms.kinematics import Triangle
from toros_fem.forms.loads import weight_potential
from toros_fem.mechanics.skin.coefficients import constants
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import positions
from toros_fem.mechanics.terms.term import PotentialTerm, Term
from toros_fem.meshes.skin import Skin


class OwnWeight(PotentialTerm):
    """Potential of the skin's own weight, of which the load says how much acts."""

    def __init__(self, skin: Skin, weight: Weight) -> None:
        self._skin, self._full = skin, np.asarray(weight.gravity)
        self._gravity = fem.Constant(skin.mesh, np.zeros(3))
        self._masses = constants(skin, weight.fabric, weight.reinforcement)

    @override
    def of_place(self, t: Triangle) -> Jet | None:
        return weight_potential(t.corners, interpolate(t.printed, *self._masses), self._gravity)

    @override
    def set_load(self, load: Load) -> None:
        self._gravity.value[:] = load.weight * self._full

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        out -= self.variation()

    @override
    def load_energy(self, x: Floats) -> float:
        return total(self._skin.comm, float(np.abs(self.variation() * x).sum()))


class DeadForce(Term):
    """Dead forces on the vertices; their work counts from the assembled positions."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._force = np.zeros((len(skin.owned_vertices), 3))

    @override
    def set_load(self, load: Load) -> None:
        self._force[:] = 0 if load.force is None else load.force[self._skin.owned_vertices]

    def _work(self, x: Floats) -> Floats:
        skin = self._skin
        moved = positions(skin, x) - skin.pattern.points[skin.owned_vertices]
        return np.asarray(self._force * moved)

    @override
    def energy(self, x: Floats) -> float:
        return -total(self._skin.comm, float(self._work(x).sum()))

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        positions(self._skin, out)[:] -= self._force

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        positions(self._skin, out)[:] += self._force

    @override
    def load_energy(self, x: Floats) -> float:
        return total(self._skin.comm, float(np.abs(self._work(x)).sum()))
