"""The path of equilibria through a state: its direction, its next singular point, its breaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import Attempt
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.skin.load import Load

# Fraction of the skin's size by which two states may differ and be the same.
SAME = 1e-6
# A singular tangent within this fraction of the load is near.
NEAR = 0.05
# Change of the load by which the change of the softest curvature is measured, and largest motion
# by it over the skin's size.
LOAD_STEP, MOTION = 1e-3, 1e-4
# Inverse iterations for the softest mode.
ITERATIONS = 12
# The tangent at the end of a path predicts its begin up to EXPLAINED of the motion. Where Newton's
# method met negative curvature on its way, which tells of its guesses more than of the path, and
# from the middle of a path, the rest must be SMALL; also that of both ends' tangents together.
EXPLAINED, SMALL = 0.5, 0.15
# Halvings of the interval in which the state moves most. Where an interval that is NARROW still
# has LEAP of the whole motion, the state jumps there.
HALVINGS, NARROW, LEAP = 7, 1 / 16, 0.5
# A path is smooth where this many halvings have left less than SMOOTH of the whole motion.
SMOOTH_HALVINGS, SMOOTH = 2, 0.35


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A stable equilibrium of one density and one load, by its owned unknowns.

    Attributes:
        motion: Motion that its tangent predicts to what comes next on a path; None where it is not
            known.
    """

    density: Floats
    load: Load
    state: Floats
    motion: Floats | None = None

    def towards(self, other: PathPoint, fraction: float) -> tuple[Floats, Load]:
        """Return the density and the load a fraction of the way to another point."""
        density = self.density + fraction * (other.density - self.density)
        return density, self.load.towards(other.load, fraction)


def connect(
    model: SkinModel,
    newton: Newton,
    attempt: Callable[[Floats, Load], Attempt],
    begin: PathPoint,
    end: PathPoint,
    *,
    definite: bool,
) -> tuple[bool | None, PathPoint]:
    """Return whether the path between two equilibria jumps, and its end (collective).

    The model is left at the end's density and load, and the tangent there is factorised, before and
    after. `attempt` solves from a start under a load, which the model has; `definite` tells that
    there was no negative curvature on the way.
    """
    comm, size = model.skin.comm, model.skin.pattern.size

    def same(a: Floats, b: Floats) -> bool:
        return largest(comm, float(np.abs(a - b).max(initial=0.0))) <= SAME * size

    def distance(a: Floats, b: Floats) -> float:
        return norm(comm, (a - b) * model.free)

    rest = EXPLAINED if definite else SMALL
    if same(begin.state, end.state) or leads(model, newton.factor, end, begin, rest):
        return False, end
    if joins(model, newton, begin, end):
        return False, end

    def at(state: Floats, fraction: float) -> PathPoint:
        return PathPoint(*begin.towards(end, fraction), state)

    def straight(here: Floats, fraction: float, there: Floats, other: float) -> bool:
        return leads(model, newton.factor, at(here, fraction), at(there, other), SMALL)

    def between(start: Floats, fraction: float) -> Attempt:
        density, load = begin.towards(end, fraction)
        model.set_density(density)
        model.set_load(load)
        return attempt(start, load)

    jumps, reached = find_jump(distance, between, straight, begin, end)
    if not same(reached, end.state):
        end = PathPoint(end.density, end.load, reached)
    model.set_density(end.density)
    model.set_load(end.load)
    newton.stable(end.state)
    return jumps, end


def critical_load(model: SkinModel, factor: TangentFactor, at: PathPoint) -> float | None:
    """Return the factor on the load at which the tangent K is expected to be singular (collective).

    The softest mode φ of K and the change of φ·Kφ along the path of equilibria under load give a
    linear estimate. It is exact to first order at a bifurcation. At a limit point the curvature
    falls as a root, so that the true distance is about half of the estimated one. K, its factors
    and the model are those of the point. The result is within NEAR of 1; None if it is not, or if
    supports or bodies move.
    """
    held = at.load.displacement is not None or at.load.gradient is not None
    if not at.load or held or at.load.moves_bodies:
        return None
    comm, size = model.skin.comm, model.skin.pattern.size
    along = factor.solve(model.applied_load(at.state))  # dx/d(load factor)
    farthest = largest(comm, float(np.abs(along).max(initial=0.0)))
    step = min(LOAD_STEP, MOTION * size / max(farthest, 1e-300))
    weights = factor.scale.copy()
    mode: Floats = along
    for _ in range(ITERATIONS):
        length = norm(comm, mode)
        if not (np.isfinite(length) and length > 0):
            return None
        mode = factor.solve(np.asarray(weights * mode / length))
    now = dot(comm, mode, factor.multiply(mode))
    curvature = [0.0, 0.0]
    for k, sign in enumerate((-1, 1)):
        model.set_load(at.load.scaled(1 + sign * step))
        factor.assemble(at.state + sign * step * along)
        curvature[k] = dot(comm, mode, factor.multiply(mode))
    model.set_load(at.load)
    factor.assemble(at.state)
    change = (curvature[1] - curvature[0]) / (2 * step)
    if not (np.isfinite(change) and abs(now) <= NEAR * abs(change)):
        return None
    return 1 - now / change


def leads(
    model: SkinModel, factor: TangentFactor, here: PathPoint, there: PathPoint, rest: float
) -> bool:
    """Return whether the tangent at a point of a path predicts another one (collective).

    Across a jump it does not: the path behind the jump leads elsewhere. The prediction may leave
    the part `rest` of the motion over. Model and factors are those of `here`, before and after.
    """
    comm, chord = model.skin.comm, (there.state - here.state) * model.free
    predicted = _predicted(model, factor, here, there)
    return norm(comm, predicted - chord) <= rest * norm(comm, chord)


def joins(model: SkinModel, newton: Newton, begin: PathPoint, end: PathPoint) -> bool:
    """Return whether the tangents at both ends of a path predict the motion (collective).

    Their mean is the trapezoidal rule: its error falls with the third power of the motion, that of
    either one with the second. Each alone must explain the motion up to EXPLAINED: no jump is that
    small. Model and factors are those of the end before, and after a True; after a False they may
    be those of either end. Those of the begin are made where its motion is not known.
    """
    comm, chord = model.skin.comm, (end.state - begin.state) * model.free

    def explains(motion: Floats, rest: float) -> bool:
        return norm(comm, motion - chord) <= rest * norm(comm, chord)

    backward = -_predicted(model, newton.factor, end, begin)
    if not explains(backward, EXPLAINED):
        return False
    forward = begin.motion
    if forward is None:
        model.set_density(begin.density)
        model.set_load(begin.load)
        if not newton.stable(begin.state):
            return False
        forward = _predicted(model, newton.factor, begin, end)
    if not (explains(forward, EXPLAINED) and explains((forward + backward) / 2, SMALL)):
        return False
    if begin.motion is not None:
        return True
    model.set_density(end.density)
    model.set_load(end.load)
    return newton.stable(end.state)


def _predicted(
    model: SkinModel, factor: TangentFactor, here: PathPoint, there: PathPoint
) -> Floats:
    # Prescribed positions move the fixed components without any force on the free ones.
    with_supports = np.where(model.free, here.state, there.state)
    return motion_to(model, factor, here, replace(there, state=with_supports))


def motion_to(model: SkinModel, factor: TangentFactor, here: PathPoint, there: PathPoint) -> Floats:
    """Return the motion to another design and load that the tangent at a point predicts.

    The state of `there` is that of `here` with the supports where they are there; 0 is returned
    where it is not admissible. Model and factors are those of `here`, before and after
    (collective).
    """
    model.set_density(there.density)
    model.set_load(there.load)
    feasible = model.admits(there.state)
    motion = -factor.solve(model.residual(there.state)) if feasible else np.zeros_like(here.state)
    model.set_density(here.density)
    model.set_load(here.load)
    return motion


def find_jump(
    distance: Callable[[Floats, Floats], float],
    attempt: Callable[[Floats, float], Attempt],
    straight: Callable[[Floats, float, Floats, float], bool],
    begin: PathPoint,
    end: PathPoint,
) -> tuple[bool | None, Floats]:
    """Return whether the state jumps on the way between two equilibria, by halving (collective).

    The interval in which the state moves most is halved again and again. On a smooth path the
    motion in it halves too; at a jump it stays. Each solve starts from the equilibrium before, at
    a fraction of the way. Where the path leads `straight` from the middle to both ends of the
    interval, as its tangent there tells, there is no jump in it.

    Returns:
        Whether it jumps, None if a solve on the way fails; and the state that the path reaches at
        the end, which is another one where `end` was found past a jump that the path does not
        make.
    """
    low, high, left, right = 0.0, 1.0, begin.state, end.state
    middle, whole, reached = 0.5, distance(left, right), right
    for halving in range(1, HALVINGS + 1):
        found = attempt(left, middle)
        if not found.converged:  # solves next to a jump are hard: one nearer to the left side
            middle = (low + middle) / 2
            continue
        ends = (left, low), (right, high)
        if all(straight(found.state, middle, *other) for other in ends):
            return False, reached
        if distance(found.state, left) >= LEAP * distance(left, right):
            high, right = middle, found.state
        else:  # what lies right of the middle is reached from there
            again = attempt(found.state, high)
            if not again.converged:
                return None, reached
            low, left, right = middle, found.state, again.state
            reached = right if high == 1.0 else reached
        middle = (low + high) / 2
        if halving >= SMOOTH_HALVINGS and distance(left, right) <= SMOOTH * whole:
            return False, reached
    if high - low > NARROW:
        return None, reached
    return distance(left, right) >= LEAP * whole, reached
