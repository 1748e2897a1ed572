"""Lines of a relaxed design: they stretch, bend and twist with the sheet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import override

from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, bending_of_lines, stretching_energy
from toros_fem.forms.membrane import Logarithm
from toros_fem.forms.offset import coupling_of_lines
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.terms.constants import constants
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


class LineFamilies(Term):
    """Lines made of the reinforcement, as a design has them.

    Along them they have the print's stiffness E h, and E h³/12 against bending, about the fabric's
    middle if the print lies on one face; against twist they have G h³/3.
    """

    def __init__(self, skin: Skin, composite: Composite, design: LineDesign) -> None:
        strip, offset = composite.reinforcement, composite.eccentricity
        h = strip.thickness
        bending = strip.young * h**3 / 12 + offset**2 * h * strip.young
        self._modulus = strip.membrane_stiffness
        self._stiffness = constants(skin, strip.young * h, bending, strip.mu * h**3 / 3)
        self._offset = None if composite.print_side is None else fem.Constant(skin.mesh, offset)

    def _families(self, t: Triangle) -> list[Family]:
        assert t.lines is not None
        return t.lines.families(*self._stiffness)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return stretching_energy(self._families(t), e.C)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_of_lines(self._families(t), Lambda)

    @override
    def of_both(self, t: Triangle, e: Strain, Lambda: Sequence[Scalar]) -> Scalar:
        if self._offset is None:
            return 0
        families = [family.weighted(self._offset) for family in self._families(t)]
        return coupling_of_lines(families, e, Lambda)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        assert isinstance(design, LineDesign)
        return design.cover * self._modulus
