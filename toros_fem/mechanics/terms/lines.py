"""Lines in the sheet: courses of a knit, and the families of a relaxed design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import override

import numpy as np
from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.forms.bending import coupling_of_lines
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, bending_of_lines, stretching_energy
from toros_fem.forms.membrane import Logarithm
from toros_fem.materials.sheet import Composite, Knit
from toros_fem.mechanics.skin.coefficients import cell_function, cell_space, constants
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin


class Courses(Term):
    """Courses of a knitted fabric, by their angle in each panel.

    The energy ½ k (|F d| − 1)² acts in every layer of the sheet: k h²/12 against bending.
    """

    def __init__(self, skin: Skin, composite: Composite, knit: Knit) -> None:
        skin.pattern.require_flat_panels("the grain of a knit")
        cell = skin.cell[skin.density_space.dofmap.list[:, 0]]
        twice = 2 * _grain(knit, skin.pattern)[skin.pattern.panel[cell]]
        directions = np.column_stack([np.cos(twice), np.sin(twice)])
        direction = cell_function(cell_space(skin, 2), directions, "courses")
        self._stiffness, h = composite.course_stiffness, composite.fabric.thickness
        k, bending = constants(skin, self._stiffness, self._stiffness * h**2 / 12)
        self._family = Family(direction[0], direction[1], k, bending, 0.0)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return stretching_energy([self._family.weighted(t.plain)], e.C)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_of_lines([self._family.weighted(t.plain)], Lambda)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return design.plain(self._stiffness)


def _grain(knit: Knit, pattern: Pattern) -> Floats:
    """Return the angle of the courses in each panel, in rad."""
    if not isinstance(knit.grain, Mapping):
        return np.full(len(pattern.panel_names), knit.grain)
    angles: Floats = np.full(len(pattern.panel_names), np.nan)
    for name, angle in knit.grain.items():
        angles[pattern.panel_index(name)] = angle
    if np.isnan(angles).any():
        bare = [pattern.panel_names[k] for k in np.flatnonzero(np.isnan(angles))]
        raise ParameterError(
            f"grain has no angle for the panels {', '.join(map(repr, bare))}: give one for each "
            "panel, or one number for all."
        )
    return angles


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
