"""Courses of a knit: the plain fabric is stiffer along them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import override

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, bending_of_lines, stretching_energy
from toros_fem.forms.membrane import Logarithm
from toros_fem.materials.sheet import Composite, Knit
from toros_fem.mechanics.skin.cell_functions import cell_function, cell_space
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.terms.constants import constants
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin


class Courses(Term):
    """Courses of a knitted fabric, by their angle in each panel.

    The energy ½ k (|F d| − 1)² acts in every layer of the sheet: k h²/12 against bending.

    Raises:
        ParameterError: A panel has no grain.
        PanelError: There is no panel of a name.
        PatternError: The skin is moulded.
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
