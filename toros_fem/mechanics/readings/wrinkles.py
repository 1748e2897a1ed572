"""Wrinkles of a sheet that carries no compression: where they are, and the tension along them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from types import SimpleNamespace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Floats, Ints, require_kind
from toros_fem.forms.kinematics import interpolate
from toros_fem.forms.membrane import barrier
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.meshes.pattern import Pattern

# Strains below this are rounding, of sewn coordinates too.
ROUNDING = 1e-9
# Imaginary step, whose square is lost, by which eq. (1) is differentiated to rounding.
STEP = 1e-100


class Tension(IntEnum):
    """State of a triangle: tension in no direction, in one, in both."""

    SLACK = 0
    WRINKLED = 1
    TAUT = 2


@dataclass(frozen=True, eq=False)
class WrinkleField:
    """State and direction of tension of all triangles of a pattern; wrinkles run along it.

    Attributes:
        state: Of each triangle, a value of `Tension`, (t,).
        flat: Unit vector of the larger principal stretch on the flat chart, (t, 2); 0 where slack.
            Its sign has no meaning.
        direction: The same on the deformed skin, F d/|F d|, (t, 3).
    """

    state: Ints
    flat: Floats
    direction: Floats

    def share(self, state: Tension, areas: Floats) -> float:
        """Return the fraction in a state of the flat areas of all triangles, (t,), in m²."""
        return float(areas[self.state == state].sum() / areas.sum())


def wrinkle_field(solver: EquilibriumSolver, density: Floats, result: Equilibrium) -> WrinkleField:
    """Return the wrinkles of an equilibrium of a solver, equal on all ranks (collective)."""
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_kind("result", result, Equilibrium, "an Equilibrium of the solver")
    density = solver.model.design.check(density)
    skin = solver.skin
    positions = skin.gather_vertices(result.positions)
    return wrinkles(skin.pattern, solver.model.composite, skin.gather_cells(density), positions)


def wrinkles(
    pattern: Pattern, composite: Composite, density: Floats, positions: Floats
) -> WrinkleField:
    """Return the wrinkles of a pattern whose vertices have been moved to positions, (n, 3), in m.

    A sheet is slack where λ₁ ≤ 1, and elsewhere wrinkled where ∂ψ/∂λ₂ of eq. (1) is negative. The
    densities are those of all triangles, (t,). One that is no tension field is a ParameterError.
    """
    if not composite.membrane.relaxed:
        raise ParameterError(
            "wrinkling = None: this sheet takes compression, and its wrinkles are those of the "
            'mesh. Use Composite(membrane=Membrane(wrinkling="tension-field")).'
        )
    bounds = StretchBounds(MPI.COMM_SELF, pattern.corners, *composite.widest_bounds)
    F = bounds.gradient(positions[pattern.triangles])
    _, stretches, rows = np.linalg.svd(F)
    x, y = stretches.T - 1
    slack = x <= ROUNDING
    across = _stress_across(x, y, composite, density)
    state = np.where(slack, Tension.SLACK, np.where(across < 0, Tension.WRINKLED, Tension.TAUT))
    flat = np.where(slack[:, None], 0.0, rows[:, 0])
    moved = (F @ flat[:, :, None])[:, :, 0]
    return WrinkleField(state, flat, moved / np.where(slack, 1.0, stretches[:, 0])[:, None])


def _stress_across(x: Floats, y: Floats, composite: Composite, density: Floats) -> Floats:
    """Return ∂ψ/∂λ₂ of eq. (1) in N/m at λ₁ = 1 + x and λ₂ = 1 + y; −∞ below the bound of λ₂."""
    fabric, printed = composite.fabric, composite.reinforcement
    mu = interpolate(density, fabric.thickness * fabric.mu, printed.thickness * printed.mu)
    lam = interpolate(density, fabric.thickness * fabric.lam, printed.thickness * printed.lam)
    pairs = zip(composite.fabric_bounds, composite.reinforcement_bounds, strict=True)
    c1, c2 = (interpolate(density, *pair) for pair in pairs)
    outside = y * y >= (c1 - 1) ** 2
    varied = np.where(outside, 0.0, y) + 1j * STEP
    strain: Any = SimpleNamespace(total=x + varied, square=(x - varied) ** 2)
    stress = barrier(strain, mu, lam, c1, c2, np.log1p).imag / STEP
    return np.asarray(np.where(outside, -np.inf, stress))
