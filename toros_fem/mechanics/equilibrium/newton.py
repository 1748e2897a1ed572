"""Stable equilibria near a start by PETSc's SNES, with what skins need in its hooks."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import Attempt, NewtonStep
from toros_fem.mechanics.equilibrium.direction import (
    COUPLED_ITERATIONS,
    COUPLED_LEFT,
    INEXACT,
    Direction,
)
from toros_fem.mechanics.equilibrium.iteration import (
    NO_NUMBER,
    RESOLVED,
    STAGNATED,
    STUCK,
    UNRESOLVED,
    Point,
    SolveState,
)
from toros_fem.mechanics.equilibrium.linear_solver import ShiftedCholesky, TangentFactor
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.petsc_options import (
    PREFIX,
    refusals,
    tell_unused,
    with_defaults,
)
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds

# Residual over the applied load at which a trial's objective is known well enough.
TRIAL_TOLERANCE = 1e-6
# PETSc's limits on failed line searches and linear solves: the hooks decide.
UNLIMITED = 1_000_000

# Kinds of steps near the end that cost little.
OLDER = ("modified", "coupled")

Reason = PETSc.SNES.ConvergedReason

# Each round is solved for up to this residual over the load.
APPROACHED, ROUNDS = 0.1, 60


class Newton:
    """Newton's method on E from a start, at the load and density set in the model.

    SNES is of type "newtonls": KSP solves (K + τM) p = r, and the line search `bt` halves the step
    until the energy falls. The hooks hold what PETSc has not, as docs/theory/equilibrium.md lists
    them. A state is an equilibrium where K is positive definite and the residual is below the
    tolerance times the applied load, or below the rounding of the positions. Where rounding keeps
    the residual from falling further, STAGNATED is enough, or UNRESOLVED where Newton's step is
    negligible.

    Attributes:
        factor: The factorised tangent; after success it is that at the equilibrium.
        ladder: Its shift.
        tolerance, max_steps: Those of the options, or of PETSc's options.
        least_increment: Of a continuation.
    """

    def __init__(
        self,
        model: SkinModel,
        options: NewtonOptions,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self.model, self.least_increment = model, options.min_increment
        self._at = at = SolveState(model, options.fraction_to_barrier, log)
        self.factor, self.ladder = at.factor, at.ladder
        self._x, self._f = at.factor.matrix.createVecs()
        self._snes = snes = PETSc.SNES().create(model.skin.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setType(PETSc.SNES.Type.NEWTONLS)
        snes.setTolerances(rtol=options.tolerance, atol=0.0, stol=0.0, max_it=options.max_steps)
        snes.setMaxStepFailures(UNLIMITED)
        snes.setMaxLinearSolveFailures(UNLIMITED)
        self._set_up_ksp()
        with refusals(), with_defaults():
            snes.setFromOptions()
        self.tolerance, _, _, self.max_steps = snes.getTolerances()
        self._direction = Direction(at, snes)
        self._landing = Landing(at, self._direction, snes)
        self._hang_hooks()
        self._told = False  # which options are unused

    def _set_up_ksp(self) -> None:
        """Choose CG, or GMRES with friction, and the factors as preconditioner."""
        ksp, symmetric = self._snes.getKSP(), not self.model.slides
        ksp.setType(PETSc.KSP.Type.CG if symmetric else PETSc.KSP.Type.GMRES)
        if not symmetric:
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
            ksp.setGMRESRestart(COUPLED_ITERATIONS)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=INEXACT if symmetric else COUPLED_LEFT)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(ShiftedCholesky(self.ladder))

    def _hang_hooks(self) -> None:
        """Give PETSc the hooks, in the order in which a step calls them.

        It holds them out of sight of Python's garbage collector, with some versions for ever: hence
        the weak references.
        """
        snes, matrix = self._snes, self.factor.matrix
        ksp = snes.getKSP()
        own = self._direction.own_factors
        read = matrix if own else self.factor.assembled_matrix()
        snes.setFunction(_weakly(self._residual), self._f)
        snes.setJacobian(_weakly(self._direction.tangent), matrix, read)
        if self._direction.reuses:  # a trust region has a test of its own, which cannot hold ours
            ksp.setConvergenceTest(_weakly(self._direction.end_iteration))
        snes.setLineSearchPreCheck(_weakly(self._direction.limit))
        snes.setObjective(_weakly(self._merit))
        snes.setConvergenceTest(_weakly(self._landing.end_step))

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
    ) -> Attempt:
        """Find a stable equilibrium near a start; the tangent is factorised there (collective).

        Args:
            start: Owned unknowns.
            near: Whether the start is the equilibrium of a neighbouring design or load.
            max_steps: Largest number of steps; None takes that of the options.
            trial: Whether TRIAL_TOLERANCE is enough, without proof that the state is stable, and
                without factors there.
        """
        tolerance = max(self.tolerance, TRIAL_TOLERANCE) if trial else self.tolerance
        self._at.forget(near=near)
        begin, left = into_bounds(self, start, max_steps or self.max_steps, near=near)
        near &= begin is start
        state, outcome = self.minimise(begin, tolerance, left, near=near, finish=not trial)
        rows = tuple(self._at.history)
        return Attempt(state, outcome, len(rows), rows)

    def minimise(
        self, start: Floats, tolerance: float, max_steps: int, *, near: bool, finish: bool
    ) -> tuple[Floats, int]:
        """Run the SNES once; return where it ended, and PETSc's reason (collective)."""
        at = self._at
        if not at.begin(start, tolerance, finish=finish, predict=near):
            return start, int(Reason.DIVERGED_FUNCTION_DOMAIN)
        self._snes.setTolerances(rtol=tolerance, max_it=max_steps)
        self._x.array[:] = start
        with refusals():
            self._snes.solve(None, self._x)
        if not self._told:
            self._told = True
            tell_unused(at.comm)
        state, outcome = np.array(self._x.array_r), int(self._snes.getConvergedReason())
        # Another type of SNES, chosen by an option, may have stopped at a saddle.
        if outcome > 0 and finish and not at.proven and not self.stable(state):
            outcome = int(Reason.DIVERGED_INNER)
        return state, outcome

    def reference(self, state: Floats) -> float:
        """Return the force in N by which residuals are measured, as `Iteration.load_at`."""
        return self._at.load_at(state)

    def direction(self, state: Floats, residual: Floats) -> Floats:
        """Return Newton's direction against a residual in N, with the tangent at a state."""
        self._at.assemble(state)
        self.ladder.reset(near=False)  # the last solve may have failed far away
        self.ladder.factorise()
        return -self.factor.solve(residual)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        return self._at.stable(state)

    def _residual(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array_w[:] = self._at.points.near(x.array_r).residual

    def _merit(self, _: PETSc.SNES, x: PETSc.Vec) -> float:
        """Return the energy in J less that at the begin of the step."""
        at, state = self._at, x.array_r
        if at.points.same(state, at.base.state):
            return 0.0
        if at.kind == "coupled":  # friction has no potential
            return at.points.at(state).size - at.base.size
        return at.merit(state)


def _weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a method without keeping its object."""
    held = weakref.WeakMethod(method)

    def call(*given: Any) -> Any:
        found = held()
        assert found is not None
        return found(*given)

    return call


class Attempts:
    """Sequence of solves; each uses the factors of the one before if that converged.

    The first start is `near` if it is the equilibrium of a neighbouring design or load.

    Attributes:
        history: Rows of all of them.
        last: Where the last one ended.
    """

    def __init__(self, solver: Newton, *, near: bool = False) -> None:
        self._solver, self._near = solver, near
        self._factorisations = solver.factor.count
        self.history: list[NewtonStep] = []
        self.last: Floats | None = None

    def __call__(
        self, start: Floats, max_steps: int | None = None, *, trial: bool = False
    ) -> Attempt:
        """Solve once more; the arguments are those of `Newton` (collective)."""
        found = self._solver(start, near=self._near, max_steps=max_steps, trial=trial)
        self._near = found.converged
        self.history.extend(found.history)
        self.last = found.state
        return found

    @property
    def steps(self) -> int:
        """Number of Newton steps, each with the tangent at its state."""
        return sum(row.step > 0 and row.kind not in OLDER for row in self.history)

    @property
    def modified_steps(self) -> int:
        """Number of modified Newton steps, with older factors and no more than a few products."""
        return sum(row.kind in OLDER for row in self.history)

    @property
    def factorisations(self) -> int:
        """Number of factorisations so far, retries with a shift included."""
        return self._solver.factor.count - self._factorisations


def into_bounds(newton: Newton, start: Floats, max_steps: int, *, near: bool) -> tuple[Floats, int]:
    """Return the start, or a state near it inside the bounds of the density, and the steps left.

    Another density may have had wider bounds. The bounds of the triangles outside are widened,
    then narrowed in rounds: the tangent predicts the motion by it, and Newton's steps correct
    that, as in an interior point method. From afar (not `near`) all bounds begin wide: narrow
    ones would cap every step of the whole skin (collective).
    """
    model, bounds, state = newton.model, newton.model.bounds, start
    if not isinstance(bounds, MixedBounds):
        return start, max_steps
    if not bounds.loosen(model.corners(start), everywhere=not near):
        return start, max_steps
    for _ in range(ROUNDS):
        if not bounds.loosened:
            break
        first = near and state is start
        state, outcome = newton.minimise(state, APPROACHED, max_steps, near=first, finish=False)
        max_steps = max(1, max_steps - newton.steps)
        if outcome <= 0:
            break
        state = _narrowed(newton, state, bounds)
    bounds.update()
    return state, max_steps


def _narrowed(newton: Newton, state: Floats, bounds: MixedBounds) -> Floats:
    model = newton.model
    if not newton.stable(state):
        bounds.narrow(model.corners(state), None)
        return state
    model.set_state(state)
    motion = -newton.factor.solve(bounds.push() * model.free)
    fraction = bounds.narrow(model.corners(state), model.corners(motion))
    return np.asarray(state + fraction * motion)


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
ITERATIONS = 20
# Length of the mode over the skin's size.
LENGTH = 0.01


class Landing:
    """The convergence test of the SNES, and what it does to the state before."""

    def __init__(self, at: SolveState, direction: Direction, snes: PETSc.SNES) -> None:
        self.at, self._direction, self._snes = at, direction, snes
        self._own = direction.newton
        self._absolute = snes.getTolerances()[1]

    def end_step(self, snes: PETSc.SNES, count: int, norms: tuple[float, float, float]) -> int:
        """Correct the state that the line search found, and test it.

        petsc4py 3.22 has no post-check of the line search, where PETSc would change a state.
        """
        at, x = self.at, snes.getSolution()
        found = point = at.points.at(x.array_r)
        if not np.isfinite(point.size):
            return NO_NUMBER
        outcome = None
        if count > 0 and self._own:
            outcome, point = self._advance(point)
        elif count > 0:
            at.record("newton", 1.0)
        at.base = point
        if outcome is None:
            outcome = self._judge(count)
        if at.base is not found:
            x.array[:] = at.base.state
            snes.getFunction()[0].array[:] = at.base.residual
            snes.setFunctionNorm(at.base.size)
        return outcome

    def _advance(self, found: Point) -> tuple[int | None, Point]:
        """Return why the solve ends, or None, and the point from which it goes on."""
        at, base = self.at, self.at.base
        moved = not at.points.same(found.state, base.state)
        fraction = at.cap * self._part(found) if moved else 0.0
        whole = fraction == 1.0 and at.exact
        stuck = self._stuck(found.size if fraction == 1.0 else np.inf)
        if stuck and not self._nearer(found):
            at.proven = True  # K is factorised there, unshifted
            at.record("end", 0.0)
            return int(Reason.CONVERGED_SNORM_RELATIVE), base
        at.record(at.kind, fraction)
        if stuck:
            return self._taken(found), found
        if not moved:
            return self._refused(), base
        new = found
        if at.kind == "cg" and at.residual <= UNRESOLVED and new.size > STUCK * base.size:
            at.factor.usable = False  # only the exact direction tells rounding
        if at.kind in ("newton", "cg"):
            new = self._correct(base, new, fraction)
        if at.kind != "coupled":
            new = self._lagged(new, base if fraction == 1.0 else None)
        # Newton's residual falls quadratically; that of a modified step by twice this factor.
        if whole or at.kind == "modified":
            at.rate = (2 if whole else 1) * new.size / base.size
        return None, new

    def _part(self, found: Point) -> float:
        at = self.at
        if at.points.same(found.state, at.base.state - at.step):
            return 1.0  # the difference of two states may have no digits left
        along = dot(at.comm, at.base.state - found.state, at.step)
        return along / dot(at.comm, at.step, at.step)

    def _refused(self) -> int | None:
        """Return why the solve ends where a step was refused; None if it goes on."""
        at = self.at
        if at.kind != "newton":  # rounding, or a barrier that needs the exact direction
            at.factor.usable = False
            if at.kind == "coupled":
                at.lag(at.base.state)
            return None
        if at.residual <= STAGNATED and at.stable(at.base.state):
            at.proven = True
            return int(Reason.CONVERGED_SNORM_RELATIVE)
        if at.ladder.exhausted:
            return int(Reason.DIVERGED_LINE_SEARCH)
        at.ladder.enlarge()
        return None

    def _judge(self, count: int) -> int:
        """Return PETSc's reason at the point from which a step would begin."""
        at = self.at
        if at.residual <= max(at.tolerance, UNRESOLVED):
            at.measure()
        size = at.base.size
        if size <= max(at.tolerance * at.reference, self._floor(), self._absolute):
            at.proven = at.finish and at.stable(at.base.state)
            if at.proven or not at.finish or not self._own:
                at.record("end", 0.0)
                return int(Reason.CONVERGED_FNORM_RELATIVE)
            if at.escapes == ESCAPES:
                return int(Reason.DIVERGED_INNER)
            at.base = self._escape(at.base)
        if count >= self._snes.getTolerances()[3]:
            return int(Reason.DIVERGED_MAX_IT)
        return int(Reason.ITERATING)

    def _floor(self) -> float:
        """Return the residual's norm by rounding of the positions alone, once K is known.

        Close to the stretch bounds it would exceed any load, so that it is limited.
        """
        at = self.at
        return min(at.force_rounding(), STAGNATED * at.reference)

    def _stuck(self, size: float) -> bool:
        """Return whether rounding limits the residual: Newton's whole step is negligible.

        Where stretching is far stiffer than bending, its rounding alone may exceed the load. `size`
        is the norm after the whole step; infinite if it was shortened.
        """
        at = self.at
        if not at.exact or at.residual > UNRESOLVED or size <= STUCK * at.base.size:
            return False
        small = at.longest <= RESOLVED * at.model.skin.pattern.size
        return small and at.base.size <= at.force_rounding()

    def _nearer(self, found: Point) -> bool:
        """Return whether Newton's last step is worth a factorisation, though rounding is near.

        Where a mode is soft, a state whose residual is hardly above its rounding may be far from
        the equilibrium; and a residual that still falls is above it. With friction the residual
        after the step is not known yet.
        """
        at = self.at
        far = at.longest > at.tolerance * at.model.skin.pattern.size
        falls = found.size < (1.0 if far else FALLS) * at.base.size
        return falls and not at.model.slides

    def _taken(self, found: Point) -> int | None:
        """Return why the solve ends after Newton's last step; None if it leads to a saddle."""
        at = self.at
        at.base, at.proven = found, at.stable(found.state)
        if not at.proven:
            return None
        at.record("end", 0.0)
        return int(Reason.CONVERGED_SNORM_RELATIVE)

    def _correct(self, old: Point, new: Point, fraction: float) -> Point:
        """Solve for the residual beyond its linear prediction: the second-order correction."""
        at = self.at
        for _ in range(CORRECTIONS):
            if new.size <= RELAXED * old.size:
                break
            change = -self._direction.back(new.residual - (1 - fraction) * old.residual)
            # Contact may lie between two states whose energies tell nothing of it.
            if at.model.contact is not None and at.cap_of(new.state, change) < 1:
                break
            state = new.state + change
            if not at.points.near(state).energy < new.energy:
                break
            new = at.points.at(state)
        return new

    def _escape(self, saddle: Point) -> Point:
        """Return a lower point along the softest mode of a saddle."""
        at = self.at
        at.escapes += 1
        at.ladder.shift = 0.0
        mode = softest_mode(at.model, at.factor, saddle.residual, at.escapes)
        at.factor.usable = False
        fraction = at.cap_of(saddle.state, mode)
        while fraction > SMALLEST_ESCAPE:
            state = saddle.state + fraction * mode
            if at.points.near(state).energy - saddle.energy < -at.rounding:
                at.record("escape", fraction)
                return at.points.at(state)
            fraction /= 2
        return saddle

    def _lagged(self, point: Point, before: Point | None) -> Point:
        """Return the point with friction by the normal forces of its own state.

        Where these overshoot, the point half way from the one before may be nearer to equilibrium:
        without it strong friction goes to and fro between two states.
        """
        at = self.at
        if not at.model.slides:
            return point
        at.lag(point.state)
        found = at.points.at(point.state)
        if before is None or found.size <= OVERSHOT * before.size:
            return found
        middle = (before.state + point.state) / 2
        at.lag(middle)
        half = at.points.at(middle)
        if half.size < OVERSHOT * found.size and np.isfinite(half.energy):
            return half
        at.lag(point.state)
        return at.points.at(point.state)


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
    for _ in range(ITERATIONS):
        mode = factor.solve(factor.scale * mode)
        mode /= norm(comm, mode)
    mode *= -1.0 if dot(comm, mode, residual) > 0 else 1.0
    return LENGTH * model.skin.pattern.size * mode
