"""Forces of a pulled sheet that is printed, and their derivatives by both moduli, by the adjoint.

The force on the moving clamp is F = c·r(q, m), with the first variation r of the energy, and c a
unit motion of the clamp. At an equilibrium r vanishes at the free components. So
dF/dm = (c + w)·∂r/∂m with K w = −K c at the free components: w is how the sheet follows the clamp.
A linear functional g of the positions, as the mean lateral stretch, has dG/dm = −(K⁻¹ g)·∂r/∂m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import ufl
from dolfinx import fem

from toros_fem._mpi import dot
from toros_fem._types import Floats
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.solver import EquilibriumResult
from toros_fem.materials import Composite
from toros_fem.mechanics.coefficients import assembled, work_vector
from toros_fem.mechanics.model import SkinModel
from toros_fem.meshes.skin import Skin
from toros_fem.tiles.pull_test import PullMachine

MATERIALS = ("fabric", "reinforcement")
# Change of a modulus from which ∂r/∂m is formed, as a part of it; r is linear in the moduli.
CHANGE = 1.0


@dataclass(frozen=True, eq=False)
class SheetCurve:
    """A pulled sheet, and how it changes with the moduli.

    Attributes:
        stress: Force on the moving clamp over the width in N/m, (k,).
        lateral: Mean lateral stretch of the middle, (k,).
        stress_by, lateral_by: Derivatives by the logarithms of the moduli of fabric and
            reinforcement, (k, 2).
        steps: Number of Newton steps.
    """

    stress: Floats
    lateral: Floats
    stress_by: Floats
    lateral_by: Floats
    steps: int


def scaled(composite: Composite, factors: Sequence[float] | Floats) -> Composite:
    """Return a composite with the moduli of fabric and reinforcement times factors."""
    sheets = {
        name: replace(sheet, young=float(factor) * sheet.young)
        for name, factor in zip(MATERIALS, factors, strict=True)
        for sheet in (getattr(composite, name),)
    }
    return replace(composite, **sheets)


def pulled_sheet(
    skin: Skin,
    composite: Composite,
    density: Floats,
    axis: int,
    strains: Floats,
    gauge: float,
    options: NewtonOptions | None = None,
) -> SheetCurve:
    """Pull a sheet and differentiate its stress and its lateral stretch (collective).

    Args:
        skin: The sewn skin of a flat rectangle along x and y.
        composite: Materials; bending is left out.
        density: Whether each owned triangle is printed, as densities in [0, 1].
        axis: 0 to pull along x, 1 along y.
        strains: Strains of the clamps' distance, in the order of the pull, (k,).
        gauge: Length in m of the middle that the lateral stretch is averaged over.
        options: Options of the equilibrium solver.

    Raises:
        PatternError: The skin is not a flat rectangle along x and y.
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    flat = replace(composite, bending=None)
    machine = PullMachine(skin, flat, axis, gauge, options)
    derivative = _Derivative(machine, flat, density)
    rows, state, steps = [], None, 0
    for strain in strains:
        result = machine.solve(density, float(strain), state)
        state, steps = result.state, steps + result.steps
        rows.append(derivative.at(result))
    values = np.array(rows)
    return SheetCurve(values[:, 0, 0], values[:, 1, 0], values[:, 0, 1:], values[:, 1, 1:], steps)


class _Derivative:
    """Stress, lateral stretch and their derivatives at equilibria of one sheet."""

    def __init__(self, machine: PullMachine, composite: Composite, density: Floats) -> None:
        self.machine, model = machine, machine.solver.model
        skin, axis = model.skin, machine.axis
        self.clamp = np.zeros(model.size_local)
        model.positions(self.clamp)[machine.far[skin.owned_vertices], axis] = 1.0
        self.mean = np.zeros(model.size_local)
        model.positions(self.mean)[:] = machine.lateral_weights()[skin.owned_vertices]
        # ∂r/∂m comes from models with one modulus changed.
        self.changed: list[SkinModel] = []
        for number in range(len(MATERIALS)):
            factors = np.where(np.arange(len(MATERIALS)) == number, 1 + CHANGE, 1.0)
            other = SkinModel(skin, scaled(composite, factors), model.supports)
            other.set_density(other.check(density))
            self.changed.append(other)
        self._direction = fem.Function(model.space)
        action = ufl.derivative(model.ufl_forms.residual, model.q, self._direction)
        self._action = fem.form(action)
        self._buffer = work_vector(model.space)

    def at(self, result: EquilibriumResult) -> Floats:
        """Return stress and lateral stretch, each with its two derivatives, (2, 3)."""
        machine, solver = self.machine, self.machine.solver
        model, state, comm = solver.model, result.state, solver.skin.comm
        stress = machine.forces(result)[1, machine.axis] / machine.width
        positions = solver.skin.gather_vertices(result.positions)
        lateral = machine.middle_stretch(positions)[1 - machine.axis]
        follow = -solver.solve_tangent(self._tangent_times(self.clamp, state), result)
        adjoints = (self.clamp + follow) / machine.width, -solver.solve_tangent(self.mean, result)
        own = model.residual(state) + model.reaction(state)
        out = np.zeros((2, 1 + len(self.changed)))
        out[:, 0] = stress, lateral
        for number, other in enumerate(self.changed):
            change = (other.residual(state) + other.reaction(state) - own) / CHANGE
            out[:, 1 + number] = [dot(comm, adjoint, change) for adjoint in adjoints]
        return out

    def _tangent_times(self, direction: Floats, state: Floats) -> Floats:
        model = self.machine.solver.model
        model.set_state(state)
        self._direction.x.array[: model.size_local] = direction
        self._direction.x.scatter_forward()
        return assembled(self._action, self._buffer)
