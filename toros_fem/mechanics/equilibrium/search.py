"""Where a solve for an equilibrium starts, and the ways that it tries one after the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import largest, norm, on_first_rank, together
from toros_fem.base.validation import Bools, Floats, real_numbers
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import (
    FOLDED,
    Condition,
    Equilibrium,
    PathPoint,
    condition_of,
    critical_load,
    folds,
    may_snap,
    readings,
)
from toros_fem.mechanics.equilibrium.iteration import NO_NUMBER, STAGNATED, NewtonStep
from toros_fem.mechanics.equilibrium.newton import Attempt, Attempts, Newton
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.meshes.pattern import FLAT, Pattern
from toros_fem.meshes.triangles import harmonic_extension

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
FLAT_SKIN, OPENING, LOWERED = 0.2, 0.4, 1.7
# Largest number of steps by which bodies and supports are carried, and the shortest of them, over
# what is left of the way.
CARRIES, SHORTEST_CARRY = 200, 1e-4
# Until a level fails, a solve of at most this many steps makes the next increment four times as
# large.
EASY = 10
# Motion in differences of the residual, over the distance of contact or the thickness.
PROBE = 1e-3
# Fraction of the distance to the stretch bounds that a step may use up.
USED = 0.9
# Fraction of the bounds above which a triangle is relaxed.
RELAXED = 0.95
# Number of relaxations, each over one more ring of triangles around.
ROUNDS = 8
DIVERGED = PETSc.SNES.ConvergedReason
# Why a solve found nothing, by PETSc's reason; the last six where an option chose its method.
WHY = {
    int(DIVERGED.DIVERGED_MAX_IT): "Newton's method took {max_steps} steps without converging",
    int(DIVERGED.DIVERGED_LINE_SEARCH): "no step lowered the energy any more",
    int(DIVERGED.DIVERGED_INNER): "the stationary state is not stable",
    int(DIVERGED.DIVERGED_FUNCTION_DOMAIN): (
        "surfaces overlap at the start, or triangles leave the stretch bounds there"
    ),
    NO_NUMBER: "forces are no numbers any more",
    int(DIVERGED.DIVERGED_LINEAR_SOLVE): "the linear solver that an option chose failed",
    int(DIVERGED.DIVERGED_FUNCTION_COUNT): "the limit of an option on evaluations was reached",
    int(DIVERGED.DIVERGED_LOCAL_MIN): "the norm of the forces has a minimum that is not 0",
    int(DIVERGED.DIVERGED_TR_DELTA): "the trust region shrank to nothing",
    -13: "the step of an option's method leaves the stretch bounds",  # of the objective, PETSc 3.25
    -14: "the step of an option's method leaves the stretch bounds",
}


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
            level = 1.0 if part == 1 else gone + part * (1 - gone)
            model.set_load(begin.towards(end, level) if level < 1 else end)
            attempt = self.attempts(moved, trial=self.trial or level < 1)
            outcome = attempt.outcome
            if attempt.converged and level == 1:
                return ContinuationResult(attempt.state, 1.0, outcome)
            if attempt.converged:
                state, gone, longest = attempt.state, level, min(1.0, 4 * longest)
            else:
                longest = part / 4
            if longest < SHORTEST_CARRY:
                break
        model.set_load(end)
        return ContinuationResult(state, None, outcome)


@dataclass(frozen=True, eq=False)
class ContinuationResult:
    """Last equilibrium of a continuation.

    Attributes:
        state: The last equilibrium, or the start if there is none.
        load_factor: Its level; None if there is no equilibrium.
        outcome: Converged reason of SNES of the last attempt.
    """

    state: Floats
    load_factor: float | None
    outcome: int


class PrescribedDisplacement:
    """Displacement of the fixed components of a state to their prescribed positions.

    Moved alone, they would stretch the triangles next to them by the whole displacement. So the
    free components follow by the harmonic extension over the flat panels, each component by itself:
    on a strip that is pulled this is the exact solution. The pattern is whole on every rank, so
    that each computes the same.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._solvers: list[Callable[[Floats], Floats]] = []  # made when something first moves

    def __call__(self, state: Floats, load: Load) -> Floats:
        """Return the state with its fixed components where a load has them (collective).

        A tile follows its mean deformation as a whole.
        """
        model, skin = self._model, self._model.skin
        fixed = ~model.free
        if model.images is not None:
            state = model.images.stretched(state, load)
        placed = np.where(fixed, self.goal(load), state)
        jump = model.positions(placed - state)
        distance = largest(skin.comm, float(np.abs(jump).max(initial=0.0)))
        if distance > FLAT * skin.pattern.size:
            spread = self._extension(skin.gather_vertices(jump))
            along = np.zeros_like(state)
            model.positions(along)[:] = spread[skin.owned_vertices]
            placed += np.where(fixed, 0.0, along)
        return placed

    def goal(self, load: Load) -> Floats:
        """Return the assembled state with all vertices displaced, and with the load's F̄."""
        model = self._model
        goal = model.assembled
        if load.displacement is not None:
            model.positions(goal)[:] += load.displacement[model.skin.owned_vertices]
        if model.images is not None and load.gradient is not None:
            model.images.set_mean_gradient(goal, load.gradient)
        return goal

    def follow(
        self,
        newton: Newton,
        state: Floats,
        end: Load,
        longest: float,
    ) -> tuple[Floats, float]:
        """Return a state in which bodies and supports have moved as far as nothing meets.

        They move straight, at most the part `longest` of the way to the load `end`; the part that
        is gone is returned too. The free components follow as the tangent predicts: what is in
        contact is pushed along (collective).
        """
        model, skin = self._model, self._model.skin
        contact, fixed = model.contact, ~model.free
        jump = np.where(fixed, self.goal(end) - state, 0.0)
        reach = largest(skin.comm, float(np.abs(jump).max(initial=0.0)))
        distance = model.composite.fabric.thickness
        poses: Floats = np.zeros((0, 6))
        left = poses
        if contact is not None:
            distance, poses = contact.distance, contact.poses.copy()
            left = -poses if end.poses is None else end.poses - poses
            reach = max(reach, contact.reach(left))
        if reach == 0:
            return state, 1.0
        probe = PROBE * distance / reach
        probe *= model.largest_step(state, probe * jump, USED, probe * left)
        residual = model.residual(state)
        if contact is not None:
            contact.poses[:] = poses + probe * left
        push = (model.residual(state + probe * jump) - residual) / probe
        if contact is not None:
            contact.poses[:] = poses
        step = longest * np.where(fixed, jump, newton.direction(state, residual + push))
        part = model.largest_step(state, step, USED, longest * left)
        return state + part * step, part * longest

    def _extension(self, jump: Floats) -> Floats:
        if not self._solvers:
            laplacian = self._model.skin.pattern.flat_laplacian()
            for fixed in self._model.supports.fixed.T:
                self._solvers.append(harmonic_extension(laplacian, fixed))
        return np.stack([f(jump[:, k]) for k, f in enumerate(self._solvers)], axis=1)


Way = Callable[[Search], ContinuationResult | None]


def reached(attempt: Attempt) -> ContinuationResult | None:
    """Return what an attempt under the whole load found; None where it found nothing."""
    return ContinuationResult(attempt.state, 1.0, attempt.outcome) if attempt.converged else None


def whole(end: ContinuationResult) -> ContinuationResult | None:
    """Return the end of a continuation; None where it stopped before."""
    return end if end.load_factor == 1.0 else None


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
    if model.volumes(model.assembled).sum() > FLAT_SKIN * sphere or factor <= LOWERED:
        return None
    attempt = search.attempt(model.assembled, load.scaled(factor))
    while attempt.converged and factor > 1:
        factor = max(1.0, factor / LOWERED)
        attempt = search.attempt(attempt.state, load.scaled(factor))
    return reached(attempt)


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
    attempt = search.attempt(search.model.assembled, rest)
    return whole(search.carry(attempt.state, rest)) if attempt.converged else None


def by_load(search: Search) -> ContinuationResult | None:
    """Raise the load on the assembled shape."""
    model, load, increment = search.model, search.load, FIRST_INCREMENT
    if not load:
        return None
    if load.largest:  # that of a pressure that strains by a few per cent
        small = 0.1 * model.composite.least_stiffness / model.skin.pattern.size
        increment = min(small / load.largest, 1 / 4)
    end = run_continuation(
        lambda state, fraction: search.attempt(state, load.scaled(fraction)),
        ContinuationResult(model.assembled, None, search.first.outcome),
        increment,
        search.newton.least_increment,
    )
    if end.load_factor is None:
        end = replace(end, state=search.start)
    search.failure = end
    return whole(end)


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


def run_continuation(
    attempt: Callable[[Floats, float], Attempt],
    start: ContinuationResult,
    increment: float,
    least: float,
) -> ContinuationResult:
    """Raise a load factor to 1, by solves from a state at a level.

    `start` holds a state, its level and outcome; `least` is the smallest increment, over the level
    reached or the first increment, whichever is larger.
    """
    state, load_factor, outcome = start.state, start.load_factor, start.outcome
    first, fastest = increment, 4
    while load_factor is None or load_factor < 1.0:
        level = min(1.0, (load_factor or 0.0) + increment)
        tried = attempt(state, level)
        outcome = tried.outcome
        if tried.converged:
            state, load_factor = tried.state, level
            increment *= fastest if tried.steps <= EASY else 2
            continue
        fastest = 2
        increment = (level - (load_factor or 0.0)) / 4
        if increment <= least * max(load_factor or 0.0, first):
            break
    return ContinuationResult(state, load_factor, outcome)


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
        end = way(search)
        if end is not None:
            return end
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
    equilibrium = _read(search, end, snapped, critical, log)
    before = origin if search.trial else None
    return replace(equilibrium, begin=begin, before=before)


def residual_at(model: SkinModel, newton: Newton, state: Floats) -> float:
    """Return the norm of the first variation over the applied load (collective)."""
    return norm(model.skin.comm, model.residual(state)) / newton.reference(state)


def sliding_at(model: SkinModel, state: Floats) -> Floats | None:
    """Return where the skin sticks at the end of a step; None without friction."""
    return None if model.contact is None else model.contact.end_step(state)


def same_design(model: SkinModel, first: Floats, second: Floats) -> bool:
    """Return whether two designs are the same, and of the same kind (collective)."""
    if first.shape[1:] != second.shape[1:]:
        return False
    return largest(model.skin.comm, float(np.abs(first - second).max(initial=0.0))) == 0


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


def success(load: Load, residual: float, condition: Condition) -> str:
    """Return the sentence for an equilibrium, with warnings: rounding, a crossed wall, a snap."""
    found = f"A stable equilibrium was found at {load}."
    if condition.sentences:
        found += f" {condition.sentences}"
    if residual > STAGNATED:
        found += f" Rounding leaves a residual of {residual:.0e} of the load."
    return found


def failure(
    model: SkinModel,
    end: ContinuationResult,
    load: Load,
    tried: Floats,
    *,
    max_steps: int,
    once: bool,
) -> str:
    """Return the sentence for a failure: why, how far the load came, the remedy (collective).

    `end` is the last equilibrium, and `tried` the state where the last attempt ended; `once` tells
    that there was one attempt at the full load, without continuation.
    """
    why = WHY.get(end.outcome, f"PETSc's SNES ended by reason {end.outcome}")
    why = why.format(max_steps=max_steps)
    bounds = model.composite.stated_bounds
    begin = f"No equilibrium inside the stretch bounds ({bounds}) was found at {load}, at "
    begin += f"once{'' if once else ' or by raising the load'}"
    begin += f": {why}."
    folded = folds(model, tried)
    if folded:
        begin += (
            f" Where the last attempt ended {folded} edges are folded by more than "
            f"{math.degrees(FOLDED):.0f} degrees: the skin collapses onto itself there. Give the "
            "solver a Contact. A skin sewn from flat layers needs hinged seams."
        )
    steps_failed = end.outcome != int(PETSc.SNES.ConvergedReason.DIVERGED_FUNCTION_DOMAIN)
    flat = model.images is not None  # a tile that is kept in its plane
    if steps_failed and model.composite.bending is None and not flat and not load.pressures.any():
        begin += (
            " A sheet without bending gives way to any compression. Give it bending, or, if it is "
            "closed, a pressure that tightens it."
        )
    if once:
        return f"{begin} Solve without trial = True, which also tries continuation."
    if end.load_factor is None:
        return (
            f"{begin} There was none under a lower load either; the state is the start. "
            "Check materials and supports, start from a neighbouring equilibrium, allow more "
            "steps, or refine the mesh."
        )
    use = model.bounds.worst(model.corners(end.state))
    return (
        f"{begin} The last equilibrium is at {load.scaled(end.load_factor)}, "
        f"{100 * end.load_factor:.3g} % of the load, where the most stretched triangle "
        f"uses {100 * use:.1f} % of the bounds. "
        "Lower the load to about that, stiffen the skin, or refine the mesh where it is most "
        "stretched."
    )


def start_state(model: SkinModel, start: Floats | None) -> Floats:
    """Return a start as owned unknowns, from these or from positions (n, 3) (collective).

    None is the state at rest. Where triangles leave the stretch bounds it is relaxed until they are
    inside; a ParameterError is raised if it cannot be.
    """
    skin, state = model.skin, model.assembled
    unknowns, nodes = state.shape, model.positions(state).shape
    with together(skin.comm):
        if start is not None:
            start = real_numbers("start", start, "unknowns, or positions (n, 3), in m")
            if start.shape not in (unknowns, nodes):
                raise ParameterError(
                    f"start has shape {start.shape}; on this rank it must be {unknowns}, the "
                    f"unknowns of this bending term, or {nodes}, positions."
                )
    if start is not None and start.ndim == 2:
        state = model.state_of(start)
    elif start is not None:
        state = start.copy()
        if model.contact is not None:
            state = model.contact.with_short_turns(start)
    use = model.bounds.worst_of_start(model.corners(state))
    if start is not None and 1 <= use < np.inf:
        inside = relaxed_start(model, skin.gather_vertices(model.positions(state)))
        if inside is not None:
            model.positions(state)[:] = inside[skin.owned_vertices]
            return state
    if not use < 1:
        bounds = model.composite.stated_bounds
        what, remedy = "start", f"Start from the assembled positions, or raise {bounds}."
        if start is None:
            what = "assembled shape, from which a solve starts,"
            remedy = f"Raise {bounds}, or fit the panels to the shape."
        raise ParameterError(
            f"the {what} leaves the stretch bounds: a triangle uses {use:.3g} of them, the "
            f"bound is 1. {remedy}"
        )
    return state


def relaxed_start(model: SkinModel, positions: Floats) -> Floats | None:
    """Return positions of all vertices inside the stretch bounds, or None (collective)."""
    pattern, fixed = model.skin.pattern, model.supports.fixed
    return on_first_rank(
        model.skin.comm, lambda: relaxed_into_bounds(pattern, model.composite, fixed, positions)
    )


def require_apart(model: SkinModel, state: Floats, load: Load, *, cold: bool) -> None:
    """Check that contact can act on a start, with bodies at their poses or where made."""
    model.set_load(load)
    refusal = model.refusal(state)
    if refusal is None:
        return
    if load.moves_bodies:  # they are moved in with the load
        model.set_load(load.scaled(0.0))
        if model.refusal(state) is None:
            return
    what, remedy = "start", "Start from the assembled positions, or from another equilibrium."
    if cold:
        what = "assembled shape, from which a solve starts,"
        remedy = "Make ground and bodies further away."
    raise ParameterError(f"contact cannot act on the {what}: {refusal}. {remedy}")


def relaxed_into_bounds(
    pattern: Pattern, composite: Composite, fixed: Bools, positions: Floats
) -> Floats | None:
    """Return a shape inside the stretch bounds, near a shape that leaves them in some triangles.

    A shape that is interpolated from a coarser mesh stretches the few triangles most that lie
    across a kink of it. Around these the map from the flat panels is made harmonic. Of two
    materials the wider bounds count: into the narrower ones a solve takes the shape by itself.
    Fixed components, (n, 3), keep their positions. None where the bounds cannot be met in this way.
    """
    triangles = pattern.triangles
    widest, wrinkles = composite.widest_bounds, composite.membrane.relaxed
    bounds = StretchBounds(MPI.COMM_SELF, pattern.corners, *widest, wrinkles=wrinkles)
    found, laplacian = np.array(positions), None
    for rings in range(1, ROUNDS + 1):
        use = bounds.use(found[triangles])
        if use.max(initial=0.0) <= RELAXED:
            break
        if laplacian is None:
            laplacian = pattern.flat_laplacian()
        near = np.zeros(len(found), dtype=bool)
        near[triangles[~(use <= RELAXED)]] = True
        for _ in range(rings):
            near[triangles[near[triangles].any(axis=1)]] = True
        for k in range(3):
            extend = harmonic_extension(laplacian, ~near | fixed[:, k])
            found[:, k] = extend(found[:, k])
    return found if bounds.worst(found[triangles]) < 1 else None
