"""Newton's method on the skin's energy, regularised where the tangent is not positive definite."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import Attempt
from toros_fem.mechanics.equilibrium.krylov import conjugate_gradients, gmres
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds

ARMIJO = 1e-4
SMALLEST_STEP = 1e-10
FIRST_SHIFT = 0.03
# Factor by which the shift falls after a success.
DECAY = 32.0
SMALLEST_SHIFT = 2e-3
FIRST_DIAGONAL = 1e-8
LARGEST_SHIFT = 1e6
# A step that leaves more of the residual than this fraction is corrected, so that the stiff parts
# relax.
RELAXED = 0.1
CORRECTIONS = 2
# Modified Newton steps are taken where at most this number of them promises to finish.
MODIFIED_STEPS = 3
# Fraction of the residual that a modified step may leave, and fraction of the predicted decrease
# of the energy that the first one must reach.
MODIFIED_RATE = 0.2
MODIFIED_GAIN = 0.2
# Conjugate gradients with older factors are taken where they leave at most this fraction of the
# residual after CG_COST √n iterations: a factorisation of n unknowns costs some 0.05 √n solves.
INEXACT = 1e-2
CG_COST = 0.03
# With friction, a step that leaves more of the residual than the fraction OVERSHOT may be halved.
OVERSHOT = 0.7
# With friction, steps with the whole derivative begin at the residual COUPLED over the load. GMRES
# leaves the fraction COUPLED_LEFT, and the step at most COUPLED_RATE of the residual.
COUPLED, COUPLED_LEFT, COUPLED_RATE, COUPLED_ITERATIONS = 1e-2, 1e-3, 0.3, 60
# A start outside the bounds of its density comes inside in rounds, each solved for up to this
# residual over the load.
APPROACHED, ROUNDS = 0.1, 60
# Number of saddles that a solve leaves before it gives up.
ESCAPES = 10
# If rounding keeps every step from lowering the energy, this residual over the load is enough.
STAGNATED = 1e-8
# Or this one, where Newton's full step leaves the fraction STUCK of the residual and moves nothing
# further than the fraction RESOLVED of the skin's size.
UNRESOLVED = 1e-5
STUCK = 0.5
RESOLVED = 1e-9


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Largest pressure of the level, in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its material part; 0 for pure Newton.
        step: Fraction of the step that was taken; 0 in the row that ends a level.
        modified: Whether it is a modified Newton step: an older factorisation alone.
        inexact: Whether conjugate gradients found it with an older factorisation.
        iterations: Number of conjugate gradient iterations, also of those that were not enough.
        seconds: Wall time of the step on this rank.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float
    modified: bool
    inexact: bool
    iterations: int
    seconds: float

    def __str__(self) -> str:
        kind = "newton" if self.step else "end"
        if self.modified or self.inexact:
            kind = "modified" if self.modified else f"cg {self.iterations}"
        return (
            f"{self.pressure:10.4g} Pa  {kind:8s}  residual {self.residual:8.2e}  "
            f"energy {self.energy:+.9e} J  shift {self.shift:7.1e}  step {self.step:7.1e}  "
            f"{self.seconds:6.3f} s"
        )


@dataclass(frozen=True, eq=False)
class NewtonResult(Attempt):
    """Result of one solve.

    Attributes:
        history: One row for each step, and the row that ends the solve.
        definite: Whether no shift was needed and no saddle was met on the way.
    """

    history: tuple[NewtonStep, ...]
    definite: bool


@dataclass(frozen=True, eq=False)
class _Point:
    """A state, its energy, and its residual with its norm."""

    state: Floats
    energy: float
    residual: Floats
    size: float


class RegularisedNewton:
    """Regularised Newton's method on E from a start, at the load and density set in the model.

    Each step solves (K + τM) p = −r with the smallest τ ≥ 0 of a geometric ladder for which the
    factorisation has no negative pivot, remembered from step to step. M is K's material part: it
    resists strains, not the large rotations by which slender skins snap. p is capped where a
    triangle would use up too much of its distance to the stretch bounds, and backtracked on the
    energy. A long step stretches the triangles that it turns; a second solve with the same factors
    corrects that (the second-order correction of constrained optimisation). Near the end, and at
    the start with the factors of a neighbouring equilibrium, modified Newton steps reuse the
    factorisation. Elsewhere these factors precondition conjugate gradients; K is factorised only
    where few iterations are not enough.

    Where energies differ by less than their rounding the slope decides (Hager & Zhang 2005,
    eq. 2.4, approximate Wolfe). A stationary point that is no minimum is left along its softest
    mode. A state counts as equilibrium when K is positive definite and the residual is below the
    tolerance times the applied load, or below the rounding of the positions. Where rounding
    keeps the residual from falling further, STAGNATED is enough, or UNRESOLVED where Newton's step
    is negligible.

    Attributes:
        first_shift: Shift with which the first factorisation of a solve near the last one begins.
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
        self._log = log
        self._has_factors, self.first_shift = False, 0.0
        self._max_iterations = round(CG_COST * model.space.dofmap.index_map.size_global**0.5)
        self._reset()

    def _reset(self, *, near: bool = False) -> None:
        """Reset all data of the previous solve, which may have failed far away."""
        first = self.first_shift if near else 0.0
        self._history: list[NewtonStep] = []
        # Neighbouring designs need like shifts in their first steps.
        self._shift, self._stiffness, self._refused = first, 0.0, first > 0
        self._first = self._definite = True
        self._cg_iterations = 0
        self._clock = time.perf_counter()

    def minimise(
        self,
        start: Floats,
        tolerance: float,
        max_steps: int,
        near: bool,
        finish: bool = True,
        monitor: Callable[[int, float], None] = lambda step, size: None,
    ) -> NewtonResult:
        """Find a stable equilibrium near a start (collective).

        Args:
            start: Owned unknowns.
            tolerance: Residual over the applied load at which a state is an equilibrium.
            max_steps: Largest number of steps that are not modified ones.
            near: Whether the start is the equilibrium of a neighbouring design or load.
            finish: Whether to factorise the tangent at the end, to prove that the state is stable.
            monitor: Called before each step with its number and the norm of the residual.

        Returns:
            If it converged and is finished, the tangent at its state is factorised.
        """
        self._reset(near=near)
        begin = self._into_bounds(start, max_steps, near)
        point, outcome = self._iterate(
            begin,
            tolerance,
            max_steps,
            near and begin is start,
            monitor,
            finish=finish,
        )
        history = tuple(self._history)
        return NewtonResult(point.state, outcome, len(history), history, self._definite)

    def _into_bounds(self, start: Floats, max_steps: int, near: bool) -> Floats:
        """Return the start, or a state near it inside the bounds of the density (collective).

        Another density may have had wider bounds. The bounds of the triangles outside are widened,
        then narrowed in rounds: the tangent predicts the motion by it, and Newton's steps correct
        that, as in an interior point method. From afar (not `near`) all bounds begin wide: narrow
        ones would cap every step of the whole skin.
        """
        model, bounds, state = self.model, self.model.bounds, start
        if not isinstance(bounds, MixedBounds):
            return start
        if not bounds.loosen(model.corners(start), everywhere=not near):
            return start
        for _ in range(ROUNDS):
            if not bounds.loosened:
                break
            left = max_steps - sum(row.step > 0 and not row.modified for row in self._history)
            point, outcome = self._iterate(
                state, APPROACHED, left, near and state is start, finish=False
            )
            state = point.state
            if outcome <= 0:
                break
            state = self._narrowed(state, bounds)
        bounds.update()
        return state

    def _narrowed(self, state: Floats, bounds: MixedBounds) -> Floats:
        """Narrow loosened bounds, and return the state that goes with them."""
        model = self.model
        if not self.stable(state):
            bounds.narrow(model.corners(state), None)
            return state
        model.set_state(state)
        motion = -self.factor.solve(bounds.push() * model.free)
        fraction = bounds.narrow(model.corners(state), model.corners(motion))
        return np.asarray(state + fraction * motion)

    def _iterate(
        self,
        start: Floats,
        tolerance: float,
        max_steps: int,
        near: bool,
        monitor: Callable[[int, float], None] = lambda step, size: None,
        *,
        finish: bool,
    ) -> tuple[_Point, int]:
        outcomes = PETSc.SNES.ConvergedReason
        model = self.model
        self._lag(start)
        point = self._at(start, model.energy(start))
        crossed = model.contact is not None and model.contact.crossed(start)
        if not np.isfinite(point.energy) or crossed:
            return point, int(outcomes.DIVERGED_FUNCTION_DOMAIN)
        rounding = model.energy_rounding() + 1e-14 * model.load_energy(start)
        reference = self.reference(start)
        steps = escapes = 0
        rate = np.inf  # fraction of the residual that the next modified step would leave
        predict = near and self._has_factors
        while True:
            if point.size <= 10 * max(tolerance, STAGNATED) * reference:
                reference = self.reference(point.state)
            monitor(steps, point.size)
            residual = point.size / reference
            done = residual <= tolerance or point.size <= self._floor(reference)
            if done and (not finish or self.stable(point.state)):
                self._record(point, residual, 0.0)
                return point, int(outcomes.CONVERGED_FNORM_RELATIVE)
            # At a saddle there are no factors: its tangent is not positive definite.
            if not done and (predict or residual * rate**MODIFIED_STEPS <= tolerance):
                modified = self._modified_step(point, rounding, first=predict)
                predict, rate = False, np.inf
                if modified is not None:
                    modified = self._lagged(modified)
                    rate = modified.size / point.size
                    self._record(point, residual, 1.0, modified=True)
                    point = modified
                    continue
            if not done and model.slides and residual <= COUPLED and self._has_factors:
                coupled = self._coupled_step(point)
                if coupled is not None:
                    self._record(point, residual, 1.0, modified=True)
                    point = coupled
                    continue
            if steps == max_steps:
                return point, int(outcomes.DIVERGED_MAX_IT)
            if model.contact is not None and model.contact.falls(point.state):
                return point, int(outcomes.DIVERGED_DTOL)
            if escapes == ESCAPES:
                return point, int(outcomes.DIVERGED_INNER)
            steps += 1
            inexact = False
            if done:
                escapes += 1
                direction = self._softest(point.residual, escapes)
            else:
                direction, inexact = self._direction(point)
            fraction, new = self._search(point, direction, rounding, escaping=done)
            full = fraction == 1.0 and self._shift == 0.0 and not inexact
            exact = not (done or inexact)
            stuck = exact and self._stuck(point, new, direction, fraction)
            if stuck and residual <= UNRESOLVED:
                self._record(point, residual, 0.0)
                return point, int(outcomes.CONVERGED_SNORM_RELATIVE)  # K is factorised, unshifted
            self._record(point, residual, fraction, inexact=inexact)
            if new is None and inexact:  # rounding, or a barrier that needs the exact direction
                self._has_factors = False
                continue
            if new is None:
                if residual <= STAGNATED and self.stable(point.state):
                    return point, int(outcomes.CONVERGED_SNORM_RELATIVE)
                if self._shift >= LARGEST_SHIFT / 8:
                    return point, int(outcomes.DIVERGED_LINE_SEARCH)
                self._shift, self._refused = max(FIRST_SHIFT, 16 * self._shift), True
                continue
            if inexact and residual <= UNRESOLVED and new.size > STUCK * point.size:
                self._has_factors = False  # only the exact direction tells rounding
            if not done:
                new = self._correct(point, new, fraction)
            new = self._lagged(new, point if fraction == 1 else None)
            # Newton's residual falls quadratically; that of a modified step by twice this factor.
            rate = 2 * new.size / point.size if full else np.inf
            point = new

    def _direction(self, point: _Point) -> tuple[Floats, bool]:
        """Return Newton's direction, and whether it is inexact: found with older factors."""
        self._assemble(point.state)
        if self._has_factors and self._max_iterations >= 2:
            found = conjugate_gradients(
                self.comm,
                self.factor.multiply,
                self.factor.solve,
                -point.residual,
                INEXACT,
                self._max_iterations,
            )
            self._cg_iterations = found.iterations
            if found.positive and found.residual <= INEXACT:
                return found.solution, True
        self._factorise()
        return -self.factor.solve(point.residual), False

    def reference(self, state: Floats) -> float:
        """Return the norm of the applied load in N, by which residuals are measured (collective).

        Where supports move, or without any load, it is that of their reaction. Without any
        reaction it is the force of a strain of 1e-4.
        """
        load = norm(self.comm, self.model.applied_load(state))
        if load > 0 and self.model.load.displacement is not None:
            return max(load, norm(self.comm, self.model.reaction(state)))
        if load > 0:
            return load
        pattern = self.model.skin.pattern
        least = 1e-4 * self.model.mean_modulus() * float(np.sqrt(pattern.areas.sum()))
        return max(least, norm(self.comm, self.model.reaction(state)))

    def direction(self, state: Floats, residual: Floats) -> Floats:
        """Return Newton's direction against a residual in N, with the tangent at a state."""
        self._assemble(state)
        self._factorise()
        return -self.factor.solve(residual)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        self._assemble(state)
        self._has_factors = self.factor.factorise(0.0)
        return self._has_factors

    def _at(self, state: Floats, energy: float) -> _Point:
        residual = self.model.residual(state)
        return _Point(state, energy, residual, norm(self.comm, residual))

    def _record(
        self,
        point: _Point,
        residual: float,
        step: float,
        *,
        modified: bool = False,
        inexact: bool = False,
    ) -> None:
        now = time.perf_counter()
        shift = 0.0 if modified or inexact or not step else self._shift
        row = NewtonStep(
            self.model.load.largest,
            residual,
            point.energy,
            shift,
            step,
            modified,
            inexact,
            self._cg_iterations,
            now - self._clock,
        )
        self._cg_iterations = 0
        self._clock = now
        self._history.append(row)
        if self._log is not None:
            self._log(row)

    def _floor(self, reference: float) -> float:
        """Return the residual's norm by rounding of the positions alone, once K is known.

        Close to the stretch bounds it would exceed any load, so that it is limited.
        """
        return min(self._rounding(), STAGNATED * reference)

    def _rounding(self) -> float:
        """Return the norm in N by which rounded positions may change the residual."""
        return 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size * self._stiffness

    def _stuck(self, old: _Point, new: _Point | None, direction: Floats, fraction: float) -> bool:
        """Return whether rounding limits the residual: Newton's step is negligible.

        Where stretching is far stiffer than bending, its rounding alone may exceed the load.
        """
        if self._shift > 0:
            return False
        if new is not None and fraction == 1.0 and new.size <= STUCK * old.size:
            return False
        if old.size > self._rounding():
            return False
        moved = largest(self.comm, float(np.abs(direction).max(initial=0.0)))
        return moved <= RESOLVED * self.model.skin.pattern.size

    def _assemble(self, state: Floats) -> None:
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def _factorise(self) -> None:
        """Factorise with the smallest shift of the ladder that leaves no negative pivot."""
        # A smaller shift is worth a factorisation only if the last try of one succeeded.
        shift = self._shift if self._refused else self._shift / DECAY
        shift = shift if shift >= SMALLEST_SHIFT else 0.0
        refused = False
        self._has_factors = self.factor.factorise(shift)
        while not self._has_factors and shift < LARGEST_SHIFT:
            shift = max(FIRST_SHIFT, 4 * shift) if shift else max(FIRST_SHIFT, self._shift)
            refused = True
            self._has_factors = self.factor.factorise(shift)
        if self._first:
            lower = shift / 4 if shift >= 4 * SMALLEST_SHIFT else 0.0
            self._first, self.first_shift = False, shift if refused else lower
        self._refused = refused and not self._refused
        self._definite &= shift == 0
        self._shift = shift

    def _softest(self, residual: Floats, seed: int) -> Floats:
        """Return the mode of smallest curvature, by inverse iteration, scaled to 1 % of the skin.

        The curvature is measured by the diagonal: the material part would hide the buckling mode.
        """
        self._shift, diagonal, self._has_factors = 0.0, FIRST_DIAGONAL, False
        self._definite = False
        while not self.factor.factorise(diagonal=diagonal) and diagonal < LARGEST_SHIFT:
            diagonal *= 4
        # A start that is the same on any number of ranks: drawn by assembled vertex.
        model, generator = self.model, np.random.default_rng(seed)
        drawn = generator.standard_normal(model.skin.pattern.points.shape)
        mode = model.state_of(drawn[model.skin.owned_vertices])
        if model.contact is not None:
            model.contact.set_motions(mode, generator.standard_normal((model.free_bodies, 6)))
        for _ in range(20):
            mode = self.factor.solve(self.factor.scale * mode)
            mode /= norm(self.comm, mode)
        mode *= -1.0 if dot(self.comm, mode, residual) > 0 else 1.0
        return 0.01 * self.model.skin.pattern.size * mode

    def _cap(self, state: Floats, direction: Floats) -> float:
        """Return the fraction of a step that stretch bounds and contact allow."""
        return self.model.largest_step(state, direction, self.options.fraction_to_barrier)

    def _modified_step(self, point: _Point, rounding: float, *, first: bool) -> _Point | None:
        """Return the point after a step with the old factors; None if it gains too little."""
        direction = -self.factor.solve(point.residual)
        if not np.isfinite(norm(self.comm, direction)):
            return None
        fraction = self._cap(point.state, direction)
        if fraction < 1 and not first:
            return None
        trial = point.state + fraction * direction
        energy = self.model.energy(trial)
        slope = fraction * dot(self.comm, point.residual, direction)
        if not energy - point.energy <= (MODIFIED_GAIN / 2 * slope if first else rounding):
            return None
        new = self._at(trial, energy)
        return new if first or new.size <= MODIFIED_RATE * point.size else None

    def _lag(self, state: Floats) -> None:
        """Let friction have the normal forces of a state; energy and residual are by these."""
        if self.model.contact is not None:
            self.model.contact.lag_friction(state)

    def _lagged(self, point: _Point, before: _Point | None = None) -> _Point:
        """Return the point with friction by the normal forces of its own state.

        Where these overshoot, the point half way from the one before may be nearer to equilibrium:
        without it strong friction goes to and fro between two states.
        """
        if not self.model.slides:
            return point
        self._lag(point.state)
        found = self._at(point.state, self.model.energy(point.state))
        if before is None or found.size <= OVERSHOT * before.size:
            return found
        middle = (before.state + point.state) / 2
        self._lag(middle)
        half = self._at(middle, self.model.energy(middle))
        if half.size < OVERSHOT * found.size and np.isfinite(half.energy):
            return half
        self._lag(point.state)
        return found

    def _coupled_step(self, point: _Point) -> _Point | None:
        """Return the point after a step with the derivative of friction by normal forces too.

        It is not symmetric: GMRES solves, with the last factors. None if it gains too little.
        """
        self._assemble(point.state)
        direction, left = gmres(
            self.comm,
            lambda x: self.factor.multiply(x) + self.model.friction_coupling(point.state, x),
            self.factor.solve,
            -point.residual,
            COUPLED_LEFT,
            COUPLED_ITERATIONS,
        )
        if not (left <= 10 * COUPLED_LEFT and self._cap(point.state, direction) == 1):
            return None
        trial = point.state + direction
        self._lag(trial)
        new = self._at(trial, self.model.energy(trial))
        if np.isfinite(new.energy) and new.size <= COUPLED_RATE * point.size:
            return new
        self._lag(point.state)
        return None

    def _correct(self, old: _Point, new: _Point, fraction: float) -> _Point:
        """Solve for the residual beyond its linear prediction: the second-order correction."""
        for _ in range(CORRECTIONS):
            if new.size <= RELAXED * old.size:
                break
            change = -self.factor.solve(new.residual - (1 - fraction) * old.residual)
            # Contact may lie between two states whose energies tell nothing of it.
            if self.model.contact is not None and self._cap(new.state, change) < 1:
                break
            state = new.state + change
            energy = self.model.energy(state)
            if not energy < new.energy:
                break
            new = self._at(state, energy)
        return new

    def _search(
        self, point: _Point, direction: Floats, rounding: float, *, escaping: bool
    ) -> tuple[float, _Point | None]:
        """Return the fraction of the step and the point there; 0, None if no step lowers E."""
        if not np.isfinite(norm(self.comm, direction)):
            return 0.0, None
        slope = dot(self.comm, point.residual, direction)
        fraction = self._cap(point.state, direction)
        while fraction > SMALLEST_STEP:
            trial = point.state + fraction * direction
            energy = self.model.energy(trial)
            change = energy - point.energy
            if change <= ARMIJO * fraction * slope and (change < -rounding or not escaping):
                return fraction, self._at(trial, energy)
            if abs(change) <= rounding and not escaping:
                new = self._at(trial, energy)
                if abs(dot(self.comm, new.residual, direction)) <= 0.9 * abs(slope):
                    return fraction, new
            if np.isfinite(energy) and change > fraction * slope:
                quadratic = -slope * fraction**2 / (2 * (change - fraction * slope))
                fraction = min(max(quadratic, 0.1 * fraction), 0.5 * fraction)
            else:
                fraction *= 0.5
        return 0.0, None
