"""Newton's method on the skin's energy, regularised by what the factorisation tells."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from toros_fem._mpi import dot, largest, norm
from toros_fem._types import Floats
from toros_fem.equilibrium.linear_solver import TangentFactor
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.mechanics.model import SkinModel

ARMIJO = 1e-4
SMALLEST_STEP = 1e-10
FIRST_SHIFT = 0.03
SMALLEST_SHIFT = 2e-3
FIRST_DIAGONAL = 1e-8
LARGEST_SHIFT = 1e6
# A step that leaves more of the residual than this is bent back to where the stiff parts relax.
RELAXED = 0.1
BENDS = 2
# Steps with the factorisation at hand are taken where so many of them promise to finish.
MODIFIED_STEPS = 3
# What a chord step must leave of the residual, and the first one gain of its promised energy.
MODIFIED_RATE = 0.2
MODIFIED_GAIN = 0.2
# How many saddles a solve leaves before it gives up.
ESCAPES = 10
# Where rounding lets no step lower the energy any more, this residual over the load will do.
STAGNATED = 1e-8
# Or this one, where Newton's full step leaves so much of the residual and moves nothing further
# than that share of the skin's size.
UNRESOLVED = 1e-5
STUCK = 0.5
RESOLVED = 1e-9


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Pressure level in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its material part; 0 for pure Newton.
        step: Share of the step that was taken; 0 in the row that ends a level.
        chord: Whether the factorisation at hand served once more.
        seconds: Wall time of the step on this rank.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float
    modified: bool
    seconds: float

    def __str__(self) -> str:
        kind = "chord" if self.modified else "newton" if self.step else "end"
        return (
            f"{self.pressure:10.4g} Pa  {kind:6s}  residual {self.residual:8.2e}  "
            f"energy {self.energy:+.9e} J  shift {self.shift:7.1e}  step {self.step:7.1e}  "
            f"{self.seconds:6.3f} s"
        )


@dataclass(frozen=True, eq=False)
class _Point:
    """A state, its energy, and its residual with its norm."""

    state: Floats
    energy: float
    residual: Floats
    size: float


class RegularisedNewton:
    """The solver inside a PETSc SNES of type "python": minimises E at given pressure and density.

    Each step solves (K + τM) p = −r with the smallest τ ≥ 0 of a geometric ladder for which the
    factorisation has no negative pivot, remembered from step to step. M is K's material part: it
    holds back strains, not the large rotations by which slender skins snap. p is capped where a
    triangle would use up too much of its way to the stretch bounds, and backtracked on the energy.
    A long step stretches what it turns; a second solve with the same factors takes that out again
    (the second-order correction of constrained optimisation). Near the end, and for a neighbouring
    equilibrium's factors at the start, steps are taken with the factorisation at hand.

    Where energies differ by less than their rounding the slope decides (Hager & Zhang 2005,
    eq. 2.4, approximate Wolfe). A stationary point that is no minimum is left along its softest
    mode. A state counts as equilibrium when its residual is below the SNES's rtol times the
    applied load, or below what the rounding of the positions gives, and K is positive definite;
    where rounding lets it fall no more, also below STAGNATED, or UNRESOLVED if Newton's own step is
    as good as none.
    """

    def __init__(
        self,
        model: SkinModel,
        factor: TangentFactor,
        options: NewtonOptions,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self.model, self.factor, self.options = model, factor, options
        self.comm = model.skin.comm
        self.history: list[NewtonStep] = []
        self.pressure = 0.0
        # Whether the factors are those of an equilibrium near the start of the next solve.
        self.reuse_factors = False
        self._log = log
        self._shift = 0.0
        self._refused = False
        self._stiffness = 0.0
        self._clock = 0.0

    def solve(self, snes: PETSc.SNES, b: PETSc.Vec | None, x: PETSc.Vec) -> None:
        """Called by SNES."""
        point, reason = self._minimise(snes, x.array.copy())
        x.array[:] = point.state
        snes.setConvergedReason(reason)

    def _minimise(self, snes: PETSc.SNES, state: Floats) -> tuple[_Point, int]:
        reasons = PETSc.SNES.ConvergedReason
        tolerance, _, _, max_steps = snes.getTolerances()
        model = self.model
        self._clock = time.perf_counter()
        # Nothing of a solve before, which may have failed far away, may count here.
        self._shift, self._stiffness, self._refused = 0.0, 0.0, False
        predict, self.reuse_factors = self.reuse_factors, False
        point = self._at(state, model.energy(state))
        if not np.isfinite(point.energy):
            return point, int(reasons.DIVERGED_FUNCTION_DOMAIN)
        rounding = model.energy_rounding() + 1e-14 * model.work(state)
        reference = self.reference(state)
        steps = escapes = 0
        rate = np.inf  # what the next chord step would leave of the residual
        while True:
            if point.size <= 10 * max(tolerance, STAGNATED) * reference:
                reference = self.reference(point.state)
            snes.setIterationNumber(steps)
            snes.setFunctionNorm(point.size)
            snes.monitor(steps, point.size)
            residual = point.size / reference
            done = residual <= tolerance or point.size <= self._floor(reference)
            if done and self.stable(point.state):
                self._record(point, residual, 0.0)
                self.reuse_factors = True
                return point, int(reasons.CONVERGED_FNORM_RELATIVE)
            if predict or residual * rate**MODIFIED_STEPS <= tolerance:
                modified = self._modified_step(point, rounding, first=predict)
                predict, rate = False, np.inf
                if modified is not None:
                    rate = modified.size / point.size
                    self._record(point, residual, 1.0, modified=True)
                    point = modified
                    continue
            if steps == max_steps:
                return point, int(reasons.DIVERGED_MAX_IT)
            if escapes == ESCAPES:
                return point, int(reasons.DIVERGED_INNER)
            steps += 1
            if done:
                escapes += 1
                direction = self._softest(point.residual, escapes)
            else:
                self._factorise(point.state)
                direction = -self.factor.solve(point.residual)
            share, new = self._search(point, direction, rounding, escaping=done)
            full = share == 1.0 and self._shift == 0.0
            stuck = not done and self._stuck(point, new, direction, full=full)
            if stuck and residual <= UNRESOLVED:
                self._record(point, residual, 0.0)
                self.reuse_factors = True  # K is factorised here, without a shift
                return point, int(reasons.CONVERGED_SNORM_RELATIVE)
            self._record(point, residual, share)
            if new is None:
                if residual <= STAGNATED and self.stable(point.state):
                    self.reuse_factors = True
                    return point, int(reasons.CONVERGED_SNORM_RELATIVE)
                if self._shift >= LARGEST_SHIFT / 8:
                    return point, int(reasons.DIVERGED_LINE_SEARCH)
                self._shift, self._refused = max(FIRST_SHIFT, 16 * self._shift), True
                continue
            if not done:
                new = self._bend(point, new, share)
            # Newton's residual falls quadratically; a chord step's by twice that share.
            rate = 2 * new.size / point.size if full else np.inf
            point = new

    def reference(self, state: Floats) -> float:
        """Norm of the applied load in N; without any, or where they move, of the supports' pull.

        A skin that nothing pulls at is measured by the force of a strain of 1e-4.
        """
        load = norm(self.comm, self.model.applied_load(state))
        if load > 0 and self.model.displaced:
            return max(load, norm(self.comm, self.model.reaction(state)))
        if load > 0:
            return load
        pattern = self.model.skin.pattern
        least = 1e-4 * self.model.mean_modulus() * float(np.sqrt(pattern.areas.sum()))
        return max(least, norm(self.comm, self.model.reaction(state)))

    def stable(self, state: Floats) -> bool:
        """Whether the tangent at a state is positive definite; leaves it factorised."""
        self._assemble(state)
        return self.factor.factorise(0.0)

    def _at(self, state: Floats, energy: float) -> _Point:
        residual = self.model.residual(state)
        return _Point(state, energy, residual, norm(self.comm, residual))

    def _record(
        self, point: _Point, residual: float, step: float, *, modified: bool = False
    ) -> None:
        now = time.perf_counter()
        shift = 0.0 if modified or not step else self._shift
        row = NewtonStep(
            self.pressure, residual, point.energy, shift, step, modified, now - self._clock
        )
        self._clock = now
        self.history.append(row)
        if self._log is not None:
            self._log(row)

    def _floor(self, reference: float) -> float:
        """Norm that rounding of the positions alone gives the residual, once K is known.

        Close to the stretch bounds it would exceed any load: there it is no excuse.
        """
        return min(self._rounding(), STAGNATED * reference)

    def _rounding(self) -> float:
        """Norm in N by which rounded positions may change the residual."""
        return 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size * self._stiffness

    def _stuck(self, old: _Point, new: _Point | None, direction: Floats, *, full: bool) -> bool:
        """Whether rounding lets the residual fall no more: Newton's step is as good as none.

        Where stretching is far stiffer than bending its rounding alone may exceed the load.
        """
        if new is None:
            if self._shift > 0:
                return False
        elif not full or new.size <= STUCK * old.size:
            return False
        if old.size > self._rounding():
            return False
        moved = largest(self.comm, float(np.abs(direction).max(initial=0.0)))
        return moved <= RESOLVED * self.model.skin.pattern.size

    def _assemble(self, state: Floats) -> None:
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def _factorise(self, state: Floats) -> None:
        """Factorise with the smallest shift of the ladder that leaves no negative pivot."""
        self._assemble(state)
        # A try with less is worth a factorisation only if the last one was not in vain.
        shift = self._shift if self._refused else self._shift / 8
        shift = shift if shift >= SMALLEST_SHIFT else 0.0
        refused = False
        while not self.factor.factorise(shift) and shift < LARGEST_SHIFT:
            shift = max(FIRST_SHIFT, 4 * shift) if shift else max(FIRST_SHIFT, self._shift)
            refused = True
        self._refused = refused and not self._refused
        self._shift = shift

    def _softest(self, residual: Floats, seed: int) -> Floats:
        """The mode of smallest curvature, by inverse iteration, scaled to 1 % of the skin.

        Smallest over the diagonal: the material part would hide what buckles.
        """
        self._shift, diagonal = 0.0, FIRST_DIAGONAL
        while not self.factor.factorise(diagonal=diagonal) and diagonal < LARGEST_SHIFT:
            diagonal *= 4
        # A start that is the same on any number of ranks: drawn by assembled vertex.
        points = self.model.skin.pattern.points
        drawn = np.random.default_rng(seed).standard_normal(points.shape)
        mode: Floats = np.zeros(self.model.size_local)
        self.model.positions(mode)[:] = drawn[self.model.skin.owned_vertices]
        mode *= self.model.free
        for _ in range(20):
            mode = self.factor.solve(self.factor.scale * mode)
            mode /= norm(self.comm, mode)
        mode *= -1.0 if dot(self.comm, mode, residual) > 0 else 1.0
        return 0.01 * self.model.skin.pattern.size * mode

    def _cap(self, state: Floats, direction: Floats) -> float:
        """How much of a step the stretch bounds allow."""
        corners = self.model.corners(state)
        fraction = self.options.fraction_to_barrier
        return self.model.bounds.largest_step(corners, self.model.corners(direction), fraction)

    def _modified_step(self, point: _Point, rounding: float, *, first: bool) -> _Point | None:
        """The point after a step with the factors at hand, if that is worth having."""
        direction = -self.factor.solve(point.residual)
        if not np.isfinite(norm(self.comm, direction)):
            return None
        share = self._cap(point.state, direction)
        if share < 1 and not first:
            return None
        trial = point.state + share * direction
        energy = self.model.energy(trial)
        slope = share * dot(self.comm, point.residual, direction)
        if not energy - point.energy <= (MODIFIED_GAIN / 2 * slope if first else rounding):
            return None
        new = self._at(trial, energy)
        return new if first or new.size <= MODIFIED_RATE * point.size else None

    def _bend(self, old: _Point, new: _Point, share: float) -> _Point:
        """Correct a step by what its residual exceeds the linear prediction, while that pays."""
        for _ in range(BENDS):
            if new.size <= RELAXED * old.size:
                break
            state = new.state - self.factor.solve(new.residual - (1 - share) * old.residual)
            energy = self.model.energy(state)
            if not energy < new.energy:
                break
            new = self._at(state, energy)
        return new

    def _search(
        self, point: _Point, direction: Floats, rounding: float, *, escaping: bool
    ) -> tuple[float, _Point | None]:
        """Share of the step to take and the point there; 0 and None if no step will do."""
        if not np.isfinite(norm(self.comm, direction)):
            return 0.0, None
        slope = dot(self.comm, point.residual, direction)
        share = self._cap(point.state, direction)
        while share > SMALLEST_STEP:
            trial = point.state + share * direction
            energy = self.model.energy(trial)
            change = energy - point.energy
            if change <= ARMIJO * share * slope and (change < -rounding or not escaping):
                return share, self._at(trial, energy)
            if abs(change) <= rounding and not escaping:
                new = self._at(trial, energy)
                if abs(dot(self.comm, new.residual, direction)) <= 0.9 * abs(slope):
                    return share, new
            if np.isfinite(energy) and change > share * slope:
                quadratic = -slope * share**2 / (2 * (change - share * slope))
                share = min(max(quadratic, 0.1 * share), 0.5 * share)
            else:
                share *= 0.5
        return 0.0, None
