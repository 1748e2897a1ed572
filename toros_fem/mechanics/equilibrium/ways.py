"""Ways to a hard equilibrium, tried one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    NewtonStep,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.diagnostics import condition_of, failure, success
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, readings
from toros_fem.mechanics.equilibrium.newton import Attempts, Newton
from toros_fem.mechanics.equilibrium.path import PathPoint, critical_load, may_snap
from toros_fem.mechanics.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.mechanics.skin.load import Load

# First increment where no pressure tells one, as a fraction of the load.
FIRST_INCREMENT = 1 / 16
# Largest number of steps of a trial.
FEW_STEPS = 40
# The same in contact, where layers that close limit one step after the other.
FEW_IN_CONTACT = 120
# Factor on `max_steps` for the last attempt, which starts where the first one stopped.
MORE_STEPS = 6
# A skin is flat where it encloses less than this fraction of a sphere of its area. It is opened by
# a pressure that, times its size over its stiffness, is OPENING, and lowered by LOWERED each time.
FLAT, OPENING, LOWERED = 0.2, 0.4, 1.7
# Largest number of steps by which bodies and supports are carried, and the shortest of them, over
# what is left of the way.
CARRIES, SHORTEST_CARRY = 200, 1e-4

DIVERGED = PETSc.SNES.ConvergedReason


@dataclass(eq=False)
class Search:
    """An equilibrium that is looked for.

    Attributes:
        newton: Solver from one start.
        prescribed: Motion of fixed components.
        density, load: Of the equilibrium.
        start: State to start from.
        near: Equilibrium that it starts from, of a neighbouring design or load; None for none.
        cold: Whether the start is the assembled shape.
        trial: Whether a state near an equilibrium is enough.
        direct: Whether to try once only.
        attempts: What was tried.
        first: Where the attempt at once ended.
        failure: What is left where no way reaches the equilibrium.
    """

    newton: Newton
    prescribed: PrescribedDisplacement
    density: Floats
    load: Load
    start: Floats
    near: Equilibrium | None
    cold: bool = False
    trial: bool = False
    direct: bool = False
    attempts: Attempts = field(init=False)
    first: Attempt = field(init=False)
    failure: ContinuationResult = field(init=False)

    def __post_init__(self) -> None:
        self.model = self.newton.model
        self.attempts = Attempts(self.newton, near=self.near is not None)

    @property
    def max_steps(self) -> int:
        """Largest number of steps of the first attempt."""
        few = FEW_STEPS if self.model.contact is None else FEW_IN_CONTACT
        return min(few, self.newton.max_steps) if self.trial else self.newton.max_steps

    def attempt(self, start: Floats, load: Load, max_steps: int | None = None) -> Attempt:
        """Solve once from a state (collective)."""
        self.model.set_density(self.density)
        self.model.set_load(load)
        placed = self.prescribed(start, load)
        return self.attempts(placed, max_steps, trial=self.trial)

    def carry(self, state: Floats, begin: Load) -> ContinuationResult:
        """Move bodies and supports, step by step, and let the skin come to rest after each.

        Nothing passes through anything: where the skin is in the way it is pushed.
        """
        model, end, gone, longest = self.model, self.load, 0.0, 1.0
        outcome = int(DIVERGED.DIVERGED_LINE_SEARCH)
        model.set_density(self.density)
        for _ in range(CARRIES):
            model.set_load(begin.towards(end, gone))
            moved, part = self.prescribed.follow(self.newton, state, end, longest)
            # Nothing moves, and the solve has failed; or the stretch bounds end the way.
            if part > longest or (part < SHORTEST_CARRY and model.contact is None):
                break
            there = 1.0 if part == 1 else gone + part * (1 - gone)
            model.set_load(begin.towards(end, there) if there < 1 else end)
            found = self.attempts(moved, trial=self.trial or there < 1)
            outcome = found.outcome
            if found.converged and there == 1:
                return ContinuationResult(found.state, 1.0, outcome)
            if found.converged:
                state, gone, longest = found.state, there, min(1.0, 4 * longest)
            else:
                longest = part / 4
            if longest < SHORTEST_CARRY:
                break
        model.set_load(end)
        return ContinuationResult(state, None, outcome)


Way = Callable[[Search], ContinuationResult | None]


def reached(found: Attempt) -> ContinuationResult | None:
    """Return what an attempt under the whole load found; None where it found nothing."""
    return ContinuationResult(found.state, 1.0, found.outcome) if found.converged else None


def whole(found: ContinuationResult) -> ContinuationResult | None:
    """Return the end of a continuation; None where it stopped before."""
    return found if found.load_factor == 1.0 else None


def carried(search: Search) -> ContinuationResult | None:
    """Carry bodies and supports from where they are under the near load."""
    assert search.near is not None
    search.failure = search.carry(search.start, search.near.load)
    return whole(search.failure)


def opened(search: Search) -> ContinuationResult | None:
    """Open a flat skin by a larger pressure, and lower that.

    A pressure that hardly strains a flat skin crumples it: it stops in the first of many stable
    states. From the open skin crumples spread evenly, and the energy ends lower.
    """
    model, load = search.model, search.load
    pattern = model.skin.pattern
    if not (search.cold and load.pressure_alone):
        return None
    sphere = pattern.areas.sum() ** 1.5 / (6 * np.sqrt(np.pi))
    model.set_density(search.density)
    factor = OPENING * model.soft_modulus() / (load.largest * pattern.size)
    if model.volumes(model.assembled).sum() > FLAT * sphere or factor <= LOWERED:
        return None
    found = search.attempt(model.assembled, load.scaled(factor))
    while found.converged and factor > 1:
        factor = max(1.0, factor / LOWERED)
        found = search.attempt(found.state, load.scaled(factor))
    return reached(found)


def at_once(search: Search) -> ContinuationResult | None:
    """Apply the whole load to the start."""
    search.first = search.attempt(search.start, search.load, search.max_steps)
    search.failure = ContinuationResult(search.start, None, search.first.outcome)
    return reached(search.first)


def from_assembled(search: Search) -> ContinuationResult | None:
    """Apply the whole load to the assembled shape, where the start was another one."""
    if search.cold:
        return None
    return reached(search.attempt(search.model.assembled, search.load))


def from_rest(search: Search) -> ContinuationResult | None:
    """Let the skin come to rest with bodies where they were made, and carry them from there."""
    load = search.load
    if not load.moves_bodies:
        return None
    rest = replace(load, poses=np.zeros_like(load.poses))
    found = search.attempt(search.model.assembled, rest)
    return whole(search.carry(found.state, rest)) if found.converged else None


def by_load(search: Search) -> ContinuationResult | None:
    """Raise the load on the assembled shape."""
    model, load, increment = search.model, search.load, FIRST_INCREMENT
    if not load:
        return None
    if load.largest:  # that of a pressure that strains by a few per cent
        small = 0.1 * model.composite.least_stiffness / model.skin.pattern.size
        increment = min(small / load.largest, 1 / 4)
    found = run_continuation(
        lambda state, fraction: search.attempt(state, load.scaled(fraction)),
        ContinuationResult(model.assembled, None, search.first.outcome),
        increment,
        search.newton.least_increment,
    )
    if found.load_factor is None:
        found = replace(found, state=search.start)
    search.failure = found
    return whole(found)


def by_supports(search: Search) -> ContinuationResult | None:
    """Move supports on from where raising the load ended, in steps that the tangent predicts.

    Near the stretch bounds a motion that is spread over the flat panels leaves them at once.
    """
    if search.load.displacement is None:
        return None
    last = search.failure
    state = search.model.assembled if last.load_factor is None else last.state
    return whole(search.carry(state, search.load.scaled(last.load_factor or 0.0)))


def patiently(search: Search) -> ContinuationResult | None:
    """Take many steps from where the first attempt stopped: it may only be slow."""
    most = MORE_STEPS * search.newton.max_steps
    return reached(search.attempt(search.first.state, search.load, most))


# Without any one of these some case fails (docs/solver.md).
WAYS: tuple[Way, ...] = (
    opened,
    at_once,
    from_assembled,
    from_rest,
    by_load,
    by_supports,
    patiently,
)


def search_equilibrium(search: Search) -> ContinuationResult:
    """Return the equilibrium, or the last good state under a fraction of the load (collective)."""
    ways: tuple[Way, ...] = (at_once,) if search.direct else WAYS
    contact = search.model.contact is not None
    if contact and search.near is not None and search.load.moves_from(search.near.load):
        ways = (carried,)
    for way in ways:
        found = way(search)
        if found is not None:
            return found
    return search.failure


def settle(
    search: Search, begin: Floats | None, log: Callable[[NewtonStep | str], None] | None
) -> Equilibrium:
    """Search for an equilibrium, and read off what it is (collective).

    Friction begins from `begin`; `log` is called with a sentence where something is not as usual.
    """
    model, near = search.model, search.near
    if model.contact is not None:
        model.contact.begin_step(begin, search.load)
    end = search_equilibrium(search)
    origin = None
    if near is not None:
        origin = near.point if near.complete else near.before
    # Between two designs there is no path that a skin takes. Where bodies or supports push it
    # along, the path has been taken step by step. A path with friction is made of its steps. That
    # of a tile is not followed.
    if origin is not None and (
        not same_design(model, origin.density, search.density)
        or (model.contact is not None and search.load.moves_from(origin.load))
        or model.slides
        or model.images is not None
    ):
        origin = None
    snapped = critical = None
    if end.load_factor == 1.0 and not search.trial:
        point = PathPoint(search.density, search.load, end.state)
        if origin is not None:
            snapped = may_snap(model, search.newton.factor, origin, point)
        if origin is not None or not search.direct:
            critical = critical_load(model, search.newton.factor, point)
    found = _read(search, end, snapped, critical, log)
    before = origin if search.trial else None
    return replace(found, begin=begin, before=before)


def residual_at(model: SkinModel, newton: Newton, state: Floats) -> float:
    """Return the norm of the first variation over the applied load (collective)."""
    return norm(model.skin.comm, model.residual(state)) / newton.reference(state)


def sliding_at(model: SkinModel, state: Floats) -> Floats | None:
    """Return where the skin sticks at the end of a step; None without friction."""
    return None if model.contact is None else model.contact.end_step(state)


def same_design(model: SkinModel, one: Floats, two: Floats) -> bool:
    """Return whether two designs are the same, and of the same kind (collective)."""
    if one.shape[1:] != two.shape[1:]:
        return False
    return largest(model.skin.comm, float(np.abs(one - two).max(initial=0.0))) == 0


def _read(
    search: Search,
    end: ContinuationResult,
    snapped: bool | None,
    critical: float | None,
    log: Callable[[NewtonStep | str], None] | None,
) -> Equilibrium:
    model, state, load, attempts = search.model, end.state, search.load, search.attempts
    load_factor = end.load_factor or 0.0
    reached = load_factor == 1.0
    model.set_load(load.scaled(load_factor))
    state.setflags(write=False)
    seen, residual = readings(model, state), residual_at(model, search.newton, state)
    condition = condition_of(model, state, snapped, critical)
    if reached and condition.sentences and log is not None:
        log(condition.sentences)
    if reached and search.trial:
        reason = f"A state near an equilibrium was found at {load}; `finish` completes it."
    elif reached:
        reason = success(load, residual, condition)
    else:
        assert attempts.last is not None
        steps, once = search.max_steps, search.direct
        reason = failure(model, end, load, attempts.last, max_steps=steps, once=once)
    return Equilibrium(
        **seen,
        density=search.density,
        load=load,
        converged=reached,
        complete=reached and not search.trial,
        load_factor=load_factor,
        reason=reason,
        residual=residual,
        condition=condition,
        steps=attempts.steps,
        modified_steps=attempts.modified_steps,
        factorisations=attempts.factorisations,
        history=tuple(attempts.history),
        sliding=sliding_at(model, state),
    )
