"""Newton's method on the skin's energy, regularised by what the factorisation tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem._mpi import dot, norm
from toros_fem.factor import Factor
from toros_fem.model import SkinModel
from toros_fem.parameters import NewtonOptions

Floats = npt.NDArray[np.float64]

ARMIJO = 1e-4
SMALLEST_STEP = 1e-10
FIRST_SHIFT = 1e-3
SMALLEST_SHIFT = 1e-6
LARGEST_SHIFT = 1e6
# Where rounding lets no step lower the energy any more, this residual over the load will do.
STAGNATED = 1e-8


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Pressure level in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its diagonal scale; 0 for pure Newton.
        step: Share of the step that was taken.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float


class RegularisedNewton:
    """The solver inside a PETSc SNES of type "python": minimises E at given pressure and density.

    Each step solves (K + τD) p = −r with the smallest τ ≥ 0 of a geometric ladder for which the
    factorisation has no negative pivot, remembered from step to step; caps p where a triangle
    would use up too much of its way to the stretch bounds; and backtracks on the energy. Near
    the end energies differ by less than their rounding; there the slope decides (Hager & Zhang
    2005, eq. 2.4, approximate Wolfe). A stationary point that is no minimum is left along its
    softest mode. A state counts as equilibrium when its residual is below the SNES's rtol times
    the applied load, or below what the rounding of the positions gives.
    """

    def __init__(self, model: SkinModel, factor: Factor, options: NewtonOptions) -> None:
        self.model, self.factor, self.options = model, factor, options
        self.comm = model.skin.comm
        self.history: list[NewtonStep] = []
        self.pressure = 0.0
        self._shift = 0.0
        self._stiffness = 0.0

    def solve(self, snes: PETSc.SNES, b: PETSc.Vec | None, x: PETSc.Vec) -> None:
        """Called by SNES."""
        state = x.array.copy()
        reason = self._minimise(snes, state)
        x.array[:] = state
        snes.setConvergedReason(reason)

    def _minimise(self, snes: PETSc.SNES, state: Floats) -> int:
        reasons = PETSc.SNES.ConvergedReason
        tolerance, _, _, max_steps = snes.getTolerances()
        model, comm = self.model, self.comm
        # Nothing of a solve before, which may have failed far away, may count here.
        self._shift, self._stiffness = 0.0, 0.0
        energy = model.energy(state)
        if not np.isfinite(energy):
            return int(reasons.DIVERGED_FUNCTION_DOMAIN)
        residual = model.residual(state)
        rounding = model.energy_rounding() + 1e-14 * abs(self.pressure * model.volume(state))
        escapes = 0
        for step in range(max_steps + 1):
            size = norm(comm, residual)
            reference = self.reference(state)
            snes.setIterationNumber(step)
            snes.setFunctionNorm(size)
            snes.monitor(step, size)
            done = size <= tolerance * reference or size <= self._floor(reference)
            if done and self.stable(state):
                self.history.append(NewtonStep(self.pressure, size / reference, energy, 0.0, 0.0))
                return int(reasons.CONVERGED_FNORM_RELATIVE)
            if step == max_steps:
                break
            if done:
                escapes += 1
                direction = self._softest(residual, escapes)
            else:
                self._factorise(state)
                direction = -self.factor.solve(residual)
            share, new_energy, new_residual = self._search(
                state, direction, energy, residual, rounding, escaping=done
            )
            self.history.append(
                NewtonStep(self.pressure, size / reference, energy, self._shift, share)
            )
            if share == 0.0:
                if size <= STAGNATED * reference and self.stable(state):
                    return int(reasons.CONVERGED_SNORM_RELATIVE)
                if self._shift >= LARGEST_SHIFT / 8:
                    return int(reasons.DIVERGED_LINE_SEARCH)
                self._shift = max(FIRST_SHIFT, 16 * self._shift)
                continue
            state += share * direction
            energy = new_energy
            residual = model.residual(state) if new_residual is None else new_residual
        return int(reasons.DIVERGED_MAX_IT)

    def reference(self, state: Floats) -> float:
        """Norm of the applied load in N; without load, the force of a strain of 1e-4."""
        if self.pressure > 0:
            return self.pressure * norm(self.comm, self.model.load(state))
        fabric = self.model.composite.fabric
        area = float(self.model.skin.pattern.areas.sum())
        return 1e-4 * fabric.membrane_stiffness * float(np.sqrt(area))

    def _floor(self, reference: float) -> float:
        """Norm that rounding of the positions alone gives the residual, once K is known.

        Close to the stretch bounds it would exceed any load: there it is no excuse.
        """
        rounding = 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size
        return min(rounding * self._stiffness, STAGNATED * reference)

    def _assemble(self, state: Floats) -> None:
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def stable(self, state: Floats) -> bool:
        """Whether the tangent at a state is positive definite; leaves it factorised."""
        self._assemble(state)
        return self.factor.factorise(0.0)

    def _factorise(self, state: Floats) -> None:
        """Factorise with the smallest shift of the ladder that leaves no negative pivot."""
        self._assemble(state)
        shift = self._shift / 8 if self._shift / 8 >= SMALLEST_SHIFT else 0.0
        while not self.factor.factorise(shift) and shift < LARGEST_SHIFT:
            shift = max(FIRST_SHIFT, 4 * shift) if shift else max(FIRST_SHIFT, self._shift)
        self._shift = shift

    def _softest(self, residual: Floats, seed: int) -> Floats:
        """The mode of smallest curvature, by inverse iteration, scaled to 1 % of the skin."""
        self._shift = FIRST_SHIFT
        while not self.factor.factorise(self._shift) and self._shift < LARGEST_SHIFT:
            self._shift *= 4
        # A start that is the same on any number of ranks: drawn by assembled vertex.
        points = self.model.skin.pattern.points
        drawn = np.random.default_rng(seed).standard_normal(points.shape)
        mode = drawn[self.model.skin.owned_vertices].ravel() * self.model.free
        for _ in range(8):
            mode = self.factor.solve(self.factor.scale * mode)
            mode /= norm(self.comm, mode)
        mode *= -1.0 if dot(self.comm, mode, residual) > 0 else 1.0
        return 0.01 * self.model.skin.pattern.size * mode

    def _search(
        self,
        state: Floats,
        direction: Floats,
        energy: float,
        residual: Floats,
        rounding: float,
        *,
        escaping: bool,
    ) -> tuple[float, float, Floats | None]:
        """Share of the step to take, the energy there, and the residual if it was needed."""
        model = self.model
        if not np.isfinite(norm(self.comm, direction)):
            return 0.0, energy, None
        slope = dot(self.comm, residual, direction)
        corners = model.corners(state)
        share = model.bounds.largest_step(
            corners, model.corners(direction), self.options.fraction_to_barrier
        )
        while share > SMALLEST_STEP:
            trial = state + share * direction
            value = model.energy(trial)
            change = value - energy
            if change <= ARMIJO * share * slope and (change < -rounding or not escaping):
                return share, value, None
            if abs(change) <= rounding and not escaping:
                there = model.residual(trial)
                if abs(dot(self.comm, there, direction)) <= 0.9 * abs(slope):
                    return share, value, there
            if np.isfinite(value) and change > share * slope:
                quadratic = -slope * share**2 / (2 * (change - share * slope))
                share = min(max(quadratic, 0.1 * share), 0.5 * share)
            else:
                share *= 0.5
        return 0.0, energy, None
