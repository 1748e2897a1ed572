"""Equilibrium of a pressurised skin: cold by continuation in the pressure, or warm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem._mpi import largest, raise_together, smallest
from toros_fem.errors import DensityError, EquilibriumError, ParameterError
from toros_fem.meshes.skin import Skin
from toros_fem.model import SkinModel
from toros_fem.newton import Factor, NewtonStep, RegularisedNewton
from toros_fem.parameters import Composite, NewtonOptions
from toros_fem.supports import Supports

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EquilibriumResult:
    """What a solve found.

    Attributes:
        converged: Whether `state` is a stable equilibrium at the asked pressure.
        reason: Why the solve ended, as a sentence.
        pressure: Pressure of `state` in Pa.
        state: Owned position dofs in m, a flat array.
        energy: Energy of eq. (8) in J.
        volume: Enclosed volume in m³.
        stretch_use: Largest share of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        steps: Newton steps.
        factorisations: Factorisations of the tangent, retries with a shift included.
        history: One row a Newton step.
    """

    converged: bool
    reason: str
    pressure: float
    state: Floats
    energy: float
    volume: float
    stretch_use: float
    residual: float
    steps: int
    factorisations: int
    history: tuple[NewtonStep, ...]


class EquilibriumSolver:
    """Finds stable equilibria of a skin, and solves with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: What is held.
        options: How hard to try.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        options: NewtonOptions | None = None,
    ) -> None:
        self.skin = skin
        self.model = SkinModel(skin, composite, supports)
        self.options = options or NewtonOptions()
        self._factor = Factor(self.model)
        self._newton = RegularisedNewton(self.model, self._factor, self.options)
        self._snes = PETSc.SNES().create(skin.comm)
        self._snes.setOptionsPrefix("toros_")
        self._snes.setType(PETSc.SNES.Type.PYTHON)
        self._snes.setPythonContext(self._newton)
        self._snes.setFromOptions()
        self._x = self._factor.matrix.createVecRight()

    def solve(
        self,
        density: Floats,
        pressure: float,
        *,
        start: Floats | None = None,
        raise_on_failure: bool = True,
    ) -> EquilibriumResult:
        """The stable equilibrium at a density and a pressure (collective).

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            pressure: Pressure in Pa, ≥ 0.
            start: Owned position dofs to start from at the full pressure, a neighbouring
                equilibrium say. Without it the solve starts from the assembled positions and
                raises the pressure from 0 in steps that shrink where they fail.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.

        Raises:
            ParameterError: The pressure is negative or not finite, or the start does not fit.
            DensityError: The density does not fit, or leaves [0, 1].
            OpenSkinError: Pressure on a skin with free edges.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        self._check(density, pressure, start)
        self.model.set_density(density)
        newton = self._newton
        newton.history = []
        before = self._factor.count
        cold = start is None
        state = self.model.assembled if start is None else np.array(start, dtype=np.float64)
        if not self.model.bounds.worst(self.model.corners(state)) < 1:
            raise ParameterError(
                "the start leaves the stretch bounds: a triangle uses "
                f"{self.model.bounds.worst(self.model.corners(state)):.3g} of them, the bound is "
                "1. Start from the assembled positions, or raise c1 and c2."
            )
        reached, outcome = (0.0 if cold else -1.0), 0
        target, increment = pressure, pressure
        while True:
            trial = state.copy()
            outcome = self._newton_solve(trial, target)
            if outcome > 0:
                state, reached = trial, target
                if reached >= pressure:
                    break
                increment *= 2
            elif reached < 0:  # a warm start failed: once more, cold
                reached, state, increment = 0.0, self.model.assembled, pressure
            else:
                increment /= 4
                if increment < self.options.min_increment * max(pressure, 1e-300):
                    break
            target = min(pressure, reached + increment)
        converged = outcome > 0
        self.model.set_pressure(max(reached, 0.0))
        newton.pressure = max(reached, 0.0)
        result = EquilibriumResult(
            converged=converged,
            reason=self._sentence(converged, outcome, pressure, max(reached, 0.0), state),
            pressure=max(reached, 0.0),
            state=state,
            energy=self.model.energy(state),
            volume=self.model.volume(state),
            stretch_use=self.model.bounds.worst(self.model.corners(state)),
            residual=newton.history[-1].residual if newton.history else 0.0,
            steps=sum(1 for row in newton.history if row.step > 0),
            factorisations=self._factor.count - before,
            history=tuple(newton.history),
        )
        if not converged and raise_on_failure:
            raise EquilibriumError(result.reason, result)
        return result

    def solve_tangent(self, rhs: Floats) -> Floats:
        """Solve K y = rhs with the tangent at the last equilibrium, zero at held components."""
        return self._factor.solve(rhs * self.model.free)

    def _newton_solve(self, state: Floats, pressure: float) -> int:
        self.model.set_pressure(pressure)
        self._newton.pressure = pressure
        self._x.array[:] = state
        self._snes.solve(None, self._x)
        state[:] = self._x.array
        return int(self._snes.getConvergedReason())

    def _sentence(
        self, converged: bool, outcome: int, pressure: float, reached: float, state: Floats
    ) -> str:
        if converged:
            return f"A stable equilibrium was found at {pressure:g} Pa."
        use = self.model.bounds.worst(self.model.corners(state))
        why = {
            int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT): (
                f"Newton's method took {self.options.max_steps} steps without converging"
            ),
            int(PETSc.SNES.ConvergedReason.DIVERGED_FUNCTION_DOMAIN): (
                "the start leaves the stretch bounds"
            ),
        }.get(outcome, "no step lowered the energy any more")
        return (
            f"No equilibrium inside the stretch bounds was found at pressure = {pressure:g} Pa: "
            f"{why}. The last equilibrium is at {reached:g} Pa, where the most stretched triangle "
            f"uses {100 * use:.1f} % of the bounds c1 = {self.model.composite.c1:g}, "
            f"c2 = {self.model.composite.c2:g}. Lower the pressure to about {reached:.3g} Pa, "
            "stiffen the skin, or refine the mesh where it is most stretched."
        )

    def _check(self, density: Floats, pressure: float, start: Floats | None) -> None:
        comm = self.skin.comm
        if not (math.isfinite(pressure) and pressure >= 0):
            raise ParameterError(f"pressure = {pressure} Pa must be finite and at least 0.")
        if pressure > 0:
            self.skin.pattern.require_closed()
        error: Exception | None = None
        owned = len(self.skin.owned_cells)
        if density.shape != (owned,):
            error = DensityError(
                f"density has shape {density.shape}; this rank owns {owned} triangles."
            )
        elif start is not None and start.shape != (self.model.size_local,):
            error = ParameterError(
                f"start has shape {start.shape}; this rank owns {self.model.size_local} dofs."
            )
        raise_together(comm, error)
        low = smallest(comm, np.min(np.where(np.isfinite(density), density, -np.inf), initial=0))
        high = largest(comm, np.max(density, initial=0.0, where=np.isfinite(density)))
        if low < 0 or high > 1:
            wrong = low if low < 0 else high
            raise DensityError(
                f"density holds {wrong if math.isfinite(wrong) else 'NaN or infinity'}; it must "
                "lie in [0, 1]. Clip it, or look for the error before."
            )
