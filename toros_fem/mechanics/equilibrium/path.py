"""The path of equilibria through a state: its direction, its next singular point, a jump on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
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
# Part of the motion that the tangent at the end of a path predicts, where the skin does not jump.
# Behind the jumps of a roof, a lid and an arch it predicts 0.16 at most (docs/solver.md).
EXPLAINED = 0.5


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A stable equilibrium of one density and one load, by its owned unknowns."""

    density: Floats
    load: Load
    state: Floats


def may_snap(model: SkinModel, factor: TangentFactor, begin: PathPoint, end: PathPoint) -> bool:
    """Return whether the skin may jump between two equilibria (collective).

    Behind a jump the path leads elsewhere: its tangent predicts little of the motion. Near a limit
    point it predicts too much. Model and factors are those of the end, before and after.
    """
    comm, back = model.skin.comm, begin.state - end.state
    farthest = largest(comm, float(np.abs(back).max(initial=0.0)))
    if farthest <= SAME * model.skin.pattern.size:
        return False
    # Prescribed positions move the fixed components without any force on the free ones.
    with_supports = np.where(model.free, end.state, begin.state)
    predicted = motion_to(model, factor, end, replace(begin, state=with_supports))
    back = back * model.free
    return not dot(comm, predicted, back) >= EXPLAINED * dot(comm, back, back)


def critical_load(model: SkinModel, factor: TangentFactor, at: PathPoint) -> float | None:
    """Return the factor on the load at which the tangent K is expected to be singular (collective).

    The softest mode φ of K and the change of φ·Kφ along the path of equilibria under load give a
    linear estimate. It is exact to first order at a bifurcation. At a limit point the curvature
    falls as a root, so that the true distance is about half of the estimated one. K, its factors
    and the model are those of the point. The result is within NEAR of 1; None if it is not, or if
    supports or bodies move.
    """
    if not at.load or at.load.displacement is not None or at.load.moves_bodies:
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
