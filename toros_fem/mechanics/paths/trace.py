"""Paths of equilibria, by pressure or by arc length."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Literal, cast, overload

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    is_number,
    require_callable,
    require_choice,
    require_kind,
    shown,
)
from toros_fem.measures.metrics import Metric, check_metrics
from toros_fem.mechanics.equilibrium.solver import EquilibriumResult, EquilibriumSolver
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions, follow_arc
from toros_fem.mechanics.paths.pressure_path import follow_pressures
from toros_fem.mechanics.paths.trace_point import Pressure, TracePoint
from toros_fem.mechanics.skin.load_case import make_load_case

PATHS = ("pressure", "arc-length")
Start = Floats | EquilibriumResult | None
Stop = Callable[[TracePoint], bool] | None


@overload
def trace(
    solver: EquilibriumSolver,
    density: Floats,
    pressure: Sequence[Pressure],
    metrics: Sequence[Metric] = (),
    start: Start = None,
    *,
    by: Literal["pressure"] = "pressure",
    force: Floats | None = None,
    stop: Stop = None,
) -> Iterator[TracePoint]: ...


@overload
def trace(
    solver: EquilibriumSolver,
    density: Floats,
    pressure: Pressure,
    metrics: Sequence[Metric] = (),
    start: Start = None,
    *,
    by: Literal["arc-length"],
    force: Floats | None = None,
    stop: Stop = None,
    options: ArcLengthOptions | None = None,
) -> Iterator[TracePoint]: ...


def trace(
    solver: EquilibriumSolver,
    density: Floats,
    pressure: Pressure | Sequence[Pressure],
    metrics: Sequence[Metric] = (),
    start: Start = None,
    *,
    by: Literal["pressure", "arc-length"] = "pressure",
    force: Floats | None = None,
    stop: Stop = None,
    options: ArcLengthOptions | None = None,
) -> Iterator[TracePoint]:
    """Return an iterator over the equilibria along a path, found one by one (collective).

    By pressure, the stable equilibria at one pressure after the other. Where the skin snaps, the
    equilibrium depends on the path. So each is reached from the one before, at once or, where that
    fails, in smaller increments of the pressures. Only the first may start from the assembled skin,
    if no start is given.

    By arc length, one load factor scales pressures, dead forces and weight. The path goes on
    through limit points, where the load factor turns, and along unstable equilibria.

    Args:
        solver: Equilibrium solver.
        density: Projected density of its owned triangles.
        pressure: In Pa. By pressure, all pressures in the order in which they act. By arc length,
            the pressure at load factor 1, one for all chambers or one for each.
        metrics: Metrics to compute at each point.
        start: As for `EquilibriumSolver.solve`, for the first point; None starts from the assembled
            skin. By pressure, from an equilibrium at this density the first one is reached as each
            from the one before.
        by: "pressure" or "arc-length".
        force: Dead forces in N on all assembled vertices, (n, 3); by arc length those at load
            factor 1.
        stop: Called with each point, on every rank, with equal results; the path ends with the
            point for which it returns True. None follows the path to its end.
        options: Ends and density of a path by arc length; None takes the defaults.

    Raises:
        ParameterError: A value is not admissible, an option has no meaning on this path, no load
            acts, or there is friction on a path by arc length.
        DensityError: The density does not fit, or leaves [0, 1].
        OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
        EquilibriumError: While iterating: the path could not be followed further; the points before
            have been yielded.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_choice("by", by, PATHS)
    check_metrics(metrics)
    require_kind("options", options, (ArcLengthOptions, type(None)), "ArcLengthOptions, or None")
    if stop is not None:
        require_callable("stop", stop, "a function of a TracePoint, or None")
    if by == "pressure":
        if options is not None:
            raise ParameterError('options are those of a path by="arc-length"; leave them out.')
        levels = _levels(solver, pressure, force)
        return _until(follow_pressures(solver, density, levels, metrics, start, force), stop)
    model = solver.model
    if model.slides:
        raise ParameterError(
            'friction depends on the path that the load takes: follow it by="pressure".'
        )
    load = make_load_case(
        solver.skin.pattern,
        model.supports,
        len(model.load.pressures),
        pressure,  # type: ignore[arg-type]
        force=force,
        weight_fraction=0.0 if model.weight is None else 1.0,
    )
    if not (load.pressures.any() or load.force is not None or load.weight_fraction):
        raise ParameterError(
            "no load acts that a load factor could scale; give a pressure, a force or a weight."
        )
    density = model.check(density)
    state = start.state if isinstance(start, EquilibriumResult) else start
    path = follow_arc(solver, density, load, metrics, state, options or ArcLengthOptions())
    return _until(path, stop)


def _levels(
    solver: EquilibriumSolver, pressure: Pressure | Sequence[Pressure], force: Floats | None
) -> Sequence[Pressure]:
    """Return the pressures of a path, all checked before the first is solved for."""
    if is_number(pressure) or np.ndim(pressure) == 0 or not len(pressure):  # type: ignore[arg-type]
        raise ParameterError(
            f'pressure = {shown(pressure)}: a path by="pressure" needs all pressures in Pa, '
            "as a list, in the order in which they act."
        )
    model, levels = solver.model, cast(Sequence[Pressure], pressure)
    for level in levels:
        make_load_case(
            solver.skin.pattern, model.supports, len(model.load.pressures), level, force=force
        )
    return levels


def _until(path: Iterator[TracePoint], stop: Stop) -> Iterator[TracePoint]:
    for point in path:
        yield point
        if stop is not None and stop(point):
            return
