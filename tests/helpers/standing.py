"""Skins that stand on their base, which is clamped."""

from typing import Any

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Skin


def solver_on_base(
    skin: Skin, composite: Composite | None = None, **given: Any
) -> EquilibriumSolver:
    """A solver, by default of the default sheet."""
    base = clamp(skin.pattern, ["base"])
    return EquilibriumSolver(skin, composite or Composite(), base, **given)


def model_on_base(skin: Skin, composite: Composite | None = None, **given: Any) -> SkinModel:
    """The model that such a solver has."""
    base = clamp(skin.pattern, ["base"])
    return make_model(skin, composite or Composite(), base, **given)
