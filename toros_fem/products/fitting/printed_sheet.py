"""Forces of a pulled sheet that is printed, and their derivatives by both moduli, by the adjoint.

The force on the moving clamp is F = c·r(q, m), with the first variation r of the energy, and c a
unit motion of the clamp. At an equilibrium r vanishes at the free components. So
dF/dm = (c + w)·∂r/∂m with K w = −K c at the free components: w is how the sheet follows the clamp.
A linear functional g of the positions, as the mean lateral stretch, has dG/dm = −(K⁻¹ g)·∂r/∂m.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import ufl
from dolfinx import fem

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.compiled_forms import assembled, compiled, work_vector
from toros_fem.base.errors import TorosWarning
from toros_fem.base.mpi import dot
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.meshes.skin import Skin
from toros_fem.products.tiles.pull_test import PullMachine

MATERIALS = ("fabric", "reinforcement")


def scaled(composite: Composite, factors: Sequence[float] | Floats) -> Composite:
    """Return a composite with the moduli of fabric and reinforcement times factors."""
    fabric, reinforcement = (
        replace(sheet, young=float(factor) * sheet.young)
        for sheet, factor in zip((composite.fabric, composite.reinforcement), factors, strict=True)
    )
    return replace(composite, fabric=fabric, reinforcement=reinforcement)


class PrintedSheet:
    """A printed sheet that is pulled with different moduli.

    Args:
        skin, composite, axis, gauge, options, quadratic: As of `PullMachine`.
        density: Whether each owned triangle is printed, as densities in [0, 1].
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        density: Floats,
        axis: int,
        gauge: float,
        options: NewtonOptions | None = None,
        quadratic: Bools | None = None,
    ) -> None:
        self.skin, self.density, self.axis = skin, density, axis
        self.composite = replace(composite, bending=None)
        self.gauge, self.options, self.quadratic = gauge, options, quadratic
        machine = self._machine(np.ones(2))
        self._base = machine.solver.model
        # The first variation is linear in the moduli: its parts are differences of these models.
        supports, moduli = self._base.supports, 1 + np.eye(2)
        self._other = [
            make_model(skin, scaled(self.composite, factors), supports, quadratic=quadratic)
            for factors in moduli
        ]
        for model in (self._base, *self._other):
            model.set_density(model.design.check(density))
        self._clamp = np.zeros(self._base.size_local)
        self._base.positions(self._clamp)[machine.far[skin.owned_vertices], axis] = 1.0
        self._mean = np.zeros(self._base.size_local)
        across, owned = 1 - axis, skin.owned_vertices
        self._base.positions(self._mean)[:, across] = machine.stretch_weights[owned, across]

    def _machine(self, factors: Floats) -> PullMachine:
        composite = scaled(self.composite, factors)
        with warnings.catch_warnings():  # a search may pass moduli that are odd
            warnings.simplefilter("ignore", TorosWarning)
            return PullMachine(
                self.skin, composite, self.axis, self.gauge, self.options, quadratic=self.quadratic
            )

    def curve(self, factors: Floats, strains: Floats) -> tuple[Floats, Floats]:
        """Pull the sheet and differentiate its stress and its lateral stretch (collective).

        Args:
            factors: Factors on the moduli of fabric and reinforcement, (2,).
            strains: Strains of the clamps' distance, in the order of the pull, (k,).

        Returns:
            Force on the moving clamp over the width in N/m, and mean lateral stretch of the middle,
            (2, k); and their derivatives by the logarithms of both moduli, (2, k, 2).

        Raises:
            NoEquilibriumError: There is no equilibrium at one of the strains.
        """
        machine, comm, result = self._machine(factors), self.skin.comm, None
        solver, pushed = machine.solver, _tangent_times(machine.solver.model, self._clamp)
        values, slopes = np.empty((2, len(strains))), np.empty((2, len(strains), 2))
        for k, strain in enumerate(strains):
            result = machine.solve(self.density, float(strain), result)
            state = result.state
            positions = self.skin.gather_vertices(result.positions)
            values[0, k] = machine.forces(result)[1, self.axis] / machine.width
            values[1, k] = machine.middle_stretch(positions)[1 - self.axis]
            follow = self._clamp - solver.solve_tangent(pushed(state), result)
            widening = solver.solve_tangent(self._mean, result)
            for j, part in enumerate(self._parts(state)):
                change = np.asarray(factors[j] * part, dtype=np.float64)
                slopes[0, k, j] = dot(comm, follow, change) / machine.width
                slopes[1, k, j] = -dot(comm, widening, change)
        return values, slopes

    def _parts(self, state: Floats) -> list[Floats]:
        """Return the first variations of fabric and of reinforcement, with the first moduli."""
        both = self._base.residual(state) + self._base.reaction(state)
        return [other.residual(state) + other.reaction(state) - both for other in self._other]


def _tangent_times(model: SkinModel, direction: Floats) -> Callable[[Floats], Floats]:
    """Return what gives K c at a state, at owned unknowns, fixed ones too (collective)."""
    along = fem.Function(model.space)
    along.x.array[: model.size_local] = direction
    along.x.scatter_forward()
    form = compiled(ufl.derivative(model.forms.residual, model.q, along))
    buffer = work_vector(model.space)

    def at(state: Floats) -> Floats:
        model.set_state(state)
        return assembled(form, buffer)

    return at
