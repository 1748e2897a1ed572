"""Stable equilibria near a start by PETSc's SNES, with what skins need in its hooks."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.equilibrium.narrowing import into_bounds
from toros_fem.mechanics.equilibrium.newton_step import NewtonResult, NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.petsc_options import (
    PREFIX,
    refusals,
    tell_unused,
    with_defaults,
)
from toros_fem.mechanics.equilibrium.points import Point, Points
from toros_fem.mechanics.equilibrium.saddle import softest_mode
from toros_fem.mechanics.equilibrium.shift import ShiftedCholesky, ShiftLadder

# A step that leaves more of the residual than this fraction is corrected, so that the stiff parts
# relax.
RELAXED = 0.1
CORRECTIONS = 2
# Modified Newton steps are taken where at most this number of them promises to finish.
MODIFIED_STEPS = 3
# Fraction of the residual that a modified step may leave, and fraction of the predicted decrease
# of the energy that the first one must reach.
MODIFIED_RATE, MODIFIED_GAIN = 0.2, 0.2
# Krylov iterations with older factors are taken where they leave at most this fraction of the
# residual after KRYLOV_COST √n iterations: a factorisation of n unknowns costs some 0.05 √n solves.
INEXACT, KRYLOV_COST = 1e-2, 0.03
# They end early where they would leave more than SLOW times that at the rate so far.
SLOW = 10.0
# With friction, a step that leaves more of the residual than the fraction OVERSHOT may be halved.
OVERSHOT = 0.7
# With friction, steps with the whole derivative begin at the residual COUPLED over the load. GMRES
# leaves the fraction COUPLED_LEFT, and the step at most COUPLED_RATE of the residual.
COUPLED, COUPLED_LEFT, COUPLED_RATE, COUPLED_ITERATIONS = 1e-2, 1e-3, 0.3, 60
# Number of saddles that a solve leaves before it gives up, and the least part of a mode.
ESCAPES, SMALLEST_ESCAPE = 10, 1e-10
# If rounding keeps every step from lowering the energy, this residual over the load is enough.
STAGNATED = 1e-8
# Or this one, where Newton's full step leaves the fraction STUCK of the residual and moves nothing
# further than the fraction RESOLVED of the skin's size.
UNRESOLVED, STUCK, RESOLVED = 1e-5, 0.5, 1e-9
# Residual over the applied load at which a trial's objective is known well enough.
TRIAL_TOLERANCE = 1e-6
# PETSc's limits on failed line searches and linear solves: the hooks decide.
UNLIMITED = 1_000_000

Reason = PETSc.SNES.ConvergedReason


@dataclass(eq=False)
class _Run:
    """One solve: its limits, and what one hook leaves to the next.

    `base` is the begin of the step, `step` Newton's step as far as the bounds allow, `cap` this
    part of it, `longest` its largest component; `rate` the fraction of the residual that the next
    modified step would leave, `predict` whether the first step is one, `first` whether this one is.
    """

    base: Point
    tolerance: float
    finish: bool
    predict: bool
    reference: float
    rounding: float
    rate: float = np.inf
    kind: str = "newton"
    step: Floats | None = None
    cap: float = 1.0
    longest: float = np.inf
    first: bool = False
    iterations: int = 0
    escapes: int = 0
    proven: bool = False

    @property
    def residual(self) -> float:
        """Residual over the load at the begin of the step."""
        return self.base.size / self.reference


class Newton:
    """Newton's method on E from a start, at the load and density set in the model.

    SNES is of type "newtonls": KSP solves (K + τM) p = r, and the line search `bt` halves the step
    until the energy falls. The hooks hold what PETSc has not:

    - **Shift.** The preconditioner factorises K + τM with the smallest τ of a ladder that leaves no
      negative pivot. M is K's material part: it resists strains, not the large rotations by which
      slender skins snap. Where no step lowers the energy, τ grows.
    - **Older factors** precondition CG; K is factorised only where few iterations are not enough.
      Near the end, and at the start with the factors of a neighbouring equilibrium, modified steps
      reuse K too. With friction GMRES takes the place of CG, and near the end K has the derivative
      by normal forces, which is not symmetric.
    - **Step limit** (pre-check of the line search): a step uses up a part of the distance to the
      stretch bounds, and nothing passes through anything.
    - **Correction.** A long step stretches the triangles that it turns. A second solve with the
      same factors mends that (the second-order correction of constrained optimisation).
    - **Rounding.** Near the end, and where energies differ by less than their rounding, the work of
      the mean force tells the difference.
    - **Proof** (convergence test): a state is an equilibrium where K is positive definite and the
      residual is below the tolerance times the applied load, or below the rounding of the
      positions. A saddle is left along its softest mode. Where rounding keeps the residual from
      falling further, STAGNATED is enough, or UNRESOLVED where Newton's step is negligible.

    Attributes:
        model, options: As given.
        factor: The factorised tangent; after success it is that at the equilibrium.
        ladder: Its shift.
        tolerance, max_steps: Those of the options, or of PETSc's with the prefix "toros_".

    Args:
        model: The skin's model.
        options: Tolerance and limits.
        log: Called with every row of the history as it comes, on every rank.
    """

    def __init__(
        self,
        model: SkinModel,
        options: NewtonOptions,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self.model, self.options, self._log = model, options, log
        self.comm = model.skin.comm
        self.factor = TangentFactor(model)
        self.ladder = ShiftLadder(self.factor)
        self._points = Points(model)
        self._krylov = round(KRYLOV_COST * model.space.dofmap.index_map.size_global**0.5)
        self._snes, self._x = self._make_snes()
        self.tolerance, self._absolute, _, self.max_steps = self._snes.getTolerances()
        self._own = self._snes.getType() == PETSc.SNES.Type.NEWTONLS
        own_factors = self._snes.getKSP().getPC().getType() == PETSc.PC.Type.PYTHON
        self._reuses = self._own and own_factors
        limited = PETSc.Options(PREFIX).hasName("ksp_max_it")
        self._limits_krylov = own_factors and not limited
        self._run: _Run | None = None
        self._told = False  # what options are unused
        self._history: list[NewtonStep] = []
        self._stiffness, self._clock, self._rhs_size = 0.0, 0.0, 0.0

    def _make_snes(self) -> tuple[PETSc.SNES, PETSc.Vec]:
        # PETSc holds hooks out of sight of Python's garbage collector, with some versions for ever.
        def weakly(method: Callable[..., Any]) -> Callable[..., Any]:
            held = weakref.WeakMethod(method)

            def call(*given: Any) -> Any:
                found = held()
                assert found is not None
                return found(*given)

            return call

        matrix = self.factor.matrix
        x, residual = matrix.createVecs()
        snes = PETSc.SNES().create(self.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setType(PETSc.SNES.Type.NEWTONLS)
        snes.setFunction(weakly(self._residual), residual)
        snes.setObjective(weakly(self._merit))
        snes.setJacobian(weakly(self._tangent), matrix)
        snes.setLineSearchPreCheck(weakly(self._limit))
        snes.setConvergenceTest(weakly(self._end_step))
        options = self.options
        snes.setTolerances(rtol=options.tolerance, atol=0.0, stol=0.0, max_it=options.max_steps)
        snes.setMaxStepFailures(UNLIMITED)
        snes.setMaxLinearSolveFailures(UNLIMITED)
        ksp = snes.getKSP()
        symmetric = not self.model.slides
        ksp.setType(PETSc.KSP.Type.CG if symmetric else PETSc.KSP.Type.GMRES)
        if not symmetric:
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
            ksp.setGMRESRestart(COUPLED_ITERATIONS)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setConvergenceTest(weakly(self._end_iteration))
        ksp.setTolerances(rtol=INEXACT if symmetric else COUPLED_LEFT)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(ShiftedCholesky(self.ladder))
        with refusals(), with_defaults():
            snes.setFromOptions()
        if pc.getType() != PETSc.PC.Type.PYTHON:
            snes.setJacobian(weakly(self._tangent), matrix, self.factor.assembled_matrix())
        return snes, x

    @property
    def steps(self) -> int:
        """Number of steps of the last run of the SNES."""
        return int(self._snes.getIterationNumber())

    def __call__(
        self,
        start: Floats,
        *,
        near: bool = False,
        max_steps: int | None = None,
        trial: bool = False,
    ) -> NewtonResult:
        """Find a stable equilibrium near a start (collective).

        Args:
            start: Owned unknowns.
            near: Whether the start is the equilibrium of a neighbouring design or load.
            max_steps: Largest number of steps; None takes that of the options.
            trial: Whether TRIAL_TOLERANCE is enough, without proof that the state is stable.

        Returns:
            If it converged and is no trial, the tangent at its state is factorised.
        """
        tolerance = max(self.tolerance, TRIAL_TOLERANCE) if trial else self.tolerance
        left = max_steps or self.max_steps
        self._history, self._stiffness, self._clock = [], 0.0, time.perf_counter()
        self.ladder.reset(near=near)
        begin, left = into_bounds(self, start, left, near=near)
        near &= begin is start
        state, outcome = self.minimise(begin, tolerance, left, near=near, finish=not trial)
        rows = tuple(self._history)
        return NewtonResult(state, outcome, len(rows), rows, self.ladder.definite)

    def minimise(
        self, start: Floats, tolerance: float, max_steps: int, *, near: bool, finish: bool
    ) -> tuple[Floats, int]:
        """Run the SNES once; return where it ended, and PETSc's reason (collective)."""
        model = self.model
        self._lag(start)
        begin = self._points.at(start)
        crossed = model.contact is not None and model.contact.crossed(start)
        if not np.isfinite(begin.energy) or crossed:
            return start, int(Reason.DIVERGED_FUNCTION_DOMAIN)
        self._run = run = _Run(
            base=begin,
            tolerance=tolerance,
            finish=finish,
            predict=near and self._own,
            reference=self.reference(start),
            rounding=model.energy_rounding() + 1e-14 * model.load_energy(start),
        )
        self._snes.setTolerances(rtol=tolerance, max_it=max_steps)
        self._x.array[:] = start
        with refusals():
            self._snes.solve(None, self._x)
        if not self._told:
            self._told = True
            tell_unused(self.comm)
        state, outcome = np.array(self._x.array_r), int(self._snes.getConvergedReason())
        # Another type of SNES, chosen by an option, may have stopped at a saddle.
        if outcome > 0 and finish and not run.proven and not self.stable(state):
            outcome = int(Reason.DIVERGED_INNER)
        return state, outcome

    def reference(self, state: Floats) -> float:
        """Return the norm of the applied load in N, by which residuals are measured (collective).

        Where supports move, or without any load, it is that of their reaction. Without any
        reaction it is the force of a strain of 1e-4.
        """
        model = self.model
        load = norm(self.comm, model.applied_load(state))
        if load > 0 and model.load.displacement is None:
            return load
        reaction = norm(self.comm, model.reaction(state))
        if load > 0:
            return max(load, reaction)
        area = float(model.skin.pattern.areas.sum())
        return max(1e-4 * model.mean_modulus() * area**0.5, reaction)

    def direction(self, state: Floats, residual: Floats) -> Floats:
        """Return Newton's direction against a residual in N, with the tangent at a state."""
        self._assemble(state)
        self.ladder.factorise()
        return -self.factor.solve(residual)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        self._assemble(state)
        return self.factor.factorise()

    # The hooks of SNES, in the order in which a step calls them.

    def _residual(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array_w[:] = self._points.residual(x.array_r)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, _: PETSc.Mat, __: PETSc.Mat) -> None:
        """Assemble the tangent, or leave that of an older state for a modified step."""
        run, usable = self._now, self.factor.usable and self._reuses
        promised = run.predict or run.residual * run.rate**MODIFIED_STEPS <= run.tolerance
        run.first, run.predict, run.rate = run.predict, False, np.inf
        if usable and promised:
            run.kind = "modified"
            return
        self._assemble(np.array(x.array_r))
        self.factor.fill()
        coupled = usable and self.model.slides and run.residual <= COUPLED
        run.kind = "coupled" if coupled else "cg" if usable and self._krylov >= 2 else "newton"
        self.factor.couple(run.base.state if coupled else None)
        self.ladder.renew = run.kind == "newton"
        if self._limits_krylov:
            snes.getKSP().setTolerances(
                max_it=COUPLED_ITERATIONS if coupled else max(self._krylov, 1)
            )

    def _end_iteration(self, ksp: PETSc.KSP, count: int, size: float) -> int:
        """Test the linear solve; give up where its rate so far is far too slow."""
        reasons = PETSc.KSP.ConvergedReason
        relative, _, _, limit = ksp.getTolerances()
        if count == 0:
            self._rhs_size = size
        left = size / self._rhs_size if self._rhs_size > 0 else 0.0
        if not np.isfinite(left):
            return int(reasons.DIVERGED_NANORINF)
        if left <= relative:
            return int(reasons.CONVERGED_RTOL)
        slow = self._limits_krylov and np.log(left) * limit > np.log(SLOW * relative) * count
        ends = count >= limit or (count > 0 and slow)
        return int(reasons.DIVERGED_MAX_IT if ends else reasons.ITERATING)

    def _limit(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Renew a step of older factors that does not serve; shorten it by bounds and contact."""
        run = self._now
        run.iterations = 0
        while run.kind != "newton" and not self._serves(y):
            self._renew(y)
        if run.kind == "newton":
            self._descend(y)
            self._shorten(y)
        run.step = np.array(y.array_r)
        return True

    def _merit(self, _: PETSc.SNES, x: PETSc.Vec) -> float:
        """Return the energy in J less that at the begin of the step."""
        run, state = self._now, x.array_r
        if self._points.same(state, run.base.state):
            return 0.0
        if run.kind == "coupled":  # friction has no potential
            return self._points.at(state).size - run.base.size
        return self._change(state)

    def _end_step(
        self, snes: PETSc.SNES, count: int, norms: tuple[float, float, float]
    ) -> Reason | int:
        """Correct the state that the line search found, and test it.

        petsc4py 3.22 has no post-check of the line search, where PETSc would change a state.
        """
        run, x = self._now, snes.getSolution()
        found = point = self._points.at(x.array_r)
        if not np.isfinite(point.size):
            return Reason.DIVERGED_FNORM_NAN
        outcome = None
        if count > 0 and self._own:
            outcome, point = self._advance(point)
        elif count > 0:
            self._record("newton", 1.0)
        run.base = point
        if outcome is None:
            outcome = self._judge(count)
        if run.base is not found:
            x.array[:] = run.base.state
            snes.getFunction()[0].array[:] = run.base.residual
            snes.setFunctionNorm(run.base.size)
        return outcome

    def _advance(self, found: Point) -> tuple[int | None, Point]:
        """Return why the solve ends, or None, and the point from which it goes on."""
        run, base = self._now, self._now.base
        moved = not self._points.same(found.state, base.state)
        fraction = 0.0
        if moved and run.step is not None:
            along = dot(self.comm, base.state - found.state, run.step)
            fraction = run.cap * round(along / dot(self.comm, run.step, run.step), 9)
        whole = fraction == 1.0 and run.kind == "newton" and self.ladder.shift == 0
        if self._stuck(found.size if fraction == 1.0 else np.inf):
            run.proven = True  # K is factorised there, unshifted
            self._record("end", 0.0)
            return int(Reason.CONVERGED_SNORM_RELATIVE), base
        self._record(run.kind, fraction)
        if not moved:
            return self._refused(), base
        new = found
        if run.kind == "cg" and run.residual <= UNRESOLVED and new.size > STUCK * base.size:
            self.factor.usable = False  # only the exact direction tells rounding
        if run.kind in ("newton", "cg"):
            new = self._correct(base, new, fraction)
        if run.kind != "coupled":
            new = self._lagged(new, base if fraction == 1.0 else None)
        # Newton's residual falls quadratically; that of a modified step by twice this factor.
        if whole or run.kind == "modified":
            run.rate = (2 if whole else 1) * new.size / base.size
        return None, new

    def _refused(self) -> int | None:
        """Return why the solve ends where no part of a step lowers the energy; None if it goes on."""
        run = self._now
        if run.kind != "newton":  # rounding, or a barrier that needs the exact direction
            self.factor.usable = False
            if run.kind == "coupled":
                self._lag(run.base.state)
            return None
        if run.residual <= STAGNATED and self.stable(run.base.state):
            run.proven = True
            return int(Reason.CONVERGED_SNORM_RELATIVE)
        if self.ladder.exhausted:
            return int(Reason.DIVERGED_LINE_SEARCH)
        self.ladder.enlarge()
        return None

    def _judge(self, count: int) -> int:
        """Return PETSc's reason at the point from which a step would begin."""
        run = self._now
        if run.base.size <= 10 * max(run.tolerance, STAGNATED) * run.reference:
            run.reference = self.reference(run.base.state)
        size = run.base.size
        if size <= max(run.tolerance * run.reference, self._floor(), self._absolute):
            run.proven = run.finish and self.stable(run.base.state)
            if run.proven or not run.finish or not self._own:
                self._record("end", 0.0)
                return int(Reason.CONVERGED_FNORM_RELATIVE)
            if run.escapes == ESCAPES:
                return int(Reason.DIVERGED_INNER)
            run.base = self._escape(run.base)
        contact = self.model.contact
        if contact is not None and contact.falls(run.base.state):
            return int(Reason.DIVERGED_DTOL)
        if count >= self._snes.getTolerances()[3]:
            return int(Reason.DIVERGED_MAX_IT)
        return int(Reason.ITERATING)

    # What the hooks use.

    @property
    def _now(self) -> _Run:
        assert self._run is not None
        return self._run

    def _serves(self, y: PETSc.Vec) -> bool:
        """Return whether a step by older factors is good enough; it is shortened then."""
        run, base = self._now, self._now.base
        run.iterations += self._snes.getKSP().getIterationNumber()
        size = norm(self.comm, y.array_r)
        if self._snes.getKSP().getConvergedReason() < 0 or not np.isfinite(size):
            return False
        self._shorten(y)
        if run.kind == "cg":
            return True
        if run.cap < 1 and not run.first:
            return False
        trial = base.state - y.array_r
        if run.kind == "coupled":
            self._lag(trial)
            return self._points.at(trial).size <= COUPLED_RATE * base.size
        change = self._change(trial)
        if run.first:
            return change <= -MODIFIED_GAIN / 2 * dot(self.comm, base.residual, y.array_r)
        return change <= run.rounding and self._points.at(trial).size <= MODIFIED_RATE * base.size

    def _change(self, state: Floats) -> float:
        """Return the change of the energy in J since the begin of the step."""
        run = self._now
        change = self._points.energy(state) - run.base.energy
        if not np.isfinite(change) or (abs(change) > run.rounding and run.residual > UNRESOLVED):
            return change
        mean_force = (self._points.residual(state) + run.base.residual) / 2
        return dot(self.comm, mean_force, state - run.base.state)

    def _renew(self, y: PETSc.Vec) -> None:
        """Solve for the step anew: a modified one by the tangent of this state, others by factors."""
        run = self._now
        if run.kind == "coupled":
            self._lag(run.base.state)
            self.factor.couple(None)
        if run.kind == "modified":
            self._assemble(run.base.state)
        run.kind = "cg" if run.kind == "modified" and self._krylov >= 2 else "newton"
        self._solve(y, 0.0)

    def _solve(self, y: PETSc.Vec, shift: float) -> None:
        self.factor.fill(shift)
        self.ladder.renew = self._now.kind == "newton"
        self._snes.getKSP().solve(self._snes.getFunction()[0], y)

    def _back(self, rhs: Floats) -> Floats:
        """Solve with the factors of the last step, or with what an option has put in their place."""
        if self._reuses:
            return self.factor.solve(rhs)
        right, solution = self._x.duplicate(), self._x.duplicate()
        right.array[:] = rhs
        self._snes.getKSP().solve(right, solution)
        return np.array(solution.array_r)

    def _descend(self, y: PETSc.Vec) -> None:
        """Let the shift grow until the step goes downhill."""
        run, ksp, reasons = self._now, self._snes.getKSP(), PETSc.KSP.ConvergedReason
        while True:
            reason = ksp.getConvergedReason()
            solved = reason > 0 or reason == reasons.DIVERGED_MAX_IT
            if solved and dot(self.comm, run.base.residual, y.array_r) > 0:
                return
            if self.ladder.exhausted:
                y.set(0.0)
                return
            self.ladder.enlarge()
            self._solve(y, self.ladder.shift)

    def _shorten(self, y: PETSc.Vec) -> None:
        """Take the part of the step that stretch bounds and contact allow."""
        run = self._now
        run.longest = largest(self.comm, float(np.abs(y.array_r).max(initial=0.0)))
        run.cap = self._cap(run.base.state, -y.array_r)
        y.scale(run.cap)

    def _cap(self, state: Floats, step: Floats) -> float:
        return self.model.largest_step(state, step, self.options.fraction_to_barrier)

    def _assemble(self, state: Floats) -> None:
        self.factor.assemble(state)
        self._stiffness = norm(self.comm, self.factor.scale)

    def _record(self, kind: str, step: float) -> None:
        run, now = self._now, time.perf_counter()
        row = NewtonStep(
            self.model.load.largest,
            run.residual,
            run.base.energy,
            self.ladder.shift if kind == "newton" else 0.0,
            step,
            kind,
            run.iterations,
            now - self._clock,
        )
        self._clock = now
        self._history.append(row)
        if self._log is not None:
            self._log(row)

    def _floor(self) -> float:
        """Return the residual's norm by rounding of the positions alone, once K is known.

        Close to the stretch bounds it would exceed any load, so that it is limited.
        """
        return min(self._rounding(), STAGNATED * self._now.reference)

    def _rounding(self) -> float:
        """Return the norm in N by which rounded positions may change the residual."""
        return 8 * float(np.finfo(float).eps) * self.model.skin.pattern.size * self._stiffness

    def _stuck(self, size: float) -> bool:
        """Return whether rounding limits the residual: Newton's whole step is negligible.

        Where stretching is far stiffer than bending, its rounding alone may exceed the load.

        Args:
            size: Norm of the residual after the whole step; infinite if it was shortened.
        """
        run = self._now
        exact = run.kind == "newton" and self.ladder.shift == 0
        if not exact or run.residual > UNRESOLVED or size <= STUCK * run.base.size:
            return False
        small = run.longest <= RESOLVED * self.model.skin.pattern.size
        return small and run.base.size <= self._rounding()

    def _correct(self, old: Point, new: Point, fraction: float) -> Point:
        """Solve for the residual beyond its linear prediction: the second-order correction."""
        for _ in range(CORRECTIONS):
            if new.size <= RELAXED * old.size:
                break
            change = -self._back(new.residual - (1 - fraction) * old.residual)
            # Contact may lie between two states whose energies tell nothing of it.
            if self.model.contact is not None and self._cap(new.state, change) < 1:
                break
            state = new.state + change
            if not self._points.energy(state) < new.energy:
                break
            new = self._points.at(state)
        return new

    def _escape(self, saddle: Point) -> Point:
        """Return a lower point along the softest mode of a saddle."""
        run = self._now
        run.escapes += 1
        self.ladder.shift, self.ladder.definite = 0.0, False
        mode = softest_mode(self.model, self.factor, saddle.residual, run.escapes)
        self.factor.usable = False
        fraction = self._cap(saddle.state, mode)
        while fraction > SMALLEST_ESCAPE:
            state = saddle.state + fraction * mode
            if self._points.energy(state) - saddle.energy < -run.rounding:
                self._record("escape", fraction)
                return self._points.at(state)
            fraction /= 2
        return saddle

    def _lag(self, state: Floats) -> None:
        """Let friction have the normal forces of a state; energy and residual are by these."""
        self._points.forget()
        if self.model.contact is not None:
            self.model.contact.lag_friction(state)

    def _lagged(self, point: Point, before: Point | None) -> Point:
        """Return the point with friction by the normal forces of its own state.

        Where these overshoot, the point half way from the one before may be nearer to equilibrium:
        without it strong friction goes to and fro between two states.
        """
        if not self.model.slides:
            return point
        self._lag(point.state)
        found = self._points.at(point.state)
        if before is None or found.size <= OVERSHOT * before.size:
            return found
        middle = (before.state + point.state) / 2
        self._lag(middle)
        half = self._points.at(middle)
        if half.size < OVERSHOT * found.size and np.isfinite(half.energy):
            return half
        self._lag(point.state)
        return self._points.at(point.state)
