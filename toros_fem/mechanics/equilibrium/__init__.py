"""Stable equilibria of a skin by regularised Newton steps and continuation, eqs. (9, 10)."""

from toros_fem.mechanics.equilibrium.diagnostics import Condition
from toros_fem.mechanics.equilibrium.newton import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)

__all__ = [
    "Condition",
    "EquilibriumError",
    "EquilibriumResult",
    "EquilibriumSolver",
    "NewtonOptions",
    "NewtonStep",
]
