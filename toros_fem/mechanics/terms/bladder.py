"""Rubber layer under the fabric."""

from __future__ import annotations

from typing import override

from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.membrane import Logarithm, neo_hooke
from toros_fem.materials.sheet import Bladder
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


class RubberLayer(Term):
    """Neo-Hookean energy of a bladder that stretches with the fabric."""

    def __init__(self, skin: Skin, bladder: Bladder) -> None:
        self._stiffness = bladder.membrane_stiffness
        self._mu = fem.Constant(skin.mesh, self._stiffness / 3)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return neo_hooke(e, self._mu)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return 4 / 3 * self._stiffness  # μ = E/3, λ = 2 μ
