"""Newton's iteration: what the hooks of PETSc's SNES hold between steps, and each step of it."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from petsc4py import PETSc

from toros_fem.base.mpi import dot, largest, norm, smallest
from toros_fem.base.validation import Floats
from toros_fem.mechanics.equilibrium.linear_solver import PREFIX, ShiftLadder, TangentFactor
from toros_fem.mechanics.terms.model import SkinModel

# PETSc's reason where a residual is not finite; its name is another one from 3.25.
NO_NUMBER = -4
# If rounding keeps every step from lowering the energy, this residual over the load is enough.
STAGNATED = 1e-8
# Or this one, where Newton's full step leaves the fraction STUCK of it and moves nothing further
# than the fraction RESOLVED of the skin's size.
UNRESOLVED, STUCK, RESOLVED = 1e-5, 0.5, 1e-9
# Where rounding hides a step's gain, it must be the fraction ARMIJO of the predicted one, or leave
# at most the fraction FLATTER of the slope.
ARMIJO, FLATTER = 1e-4, 0.9
# Modified Newton steps are taken where at most this number of them promises to finish.
MODIFIED_STEPS = 3
# Fraction of the residual that a modified step may leave, and fraction of the predicted decrease
# of the energy that the first one must reach.
MODIFIED_RATE, MODIFIED_GAIN = 0.2, 0.2
# Krylov iterations with older factors are taken where they leave at most this fraction of the
# residual after KRYLOV_COST √n iterations: a factorisation of n unknowns costs some 0.05 √n solves.
INEXACT, KRYLOV_COST = 1e-2, 0.03
# With friction, steps with the whole derivative begin at the residual COUPLED over the load. GMRES
# leaves the fraction COUPLED_LEFT, and the step at most COUPLED_RATE of the residual.
COUPLED, COUPLED_LEFT, COUPLED_RATE, COUPLED_ITERATIONS = 1e-2, 1e-3, 0.3, 60
# A step that leaves more of the residual than this fraction is corrected, so that the stiff parts
# relax.
RELAXED = 0.1
CORRECTIONS = 2
# With friction, a step that leaves more of the residual than the fraction OVERSHOT may be halved.
OVERSHOT = 0.7
# Where rounding limits a residual, Newton's step leaves more than this fraction of it.
FALLS = 0.7
# Number of saddles that a solve leaves before it gives up, and the least part of a mode.
ESCAPES, SMALLEST_ESCAPE = 10, 1e-10
# Part of the diagonal that makes a saddle's tangent positive definite: the first and the largest.
FIRST_DIAGONAL, LARGEST_DIAGONAL = 1e-8, 1e6
INVERSE_ITERATIONS = 20
# Length of the mode over the skin's size.
LENGTH = 0.01
# States that are kept: the begin of a step, and the last trials.
KEPT = 3
Reason = PETSc.SNES.ConvergedReason


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Largest pressure of the level, in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its material part; 0 for pure Newton.
        step: Fraction of the step that was taken; 0 where it was refused, and in the row that ends
            a level.
        kind: "newton" with factors of this state, "cg" with older factors, "modified" with older
            tangent and factors, "coupled" with the derivative of friction by normal forces,
            "escape" from a saddle, "end".
        iterations: Number of Krylov iterations, those that were not enough included.
        seconds: Wall time of the step on this rank.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float
    kind: str
    iterations: int
    seconds: float

    def __str__(self) -> str:
        kind = f"cg {self.iterations}" if self.kind == "cg" else self.kind
        return (
            f"{self.pressure:10.4g} Pa  {kind:8s}  residual {self.residual:8.2e}  "
            f"energy {self.energy:+.9e} J  shift {self.shift:7.1e}  step {self.step:7.1e}  "
            f"{self.seconds:6.3f} s"
        )


class NewtonIteration:
    """Newton's iteration on a skin: the hooks of a SNES, its KSP and its line search.

    Each step goes through `_tangent`, `_end_iteration`, `_limit`, `_merit` and `_end_step`, in this
    order.

    Attributes:
        model: The skin's model, at the load and density that are set.
        factor, ladder: Its tangent and the shift of that.
        points: Energies and residuals of the last states.
        history: Rows of the solve.
        base: Begin of the step.
        reference: Applied load there in N, by which residuals are measured.
        rounding: Change of the energy in J that rounding may hide.
        tolerance: Residual over the load at which a state is an equilibrium.
        finish: Whether the tangent there must be positive definite; `proven` tells if it is.
        kind, iterations: Of the step, as in `NewtonStep`.
        step: Newton's step as far as the bounds allow it, `cap` this part of it, and `longest` its
            largest component in m.
        rate: Fraction of the residual that a modified step would leave.
        predict: Whether the next step may be a modified one from the start; `first` whether this
            one is.
        escapes: Number of saddles that were left.
    """

    base: Point

    def __init__(
        self,
        model: SkinModel,
        fraction_to_barrier: float,
        log: Callable[[NewtonStep], None] | None,
    ) -> None:
        self.model, self.comm = model, model.skin.comm
        self._fraction, self._log = fraction_to_barrier, log
        self.factor = TangentFactor(model)
        self.ladder = ShiftLadder(self.factor)
        self.points = Points(model)
        self.history: list[NewtonStep] = []
        self._stiffness, self._clock, self._rhs_size = 0.0, 0.0, 0.0

    def hook(self, snes: PETSc.SNES, force: PETSc.Vec) -> None:
        """Give a SNES with all its options the hooks, and its residual in N a place.

        PETSc holds them out of sight of Python's garbage collector, with some versions for ever:
        hence the weak references.
        """
        self._snes, self._ksp = snes, snes.getKSP()
        self._absolute = snes.getTolerances()[1]
        # Whether SNES and preconditioner are those of this package, and no option chooses others;
        # only with both may older factors serve.
        self._newton = snes.getType() == PETSc.SNES.Type.NEWTONLS
        factors = self._ksp.getPC().getType() == PETSc.PC.Type.PYTHON
        self._reuses = self._newton and factors
        self._limits_krylov = factors and not PETSc.Options(PREFIX).hasName("ksp_max_it")
        self._cg = self._ksp.getType() == PETSc.KSP.Type.CG
        self._krylov = round(KRYLOV_COST * self.model.space.dofmap.index_map.size_global**0.5)

        matrix = self.factor.matrix
        read = matrix if factors else self.factor.assembled_matrix()
        snes.setFunction(_weakly(self._force), force)
        snes.setJacobian(_weakly(self._tangent), matrix, read)
        if self._reuses:  # a trust region has a test of its own, which cannot hold ours
            self._ksp.setConvergenceTest(_weakly(self._end_iteration))
        snes.setLineSearchPreCheck(_weakly(self._limit))
        snes.setObjective(_weakly(self._merit))
        snes.setConvergenceTest(_weakly(self._end_step))

    def forget(self, *, near: bool) -> None:
        """Begin a solve, near the last one or not; its runs share a history (collective)."""
        self.history = []
        self._stiffness, self._clock = 0.0, time.perf_counter()
        self.ladder.reset(near=near)

    def begin(self, start: Floats, tolerance: float, *, finish: bool, predict: bool) -> bool:
        """Begin a run of the SNES; return whether the start is admissible (collective)."""
        model = self.model
        self.lag(start)
        self.base = self.points.at(start)
        crossed = model.contact is not None and model.contact.crossed(start)
        self.tolerance, self.finish, self.predict = tolerance, finish, predict
        self.kind, self.first, self.proven = "newton", False, False
        self.step: Floats = np.zeros_like(start)
        self.rate, self.cap, self.longest = np.inf, 1.0, np.inf
        self.iterations = self.escapes = 0
        if not np.isfinite(self.base.energy) or crossed:
            return False
        self.measure()
        return True

    def measure(self) -> None:
        """Measure the load and the rounding of the energy at the base (collective)."""
        self.reference = load_at(self.model, self.base.state)
        load_energy = self.model.load_energy(self.base.state)
        self.rounding = self.model.energy_rounding() + 1e-14 * load_energy

    @property
    def residual(self) -> float:
        """Residual over the load at the begin of the step."""
        return self.base.size / self.reference

    @property
    def exact(self) -> bool:
        """Whether the step is Newton's own: with factors of this state, without a shift."""
        return self.kind == "newton" and self.ladder.shift == 0

    def assemble(self, state: Floats) -> None:
        """Assemble the tangent at a state."""
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        self.assemble(state)
        return self.factor.factorise()

    def lag(self, state: Floats) -> None:
        """Let friction have the normal forces of a state; energy and residual are by these."""
        self.points.forget()
        if self.model.contact is not None:
            self.model.contact.lag_friction(state)

    def cap_of(self, state: Floats, step: Floats) -> float:
        """Return the part of a step that stretch bounds and contact allow."""
        return self.model.largest_step(state, step, self._fraction)

    def record(self, kind: str, step: float) -> None:
        """Add a row to the history: the step from the base, and the part of it that was taken."""
        now = time.perf_counter()
        row = NewtonStep(
            self.model.load.largest,
            self.residual,
            self.base.energy,
            self.ladder.shift if kind == "newton" else 0.0,
            step,
            kind,
            self.iterations,
            now - self._clock,
        )
        self._clock = now
        self.history.append(row)
        if self._log is not None:
            self._log(row)

    def force_rounding(self) -> float:
        """Return the norm in N by which rounded positions may change the residual."""
        return 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size * self._stiffness

    # A step: the tangent, the linear solve, and the part of the step that is allowed.

    def _force(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array_w[:] = self.points.near(x.array_r).residual

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, _: PETSc.Mat, __: PETSc.Mat) -> None:
        """Assemble the tangent, or leave that of an older state for a modified step."""
        usable = self.factor.usable and self._reuses
        promised = self.predict or self.residual * self.rate**MODIFIED_STEPS <= self.tolerance
        self.first, self.predict, self.rate = self.predict, False, np.inf
        self.ladder.renew = False
        if usable and promised:
            self.kind = "modified"
            return
        self.assemble(np.array(x.array_r))
        self.factor.fill()
        coupled = usable and self.model.slides and self.residual <= COUPLED
        self.kind = "coupled" if coupled else "cg" if usable and self._krylov >= 2 else "newton"
        self.factor.couple(self.base.state if coupled else None)
        self.ladder.renew = self.kind == "newton"
        if self._limits_krylov:
            self._ksp.setTolerances(max_it=COUPLED_ITERATIONS if coupled else max(self._krylov, 1))

    def _end_iteration(self, ksp: PETSc.KSP, count: int, size: float) -> int:
        """Test the linear solve, and its first direction for negative curvature.

        PETSc's CG looks for a change of its sign only.
        """
        reasons = PETSc.KSP.ConvergedReason
        if self.kind == "modified":  # factors alone make the step, in `_limit`
            return int(reasons.CONVERGED_ITS)
        relative, _, _, limit = ksp.getTolerances()
        if count == 0:
            self._rhs_size = size
        left = size / self._rhs_size if self._rhs_size > 0 else 0.0
        if not np.isfinite(left):
            return int(reasons.DIVERGED_NANORINF)
        if count == 1 and self._cg:
            solved = dot(self.comm, ksp.getRhs().array_r, ksp.getSolution().array_r)
            if not solved > 0:
                return int(reasons.DIVERGED_INDEFINITE_MAT)
        if left <= relative:
            return int(reasons.CONVERGED_RTOL)
        return int(reasons.DIVERGED_MAX_IT if count >= limit else reasons.ITERATING)

    def _limit(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Renew a step of older factors that does not serve; shorten it by bounds and contact."""
        self.iterations = self._ksp.getIterationNumber()
        if self.kind == "modified":
            y.array_w[:] = self.factor.solve(self.base.residual)
        while self.kind != "newton" and not self._serves(y):
            self._renew(y)
        if self.kind == "newton":
            self._descend(y)
            self._shorten(y)
        self.step = np.array(y.array_r)
        return True

    def _serves(self, y: PETSc.Vec) -> bool:
        """Return whether a step by older factors is good enough; it is shortened then."""
        base = self.base
        size = norm(self.comm, y.array_r)
        if self._ksp.getConvergedReason() < 0 or not np.isfinite(size):
            return False
        self._shorten(y)
        if self.kind == "cg":
            return True
        if self.cap < 1 and not self.first:
            return False
        trial = base.state - y.array_r
        if self.kind == "coupled":
            self.lag(trial)
            return self.points.at(trial).size <= COUPLED_RATE * base.size
        change = self._change(trial)
        if self.first:
            return change <= -MODIFIED_GAIN / 2 * dot(self.comm, base.residual, y.array_r)
        return change <= self.rounding and self.points.at(trial).size <= MODIFIED_RATE * base.size

    def _renew(self, y: PETSc.Vec) -> None:
        """Solve for the step anew: with the tangent of this state, then with its factors."""
        if self.kind == "coupled":
            self.lag(self.base.state)
            self.factor.couple(None)
        if self.kind == "modified":
            self.assemble(self.base.state)
        self.kind = "cg" if self.kind == "modified" and self._krylov >= 2 else "newton"
        self._solve_anew(y, 0.0)

    def _solve_anew(self, y: PETSc.Vec, shift: float) -> None:
        self.factor.fill(shift)
        self.ladder.renew = self.kind == "newton"
        self._ksp.solve(self._snes.getFunction()[0], y)
        self.iterations += self._ksp.getIterationNumber()

    def _descend(self, y: PETSc.Vec) -> None:
        """Let the shift grow until the step goes downhill."""
        ksp, reasons = self._ksp, PETSc.KSP.ConvergedReason
        while True:
            reason = ksp.getConvergedReason()
            solved = reason > 0 or reason == reasons.DIVERGED_MAX_IT
            if solved and dot(self.comm, self.base.residual, y.array_r) > 0:
                return
            if self.ladder.exhausted:
                y.set(0.0)
                return
            self.ladder.enlarge()
            self._solve_anew(y, self.ladder.shift)

    def _shorten(self, y: PETSc.Vec) -> None:
        """Take the part of the step that stretch bounds and contact allow."""
        self.longest = largest(self.comm, float(np.abs(y.array_r).max(initial=0.0)))
        self.cap = self.cap_of(self.base.state, -y.array_r)
        y.scale(self.cap)

    def _merit(self, _: PETSc.SNES, x: PETSc.Vec) -> float:
        """Return what the line search lowers: the change of the energy in J.

        Where rounding hides it, Armijo's rule must hold, or the step must flatten the slope: else
        one that moves nothing would do (Hager & Zhang 2005, eq. 2.4, approximate Wolfe). With
        friction, which has no potential, it is that of the residual near the end.
        """
        state = x.array_r
        if self.points.same(state, self.base.state):
            return 0.0
        if self.kind == "coupled":
            return self.points.at(state).size - self.base.size
        change = self.points.near(state).energy - self.base.energy
        if not abs(change) <= self.rounding:
            return change
        before, after = self._work(state)
        if change <= ARMIJO * before:
            return change
        flatter = abs(after) <= FLATTER * abs(before)
        return (before + after) / 2 if flatter else self.rounding

    def _change(self, state: Floats) -> float:
        """Return the change of the energy in J since the begin of the step.

        Where rounding hides it, it is the work of the mean force.
        """
        change = self.points.near(state).energy - self.base.energy
        return sum(self._work(state)) / 2 if abs(change) <= self.rounding else change

    def _work(self, state: Floats) -> tuple[float, float]:
        """Return the work in J of the forces at the begin and at a state, on the way to it."""
        moved = state - self.base.state
        residual = self.points.near(state).residual
        return dot(self.comm, self.base.residual, moved), dot(self.comm, residual, moved)

    # The end of a step: the state is corrected, and tested.

    def _end_step(self, snes: PETSc.SNES, count: int, norms: tuple[float, float, float]) -> int:
        """Correct the state that the line search found, and test it.

        petsc4py 3.22 has no post-check of the line search, where PETSc would change a state.
        """
        x = snes.getSolution()
        found = point = self.points.at(x.array_r)
        if not np.isfinite(point.size):
            return NO_NUMBER
        outcome = None
        if count > 0 and self._newton:
            outcome, point = self._advance(point)
        elif count > 0:
            self.record("newton", 1.0)
        self.base = point
        if outcome is None:
            outcome = self._judge(count)
        if self.base is not found:
            x.array[:] = self.base.state
            snes.getFunction()[0].array[:] = self.base.residual
            snes.setFunctionNorm(self.base.size)
        return outcome

    def _advance(self, found: Point) -> tuple[int | None, Point]:
        """Return why the solve ends, or None, and the point from which it goes on."""
        base = self.base
        moved = not self.points.same(found.state, base.state)
        fraction = self.cap * self._part(found) if moved else 0.0
        whole = fraction == 1.0 and self.exact
        stuck = self._stuck(found.size if fraction == 1.0 else np.inf)
        if stuck and not self._nearer(found):
            self.proven = True  # K is factorised there, unshifted
            self.record("end", 0.0)
            return int(Reason.CONVERGED_SNORM_RELATIVE), base
        self.record(self.kind, fraction)
        if stuck:
            return self._taken(found), found
        if not moved:
            return self._refused(), base
        new = found
        if self.kind == "cg" and self.residual <= UNRESOLVED and new.size > STUCK * base.size:
            self.factor.usable = False  # only the exact direction tells rounding
        if self.kind in ("newton", "cg"):
            new = self._correct(base, new, fraction)
        if self.kind != "coupled":
            new = self._lagged(new, base if fraction == 1.0 else None)
        # Newton's residual falls quadratically; that of a modified step by twice this factor.
        if whole or self.kind == "modified":
            self.rate = (2 if whole else 1) * new.size / base.size
        return None, new

    def _part(self, found: Point) -> float:
        if self.points.same(found.state, self.base.state - self.step):
            return 1.0  # the difference of two states may have no digits left
        along = dot(self.comm, self.base.state - found.state, self.step)
        return along / dot(self.comm, self.step, self.step)

    def _correct(self, old: Point, new: Point, fraction: float) -> Point:
        """Solve for the residual beyond its linear prediction: the second-order correction."""
        for _ in range(CORRECTIONS):
            if new.size <= RELAXED * old.size:
                break
            change = -self._back(new.residual - (1 - fraction) * old.residual)
            # Contact may lie between two states whose energies tell nothing of it.
            if self.model.contact is not None and self.cap_of(new.state, change) < 1:
                break
            state = new.state + change
            if not self.points.near(state).energy < new.energy:
                break
            new = self.points.at(state)
        return new

    def _back(self, rhs: Floats) -> Floats:
        """Solve with the factors of the last step, or as an option wants it."""
        if self._reuses:
            return self.factor.solve(rhs)
        right, solution = self.factor.matrix.createVecs()
        right.array[:] = rhs
        self._ksp.solve(right, solution)
        return np.array(solution.array_r)

    def _lagged(self, point: Point, before: Point | None) -> Point:
        """Return the point with friction by the normal forces of its own state.

        Where these overshoot, the point half way from the one before may be nearer to equilibrium:
        without it strong friction goes to and fro between two states.
        """
        if not self.model.slides:
            return point
        self.lag(point.state)
        found = self.points.at(point.state)
        if before is None or found.size <= OVERSHOT * before.size:
            return found
        middle = (before.state + point.state) / 2
        self.lag(middle)
        half = self.points.at(middle)
        if half.size < OVERSHOT * found.size and np.isfinite(half.energy):
            return half
        self.lag(point.state)
        return self.points.at(point.state)

    def _refused(self) -> int | None:
        """Return why the solve ends where a step was refused; None if it goes on."""
        if self.kind != "newton":  # rounding, or a barrier that needs the exact direction
            self.factor.usable = False
            if self.kind == "coupled":
                self.lag(self.base.state)
            return None
        if self.residual <= STAGNATED and self.stable(self.base.state):
            self.proven = True
            return int(Reason.CONVERGED_SNORM_RELATIVE)
        if self.ladder.exhausted:
            return int(Reason.DIVERGED_LINE_SEARCH)
        self.ladder.enlarge()
        return None

    def _judge(self, count: int) -> int:
        """Return PETSc's reason at the point from which a step would begin."""
        if self.residual <= max(self.tolerance, UNRESOLVED):
            self.measure()
        size = self.base.size
        if size <= max(self.tolerance * self.reference, self._floor(), self._absolute):
            self.proven = self.finish and self.stable(self.base.state)
            if self.proven or not self.finish or not self._newton:
                self.record("end", 0.0)
                return int(Reason.CONVERGED_FNORM_RELATIVE)
            if self.escapes == ESCAPES:
                return int(Reason.DIVERGED_INNER)
            self.base = self._escape(self.base)
        if count >= self._snes.getTolerances()[3]:
            return int(Reason.DIVERGED_MAX_IT)
        return int(Reason.ITERATING)

    def _floor(self) -> float:
        """Return the residual's norm by rounding of the positions alone, once K is known.

        Close to the stretch bounds it would exceed any load, so that it is limited.
        """
        return min(self.force_rounding(), STAGNATED * self.reference)

    def _stuck(self, size: float) -> bool:
        """Return whether rounding limits the residual: Newton's whole step is negligible.

        Where stretching is far stiffer than bending, its rounding alone may exceed the load. `size`
        is the norm after the whole step; infinite if it was shortened.
        """
        if not self.exact or self.residual > UNRESOLVED or size <= STUCK * self.base.size:
            return False
        small = self.longest <= RESOLVED * self.model.skin.pattern.size
        return small and self.base.size <= self.force_rounding()

    def _nearer(self, found: Point) -> bool:
        """Return whether Newton's last step is worth a factorisation, though rounding is near.

        Where a mode is soft, a state whose residual is hardly above its rounding may be far from
        the equilibrium; and a residual that still falls is above it. With friction the residual
        after the step is not known yet.
        """
        far = self.longest > self.tolerance * self.model.skin.pattern.size
        falls = found.size < (1.0 if far else FALLS) * self.base.size
        return falls and not self.model.slides

    def _taken(self, found: Point) -> int | None:
        """Return why the solve ends after Newton's last step; None if it leads to a saddle."""
        self.base, self.proven = found, self.stable(found.state)
        if not self.proven:
            return None
        self.record("end", 0.0)
        return int(Reason.CONVERGED_SNORM_RELATIVE)

    def _escape(self, saddle: Point) -> Point:
        """Return a lower point along the softest mode of a saddle."""
        self.escapes += 1
        self.ladder.shift = 0.0
        mode = softest_mode(self.model, self.factor, saddle.residual, self.escapes)
        self.factor.usable = False
        fraction = self.cap_of(saddle.state, mode)
        while fraction > SMALLEST_ESCAPE:
            state = saddle.state + fraction * mode
            if self.points.near(state).energy - saddle.energy < -self.rounding:
                self.record("escape", fraction)
                return self.points.at(state)
            fraction /= 2
        return saddle


def load_at(model: SkinModel, state: Floats) -> float:
    """Return the norm of the applied load in N, by which residuals are measured (collective).

    Where supports move, or without any load, it is that of their reaction. Without any reaction it
    is the force of a strain of 1e-4.
    """
    comm = model.skin.comm
    load = norm(comm, model.applied_load(state))
    if load > 0 and model.load.displacement is None:
        return load
    reaction = norm(comm, model.reaction(state))
    if load > 0:
        return max(load, reaction)
    area = float(model.skin.pattern.areas.sum())
    return max(1e-4 * model.mean_modulus() * area**0.5, reaction)


def softest_mode(model: SkinModel, factor: TangentFactor, residual: Floats, seed: int) -> Floats:
    """Return the mode of smallest curvature by inverse iteration, against a residual (collective).

    The curvature is measured by the diagonal: the material part would hide the buckling mode. The
    tangent must be assembled.
    """
    comm, diagonal = model.skin.comm, FIRST_DIAGONAL
    while not factor.factorise(diagonal=diagonal) and diagonal < LARGEST_DIAGONAL:
        diagonal *= 4
    # A start that is the same on any number of ranks: drawn by assembled vertex.
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal(model.skin.pattern.points.shape)
    mode = model.state_of(drawn[model.skin.owned_vertices])
    if model.contact is not None:
        model.contact.set_motions(mode, generator.standard_normal((model.free_bodies, 6)))
    for _ in range(INVERSE_ITERATIONS):
        mode = factor.solve(factor.scale * mode)
        mode /= norm(comm, mode)
    mode *= -1.0 if dot(comm, mode, residual) > 0 else 1.0
    return LENGTH * model.skin.pattern.size * mode


def _weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a method without keeping its object."""
    held = weakref.WeakMethod(method)

    def call(*given: Any) -> Any:
        bound = held()
        assert bound is not None
        return bound(*given)

    return call


class Point:
    """A state with its energy in J, its residual in N, and its norm, each evaluated once."""

    def __init__(self, model: SkinModel, state: Floats) -> None:
        self._model, self.state = model, np.array(state)

    @cached_property
    def energy(self) -> float:
        """Energy, infinite outside the stretch bounds."""
        return self._model.energy(self.state)

    @cached_property
    def residual(self) -> Floats:
        """First variation, zero at fixed components."""
        return self._model.residual(self.state)

    @cached_property
    def size(self) -> float:
        """Norm of the residual."""
        return norm(self._model.skin.comm, self.residual)


class Points:
    """The last states of a model (collective)."""

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._last: list[Point] = []

    def forget(self) -> None:
        """Forget all: the model has another load, design or friction now."""
        self._last.clear()

    def same(self, first: Floats, second: Floats) -> bool:
        """Return whether two states are equal to the last bit, on all ranks."""
        return smallest(self._model.skin.comm, np.array_equal(first, second)) > 0

    def near(self, state: Floats) -> Point:
        """Return a point, of which what is asked for is evaluated while the model is as it is."""
        for place, point in enumerate(reversed(self._last), start=1):
            if self.same(point.state, state):
                self._last.append(self._last.pop(-place))
                return point
        self._last.append(Point(self._model, state))
        del self._last[:-KEPT]
        return self._last[-1]

    def at(self, state: Floats) -> Point:
        """Return a point that stays as it is, whatever becomes of the model."""
        point = self.near(state)
        assert point.energy is not None
        assert point.size is not None
        return point
