"""Paths of equilibria, by pressure, by arc length or by volume."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil
from typing import Any, Literal

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import norm
from toros_fem.base.validation import (
    Floats,
    checked_floats,
    require_callable,
    require_choice,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.measures.metrics import Metric, check_metrics
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.newton import Attempt
from toros_fem.mechanics.equilibrium.search import ContinuationResult, run_continuation
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions, follow_arc, follow_volumes
from toros_fem.mechanics.paths.trace_point import TracePoint, measured_point
from toros_fem.mechanics.skin.load import Load, Pressure, load_of

PATHS = ("pressure", "arc-length", "volume")
Start = Floats | Equilibrium | None
Stop = Callable[[TracePoint], bool] | None

# Smallest increment between two loads, as a fraction of their difference.
LEAST_INCREMENT = 1 / 100
# Largest number of parts of the way to the next load, however far the skin is predicted to move.
MOST_PARTS = 10


def trace(
    solver: EquilibriumSolver,
    density: Floats,
    loads: Load | Pressure | Sequence[Load | Pressure],
    metrics: Sequence[Metric] = (),
    start: Start = None,
    *,
    by: Literal["pressure", "arc-length", "volume"] = "pressure",
    held: Load | None = None,
    stop: Stop = None,
    options: ArcLengthOptions | None = None,
) -> Iterator[TracePoint]:
    """Return an iterator over the equilibria along a path, found one by one (collective).

    By pressure, the stable equilibria under one load after the other. Where the skin snaps, the
    equilibrium depends on the path. So each is reached from the one before, at once or, where that
    fails, in smaller increments of the load. Only the first may start from the assembled skin, if
    no start is given.

    By arc length, one load factor scales pressures, dead forces and weight, and what is held stays
    beside them. The path goes on through limit points, where the load factor turns, and along
    unstable equilibria.

    By volume, the skin encloses one volume after the other, as a syringe prescribes it: the
    pressures of the start are scaled together, and may fall. A point is stable if the energy has a
    minimum at its volume; its `result.converged` says whether it has one at its pressure.

    Args:
        solver, density: As of `EquilibriumSolver.solve`.
        loads: By pressure, all loads in the order in which they act; numbers are pressures in Pa,
            which leave the rest of the load before. By arc length, the load at load factor 1. By
            volume, volumes in m³.
        metrics: Metrics to compute at each point.
        start: As for `EquilibriumSolver.solve`, for the first point; None starts from the assembled
            skin. By pressure, from an equilibrium the first one is reached as each from the one
            before. By volume it is an equilibrium under pressure.
        by: "pressure", "arc-length" or "volume".
        held: By arc length, a load that stays while the other is scaled; None holds none.
        stop: Called with each point, on every rank, with equal results; the path ends with the
            point for which it returns True. None follows the path to its end.
        options: Ends and density of a path by arc length; None takes the defaults.

    Raises:
        ParameterError: An option has no meaning on this path, no load acts, or there is friction on
            a path by arc length.
        EquilibriumError: While iterating: the path could not be followed further; the points before
            have been yielded.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_choice("by", by, PATHS)
    check_metrics(metrics)
    require_kind("options", options, (ArcLengthOptions, type(None)), "ArcLengthOptions, or None")
    if stop is not None:
        require_callable("stop", stop, "a function of a TracePoint, or None")
    if by != "arc-length":
        for name, value in (("options", options), ("held", held)):
            if value is not None:
                raise ParameterError(f'{name} belongs to a path by="arc-length"; leave it out.')
    if by == "pressure":
        path = follow_pressures(solver, density, _levels(solver, loads), metrics, start)
    elif by == "volume":
        density = solver.model.design.check(density)
        volumes, begin = _volumes(loads), _under_pressure(solver, start)
        path = follow_volumes(solver, density, volumes, metrics, begin)
    else:
        load, density = _scaled_load(solver, loads), solver.model.design.check(density)
        state = start.state if isinstance(start, Equilibrium) else start
        stays = None if held is None else load_of(held).on(solver.model)
        options = options or ArcLengthOptions()
        path = follow_arc(solver, density, load, metrics, state, options, stays)
    return _until(path, stop)


def _levels(solver: EquilibriumSolver, loads: Any) -> Sequence[Load | Pressure]:
    """Return the loads of a path, all checked before the first is solved for."""
    several = isinstance(loads, list | tuple) or np.ndim(loads) > 0
    if not several or not len(loads):
        raise ParameterError(
            f'loads = {shown(loads)}: a path by="pressure" needs all loads, or pressures in Pa, '
            "as a list, in the order in which they act."
        )
    levels: Sequence[Load | Pressure] = loads
    for level in levels:
        load_of(level).on(solver.model)
    return levels


def _volumes(volumes: Any) -> list[float]:
    """Return the volumes of a path by volume."""
    one_each = "positive numbers in m³, in the order in which they are taken"
    found = checked_floats("loads", volumes, one_each, lambda shape: len(shape) == 1)
    values = [*map(float, found)]
    for number, value in enumerate(values, 1):
        require_positive(**{f"volume {number}": value})
    return values


def _under_pressure(solver: EquilibriumSolver, start: Start) -> Equilibrium:
    """Return the start of a path by volume, checked to be an equilibrium that pressure fills."""
    if solver.model.slides:
        raise ParameterError(
            'friction depends on the path that the load takes: follow it by="pressure".'
        )
    if not isinstance(start, Equilibrium) or not start.pressure > 0:
        raise ParameterError(
            'a path by="volume" needs start=solver.solve(density, pressure), an equilibrium under '
            "pressure: its pressures are scaled until the skin encloses the volumes."
        )
    return start


def _scaled_load(solver: EquilibriumSolver, load: Any) -> Load:
    """Return the load of a path by arc length, checked to be one that a factor scales."""
    if solver.model.slides:
        raise ParameterError(
            'friction depends on the path that the load takes: follow it by="pressure".'
        )
    acting = load_of(load).on(solver.model)
    if not replace(acting, displacement=None, poses=None):
        raise ParameterError(
            "no load acts that a load factor could scale; give a pressure, a force or a weight."
        )
    return acting


def _until(path: Iterator[TracePoint], stop: Stop) -> Iterator[TracePoint]:
    for point in path:
        yield point
        if stop is not None and stop(point):
            return


def follow_pressures(
    solver: EquilibriumSolver,
    density: Floats,
    loads: Sequence[Load | Pressure],
    metrics: Sequence[Metric],
    start: Floats | Equilibrium | None,
    largest_motion: Callable[[], float] | None = None,
) -> Iterator[TracePoint]:
    """Yield the equilibria under one load after the other, as of `trace` (collective).

    Where the tangent predicts that the skin moves by more than the largest motion between two of
    them, in m as of `_predicted_motion`, there are more, at equal parts of the way.
    """
    last = start if isinstance(start, Equilibrium) else None
    for load in loads:
        if last is None:
            last = solver.solve(density, load, start)
            yield measured_point(solver, last, metrics)
            continue
        # Of a pressure alone the rest of the load stays.
        given = load if isinstance(load, Load) else replace(last.load, pressure=load)
        end, towards = given.on(solver.model), None
        while towards is not end:
            towards = end
            if largest_motion is not None:
                motion = _predicted_motion(solver, last, density, end)
                towards = _part_of_way(last.load, end, motion, largest_motion())
            last = _continue(solver, density, last, towards)
            yield measured_point(solver, last, metrics)


def _predicted_motion(
    solver: EquilibriumSolver, last: Equilibrium, density: Floats, load: Load
) -> float:
    """Return how far the skin is expected to move to a load (collective).

    It is the root of the sum of squares over all vertices, in m; 0 where nothing is predicted:
    moved supports or bodies carry the skin along, and friction makes a path of steps.
    """
    model = solver.model
    if load.moves_from(last.load) or model.slides or last.density.shape[1:] != density.shape[1:]:
        return 0.0
    try:
        motion = solver.motion_to(density, load, last)
    except ParameterError:  # raised by all ranks or by none: a trial, or of another solver
        return 0.0
    return norm(solver.skin.comm, model.positions(motion))


def _part_of_way(begin: Load, end: Load, motion: float, largest: float) -> Load:
    """Return the end, or a load on the way to it, where the skin would move too far."""
    if motion <= largest:
        return end
    parts = MOST_PARTS if motion >= MOST_PARTS * largest else ceil(motion / largest)
    return begin.towards(end, 1 / parts)


def _continue(
    solver: EquilibriumSolver, density: Floats, before: Equilibrium, load: Load
) -> Equilibrium:
    """Return the equilibrium under a load, by smaller increments where one is too large."""
    begin, reached, last = before.load, before, before

    def attempt(_: Floats, fraction: float) -> Attempt:
        nonlocal reached, last
        level = begin.towards(load, fraction) if fraction < 1 else load
        last = solver.solve(density, level, after=reached, raise_on_failure=False, trial=True)
        steps = last.steps
        if last.converged:
            try:
                reached = last = solver.finish(last)
            except EquilibriumError as error:  # raised by all ranks or by none
                last = error.result
            steps += last.steps
        return Attempt(last.state, 1 if last.converged else -1, steps)

    start = ContinuationResult(before.state, 0.0, 1)
    done = run_continuation(attempt, start, 1.0, LEAST_INCREMENT)
    if done.load_factor != 1.0:
        raise EquilibriumError(
            f"the path ends between {begin} and {load}, after "
            f"{100 * (done.load_factor or 0.0):.0f} % of the change: {last.reason} Beyond a limit "
            'point a path goes on by="arc-length".',
            last,
        )
    return reached
