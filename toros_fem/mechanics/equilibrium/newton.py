"""Stable equilibria near a start by PETSc's SNES, and its options with the prefix "toros_"."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.errors import ParameterError, TorosWarning
from toros_fem.base.fenicsx import option_used
from toros_fem.base.keys import Count, Fraction, In, Table, key
from toros_fem.base.mpi import warn_together
from toros_fem.base.validation import Floats
from toros_fem.mechanics.equilibrium.iteration import (
    COUPLED_ITERATIONS,
    COUPLED_LEFT,
    INEXACT,
    NewtonIteration,
    NewtonStep,
    Reason,
    load_at,
)
from toros_fem.mechanics.equilibrium.linear_solver import PREFIX, ShiftedCholesky
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds
from toros_fem.mechanics.terms.model import SkinModel

# Residual over the applied load at which a trial's objective is known well enough.
TRIAL_TOLERANCE = 1e-6
# PETSc's limits on failed line searches and linear solves: the hooks decide.
UNLIMITED = 1_000_000
# Kinds of steps near the end that cost little.
OLDER = ("modified", "coupled")
# Each round is solved for up to this residual over the load.
APPROACHED, ROUNDS = 0.1, 60
# The line search halves a step until the energy falls. PETSc's fits of higher order, and its test
# of sufficient decrease, take the slope of an objective with the wrong sign.
DEFAULTS = {
    "snes_linesearch_type": "bt",
    "snes_linesearch_order": 1,
    "snes_linesearch_alpha": 0.0,
    "snes_linesearch_minlambda": 1e-10,
}


class NewtonOptions(Table):
    """Tolerance and limits of the equilibrium solver.

    Raises:
        ParameterError: An option is outside its bounds.
    """

    tolerance: Annotated[float, In(at_least=1e-15, at_most=1e-2)] = key(
        1e-10, "residual over the applied load at which a state counts as equilibrium"
    )
    max_steps: Count = key(240, "largest number of Newton steps for one load level")
    fraction_to_barrier: Annotated[float, In(above=0, at_most=0.99)] = key(
        0.5, "largest fraction of the distance to the stretch bounds that one step takes"
    )
    min_increment: Fraction = key(
        0.05, "smallest increment of a continuation, over the level reached, before it gives up"
    )


class Newton:
    """Newton's method on E from a start, at the load and density set in the model.

    SNES is of type "newtonls": KSP solves (K + τM) p = r, and the line search `bt` halves the step
    until the energy falls. Its hooks, a `NewtonIteration`, hold what PETSc has not, as
    docs/theory/equilibrium.md lists. A state is an equilibrium where K is positive definite and the
    residual is below the tolerance times the applied load, or below the rounding of the positions.
    Where rounding keeps the residual from falling further, STAGNATED is enough, or UNRESOLVED where
    Newton's step is negligible.

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
        self._iteration = NewtonIteration(model, options.fraction_to_barrier, log)
        self.factor, self.ladder = self._iteration.factor, self._iteration.ladder
        self._x, force = self.factor.matrix.createVecs()
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
        self._iteration.hook(snes, force)
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
        self._iteration.forget(near=near)
        begin, left = into_bounds(self, start, max_steps or self.max_steps, near=near)
        near &= begin is start
        state, outcome = self.minimise(begin, tolerance, left, near=near, finish=not trial)
        rows = tuple(self._iteration.history)
        return Attempt(state, outcome, len(rows), rows)

    def minimise(
        self, start: Floats, tolerance: float, max_steps: int, *, near: bool, finish: bool
    ) -> tuple[Floats, int]:
        """Run the SNES once; return where it ended, and PETSc's reason (collective)."""
        iteration = self._iteration
        if not iteration.begin(start, tolerance, finish=finish, predict=near):
            return start, int(Reason.DIVERGED_FUNCTION_DOMAIN)
        self._snes.setTolerances(rtol=tolerance, max_it=max_steps)
        self._x.array[:] = start
        with refusals():
            self._snes.solve(None, self._x)
        if not self._told:
            self._told = True
            tell_unused(iteration.comm)
        state, outcome = np.array(self._x.array_r), int(self._snes.getConvergedReason())
        # Another type of SNES, chosen by an option, may have stopped at a saddle.
        if outcome > 0 and finish and not iteration.proven and not self.stable(state):
            outcome = int(Reason.DIVERGED_INNER)
        return state, outcome

    def reference(self, state: Floats) -> float:
        """Return the force in N by which residuals are measured, as `load_at`."""
        return load_at(self.model, state)

    def direction(self, state: Floats, residual: Floats) -> Floats:
        """Return Newton's direction against a residual in N, with the tangent at a state."""
        self._iteration.assemble(state)
        self.ladder.reset(near=False)  # the last solve may have failed far away
        self.ladder.factorise()
        return -self.factor.solve(residual)

    def stable(self, state: Floats) -> bool:
        """Return whether the tangent at a state is positive definite; leaves it factorised."""
        return self._iteration.stable(state)


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


@dataclass(frozen=True, eq=False)
class Attempt:
    """Result of one solve at one level.

    Attributes:
        state: Owned unknowns where it ended.
        outcome: Converged reason of SNES: above 0 the state is an equilibrium.
        steps: Number of steps.
        history: One row for each step, and the row that ends the solve.
    """

    state: Floats
    outcome: int
    steps: int
    history: tuple[NewtonStep, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the state is an equilibrium."""
        return self.outcome > 0


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
        attempt = self._solver(start, near=self._near, max_steps=max_steps, trial=trial)
        self._near = attempt.converged
        self.history.extend(attempt.history)
        self.last = attempt.state
        return attempt

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


@contextmanager
def with_defaults() -> Iterator[None]:
    """Give the line search its defaults, where the user has not set them, in the block."""
    options = PETSc.Options(PREFIX)
    lacking = {name: value for name, value in DEFAULTS.items() if not options.hasName(name)}
    for name, value in lacking.items():
        options[name] = value
    try:
        yield
    finally:
        for name in lacking:
            options.delValue(name)


@contextmanager
def given_options(text: str) -> Iterator[None]:
    """Add options to PETSc's database in the block, as the variable PETSC_OPTIONS would.

    Raises:
        ParameterError: One of them has no value of an option, or another prefix.
    """
    options = PETSc.Options()
    before = options.getAll()
    options.insertString(text)
    added = [
        name for name, value in options.getAll().items() if (name, value) not in before.items()
    ]
    try:
        others = [name for name in added if not name.startswith(PREFIX)]
        words = [word for word in text.split() if word.startswith("-")]
        if others or (text.strip() and not words):
            raise ParameterError(
                f"PETSc's options {text!r} must each begin with -{PREFIX}, such as "
                f"-{PREFIX}snes_monitor or -{PREFIX}snes_max_it 100."
            )
        yield
    finally:
        for name in added:
            options.delValue(name)
            if name in before:
                options[name] = before[name]


@contextmanager
def refusals() -> Iterator[None]:
    """Turn an error of PETSc in the block into a ParameterError that names the options.

    What a hook raised passes as it is.
    """
    try:
        yield
    except PETSc.Error as error:
        if error.__cause__ is not None:
            raise error.__cause__ from None
        given = PETSc.Options(PREFIX).getAll()
        if not given:
            raise
        named = ", ".join(f"-{PREFIX}{name} {value}".strip() for name, value in given.items())
        lines = str(error).splitlines()
        raise ParameterError(
            f"PETSc refuses one of the options {named}: {lines[-1].split('] ')[-1]}. "
            "Options and values are in docs/reference/petsc_options.md."
        ) from None


def tell_unused(comm: MPI.Comm) -> None:
    """Warn of options with the prefix that nothing has asked for, once a solve is done."""
    names = [f"{PREFIX}{name}" for name in PETSc.Options(PREFIX).getAll()]
    by_rank = comm.allgather([f"-{name}" for name in names if not option_used(name)])
    unused = [name for name in by_rank[0] if all(name in others for others in by_rank)]
    if unused:
        warn_together(
            comm,
            f"nothing uses the PETSc options {', '.join(unused)}: a misspelling, or an option of "
            "another solver. Options are in docs/reference/petsc_options.md.",
            TorosWarning,
        )
