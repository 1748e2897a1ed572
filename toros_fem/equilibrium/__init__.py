"""Stable equilibria of a skin by regularised Newton steps and continuation, eqs. (9, 10)."""

from toros_fem.equilibrium.diagnostics import Condition
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver

__all__ = [
    "Condition",
    "EquilibriumError",
    "EquilibriumResult",
    "EquilibriumSolver",
    "NewtonOptions",
    "NewtonStep",
]
