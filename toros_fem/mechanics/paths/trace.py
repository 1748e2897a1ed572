"""Paths of equilibria: by pressure, or by arc length through limit points (Riks' method)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Positive, Real, Table, key
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.base.validation import require_callable, require_choice, require_kind, shown
from toros_fem.measures.metrics import Metric, check_metrics
from toros_fem.mechanics.equilibrium.equilibrium import (
    Equilibrium,
    EquilibriumError,
    condition_of,
    readings,
)
from toros_fem.mechanics.equilibrium.iteration import RESOLVED, STAGNATED, STUCK, UNRESOLVED
from toros_fem.mechanics.equilibrium.linear_solver import MumpsFactor
from toros_fem.mechanics.equilibrium.newton import Attempt
from toros_fem.mechanics.equilibrium.search import ContinuationResult, run_continuation
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.mechanics.terms.tangent import UpperTangent

PATHS = ("pressure", "arc-length")
Start = Floats | Equilibrium | None
# Smallest increment between two loads, as a fraction of their difference.
LEAST_INCREMENT = 1 / 100
# Largest number of parts of the way to the next load, however far the skin is predicted to move.
MOST_PARTS = 10
# Newton steps after which a point is given up, and number at which the steps along the path keep
# their length.
MAX_STEPS = 15
USUAL_STEPS = 4
# Shortest step along the path, over the first one.
LEAST_STEP = 1e-5
# Largest correction of a predicted point, over the step, and least cosine between the directions
# of two neighbouring points. Beyond, the point may lie on another path.
FAR = 0.5
TURN = 0.7
P = TypeVar("P")


@dataclass(frozen=True, eq=False)
class TracePoint:
    """One equilibrium of a path.

    Attributes:
        pressure: Pressure in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3).
        metrics: Values of the metrics, by key.
        result: The equilibrium.
        load_factor: Factor on the loads that act; 1 on a path by pressure.
        negative_eigenvalues: Number of negative eigenvalues of the tangent: in so many directions
            the energy falls. 0 for a stable equilibrium.
        arc_length: Length of the path up to here, a pure number; None on a path by pressure.
        load_rate: Derivative of the load factor by the arc length; None on a path by pressure.
    """

    pressure: float | list[float]
    positions: Floats
    metrics: dict[str, float]
    result: Equilibrium
    load_factor: float = 1.0
    negative_eigenvalues: int = 0
    arc_length: float | None = None
    load_rate: float | None = None

    @property
    def stable(self) -> bool:
        """Whether the energy has a minimum here."""
        return self.negative_eigenvalues == 0


Stop = Callable[[TracePoint], bool] | None


def trace(
    solver: EquilibriumSolver,
    density: Floats,
    loads: Load | Pressure | Sequence[Load | Pressure],
    metrics: Sequence[Metric] = (),
    start: Start = None,
    *,
    by: Literal["pressure", "arc-length"] = "pressure",
    stop: Stop = None,
    options: ArcLengthOptions | None = None,
) -> Iterator[TracePoint]:
    """Return an iterator over the equilibria along a path, found one by one (collective).

    By pressure, the stable equilibria under one load after the other. Where the skin snaps, the
    equilibrium depends on the path. So each is reached from the one before, at once or, where that
    fails, in smaller increments of the load. Only the first may start from the assembled skin, if
    no start is given.

    By arc length, one load factor scales pressures, dead forces and weight. The path goes on
    through limit points, where the load factor turns, and along unstable equilibria.

    Args:
        solver, density: As of `EquilibriumSolver.solve`.
        loads: By pressure, all loads in the order in which they act; numbers are pressures in Pa,
            which leave the rest of the load before. By arc length, the load at load factor 1.
        metrics: Metrics to compute at each point.
        start: As for `EquilibriumSolver.solve`, for the first point; None starts from the assembled
            skin. By pressure, from an equilibrium the first one is reached as each from the one
            before.
        by: "pressure" or "arc-length".
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
    if by == "pressure":
        if options is not None:
            raise ParameterError('options are those of a path by="arc-length"; leave them out.')
        path = follow_pressures(solver, density, _levels(solver, loads), metrics, start)
    else:
        load, density = _scaled_load(solver, loads), solver.model.design.check(density)
        state = start.state if isinstance(start, Equilibrium) else start
        path = follow_arc(solver, density, load, metrics, state, options or ArcLengthOptions())
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


def measured_point(
    solver: EquilibriumSolver, result: Equilibrium, metrics: Sequence[Metric]
) -> TracePoint:
    """Return an equilibrium with its metrics, as a point of a path (collective)."""
    skin, several = solver.skin, len(result.pressures) > 1
    pressure = list(result.pressures) if several else result.pressure
    positions = skin.gather_vertices(result.positions)
    values = {metric.key: metric.value(skin.pattern, positions) for metric in metrics}
    return TracePoint(pressure, positions, values, result)


def until_failure(path: Iterator[P]) -> tuple[list[P], str]:
    """Return the points of a path, and why it ends early; empty where it does not (collective)."""
    points: list[P] = []
    try:
        points.extend(path)
    except EquilibriumError as caught:  # raised by all ranks or by none
        return points, str(caught)
    return points, ""


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


class ArcLengthOptions(Table):
    """Where a path by arc length begins and ends, and how densely it is followed.

    Raises:
        ParameterError: A value is outside its bounds, or the first increment is zero.
    """

    first: Real = key(0.05, "load factor of the first point")
    first_increment: Real = key(
        0.05, "change of the load factor to the second point; negative: the path begins downwards"
    )
    largest_increment: Positive = key(0.1, "largest change of the load factor between two points")
    largest_movement: Positive = key(
        0.02, "largest movement of a vertex between two points, over the skin's size"
    )
    lowest: Real | None = key(0.0, "load factor at which the path ends when it falls to it")
    highest: Real | None = key(1.0, "load factor at which the path ends when it rises to it")
    max_points: Annotated[int, In(at_least=2)] | None = key(200, "largest number of points")

    def __post_init__(self) -> None:
        if self.first_increment == 0:
            raise ParameterError("first_increment = 0 has no direction; it must not be zero.")

    def end_between(self, one: float, two: float) -> float | None:
        """Return the load factor at which a path ends on its way from one to two; None if none."""
        if self.lowest is not None and one > self.lowest >= two:
            return self.lowest
        if self.highest is not None and one < self.highest <= two:
            return self.highest
        return None


@dataclass(frozen=True, eq=False)
class _Point:
    """Owned unknowns x and load factor λ, or a change of both."""

    state: Floats
    factor: float

    def plus(self, change: _Point, times: float = 1.0) -> _Point:
        """Return the point that a change, times a number, leads to."""
        return _Point(self.state + times * change.state, self.factor + times * change.factor)

    def minus(self, other: _Point) -> _Point:
        return self.plus(other, -1.0)


@dataclass(frozen=True, eq=False)
class _Equilibrium(_Point):
    """A point in equilibrium, where the tangent is factorised.

    Attributes:
        negative: Number of negative eigenvalues of the tangent.
        residual: Norm of the first variation over the applied load.
        response: Change of the state by the load factor, per load factor.
        steps: Newton steps to it.
    """

    negative: int
    residual: float
    response: _Point
    steps: int


def follow_arc(
    solver: EquilibriumSolver,
    density: Floats,
    load: Load,
    metrics: Sequence[Metric],
    start: Floats | None,
    options: ArcLengthOptions,
) -> Iterator[TracePoint]:
    """Yield equilibria along a path of loads times a load factor, as of `trace` (collective).

    A displacement of supports stays as it is.
    """
    first = solver.solve(density, times(options.first, load), start)
    path = _ArcLength(solver, density.copy(), load, options, first)
    while True:
        yield replace(
            measured_point(solver, path.result(), metrics),
            load_factor=path.point.factor,
            negative_eigenvalues=path.point.negative,
            arc_length=path.length,
            load_rate=path.direction.factor,
        )
        if path.ended:
            return
        path.advance()


def times(factor: float, load: Load) -> Load:
    """Return a load with pressures, forces and weights multiplied; supports and bodies stay."""
    return replace(load.scaled(factor), displacement=load.displacement, poses=load.poses)


class _ArcLength:
    """Pseudo-arc-length continuation of the equilibria r(x, λ) = 0 (Riks 1979; Keller 1977).

    From a point, a step ds along the tangent predicts the next one, ds² = |dx|²/S² + dλ² with S =
    |dx/dλ| at the first point. Newton's method corrects it in the plane across the tangent, by two
    solves with K, which is indefinite beyond a limit point. MUMPS factorises it as LDLᵀ: by
    Sylvester's law of inertia its negative pivots are as many as the negative eigenvalues of K.

    Attributes:
        point: The last point.
        direction: Tangent of the path there, per arc length.
        length: Arc length from the first point.
        ended: Whether the path has reached an end.
    """

    def __init__(
        self,
        solver: EquilibriumSolver,
        density: Floats,
        load: Load,
        options: ArcLengthOptions,
        first: Equilibrium,
    ) -> None:
        self._solver, self._model, self._options = solver, solver.model, options
        self._density, self._load = density, load
        self._comm, self._size = solver.skin.comm, solver.skin.pattern.size
        self._tangent = UpperTangent(self._model)
        self._make_factors()
        self._factorisations = self._counted = 0
        # Residuals are measured by the largest load so far: it may pass through zero.
        self._peak = max(abs(options.first), abs(options.first_increment))
        self.length, self._points, self.ended = 0.0, 1, False
        self._act()
        point = self._corrected(_Point(first.state, options.first), None)
        if isinstance(point, str):
            raise EquilibriumError(
                f"the path has no first point at load factor {options.first:g}: {point}",
                replace(first, converged=False),
            )
        self.point = point
        self._scale = norm(self._comm, self.point.response.state)
        if self._scale == 0:
            raise ParameterError(
                "the loads do not move the skin; give a pressure, a force or a weight that acts on "
                "free vertices."
            )
        sense = _Point(np.zeros_like(first.state), float(np.sign(options.first_increment)))
        self.direction = self._tangent_at(self.point, sense)
        self._step = self._first_step = abs(options.first_increment / self.direction.factor)

    def result(self) -> Equilibrium:
        """Return the last point as the result of a solve (collective)."""
        self._act()
        model, point = self._model, self.point
        load = times(point.factor, self._load)
        model.set_load(load)
        point.state.setflags(write=False)
        kind = "A stable" if not point.negative else "An unstable"
        counted = f", where the tangent has {point.negative} negative eigenvalues"
        factorisations = self._factorisations - self._counted
        self._counted = self._factorisations
        return Equilibrium(
            **readings(model, point.state),
            density=self._density,
            load=load,
            converged=point.negative == 0,
            complete=point.negative == 0,
            load_factor=point.factor,
            reason=f"{kind} equilibrium was found at load factor {point.factor:.6g}"
            f"{counted if point.negative else ''}.",
            residual=point.residual,
            condition=condition_of(model, point.state, snapped=None, critical=None),
            steps=point.steps,
            modified_steps=0,
            factorisations=factorisations,
            history=(),
        )

    def advance(self) -> None:
        """Find the next point, by shorter steps where a step fails (collective)."""
        self._act()
        step = self._step
        while True:
            step = min(step, self._longest())
            found = self._stepped(step)
            if not isinstance(found, str):
                break
            step /= 2
            if step < LEAST_STEP * self._first_step:
                raise EquilibriumError(
                    f"the path ends at load factor {self.point.factor:.6g}, after "
                    f"{self._points} points: {found} Mesh the skin finer where it folds, or "
                    "begin with a smaller first_increment.",
                    replace(self.result(), converged=False),
                )
        length, point, direction = found
        growth = (USUAL_STEPS / max(point.steps, 1)) ** 0.5
        self._step = length * min(max(growth, 0.5), 2.0)
        self.point, self.direction = point, direction
        self.length += length
        self._points += 1
        self._peak = max(self._peak, abs(point.factor))
        most = self._options.max_points
        self.ended |= most is not None and self._points >= most

    def _act(self) -> None:
        """Take the model, which a caller may have used between two points."""
        self._solver.forget()
        self._model.set_density(self._density)

    def _longest(self) -> float:
        """Return the longest step along the tangent that keeps points close to each other."""
        moves = np.abs(self._model.positions(self.direction.state))
        moved = largest(self._comm, float(moves.max(initial=0.0)))
        options, rate = self._options, abs(self.direction.factor)
        by_load = options.largest_increment / rate if rate > 0 else np.inf
        return min(options.largest_movement * self._size / moved, by_load)

    def _stepped(self, step: float) -> tuple[float, _Equilibrium, _Point] | str:
        """Return length, point and tangent after one step, or why there is none, on all ranks."""
        here, along = self.point, self.direction
        step *= self._allowed(here.state, step * along.state)
        predicted = here.plus(along, step)
        point = self._corrected(predicted, along)
        if isinstance(point, str):
            return point
        off = point.minus(predicted)
        if self._product(off, off) ** 0.5 > FAR * step:
            return "Newton's method went far from the path."
        end = self._options.end_between(here.factor, point.factor)
        if end is not None:
            share = (end - here.factor) / (point.factor - here.factor)
            between = here.plus(point.minus(here), share)
            point, step = self._corrected(_Point(between.state, end), None), share * step
            if isinstance(point, str):
                return point
            self.ended = True
        direction = self._tangent_at(point, along)
        if self._product(direction, along) < TURN:
            self.ended = False
            return "the path turns sharply."
        return step, point, direction

    def _tangent_at(self, point: _Equilibrium, before: _Point) -> _Point:
        """Return the tangent at a point, in the sense of the one before."""
        unit = point.response
        size = float(np.copysign(self._product(unit, unit) ** 0.5, self._product(unit, before)))
        return _Point(np.asarray(unit.state / size), 1.0 / size)

    def _corrected(self, predicted: _Point, across: _Point | None) -> _Equilibrium | str:
        """Return the equilibrium in the plane through a prediction, across a direction.

        Without a direction the load factor is kept. Where Newton's method does not converge it is
        said why.
        """
        model, comm = self._model, self._comm
        at, before, moved = predicted, np.inf, np.inf
        for steps in range(MAX_STEPS + 1):
            model.set_load(times(1.0, self._load))
            force = model.applied_load(at.state)
            model.set_load(times(at.factor, self._load))
            residual = model.residual(at.state)
            size = norm(comm, residual)
            share = size / max(self._peak * norm(comm, force), np.finfo(float).tiny)
            negative = self._factorise(at.state)
            if negative is None:
                return "the tangent is singular, as of a flat membrane without load."
            response = _Point(self._factors.solve(force) * model.free, 1.0)
            stuck = size > STUCK * before
            negligible = share <= STAGNATED or (share <= UNRESOLVED and moved <= RESOLVED)
            if share <= self._solver.options.tolerance or (stuck and negligible):
                return _Equilibrium(at.state, at.factor, negative, share, response, steps)
            change = _Point(-self._factors.solve(residual) * model.free, 0.0)
            if across is not None:
                gap = self._product(across, at.plus(change).minus(predicted))
                change = change.plus(response, -gap / self._product(across, response))
            if not np.isfinite(norm(comm, change.state)):
                break
            at = at.plus(change, self._allowed(at.state, change.state))
            before = size
            moved = largest(comm, float(np.abs(change.state).max(initial=0.0))) / self._size
        return f"Newton's method took {MAX_STEPS} steps without converging."

    def _allowed(self, state: Floats, change: Floats) -> float:
        return self._model.largest_step(state, change, self._solver.options.fraction_to_barrier)

    def _make_factors(self) -> None:
        self._entries: Floats = np.zeros(len(self._tangent.columns))
        pattern = self._tangent.indptr, self._tangent.columns
        self._factors = MumpsFactor(self._comm, *pattern)

    def _factorise(self, state: Floats) -> int | None:
        """Factorise the tangent at a state; return the number of its negative eigenvalues.

        None is returned where it is singular.
        """
        if self._tangent.grow(state):
            self._make_factors()
        self._tangent.assemble(state, self._entries)
        self._factorisations += 1
        self._factors.factorise(self._entries)
        return self._factors.negative_pivots

    def _product(self, one: _Point, other: _Point) -> float:
        by_state = dot(self._comm, one.state, other.state) / self._scale**2
        return by_state + one.factor * other.factor


@dataclass(frozen=True)
class LimitPoint:
    """A turn of the load factor between two points of a path.

    Attributes:
        load_factor: Its largest or smallest value there.
        largest: Whether it is a maximum.
        after: Index of the point before it.
        fraction: Place between the two points, from 0 to 1, by arc length.
    """

    load_factor: float
    largest: bool
    after: int
    fraction: float


def limit_points(points: Iterable[TracePoint]) -> list[LimitPoint]:
    """Return the limit points of a path by arc length.

    Between two points the load factor is the cubic with its values and rates at both. The error
    falls with the fourth power of their distance.
    """
    path = list(points)
    for point in path:
        require_kind("points", point, TracePoint, "TracePoints, by trace(…)")
    found = []
    for k, (one, two) in enumerate(pairwise(path)):
        rates = one.load_rate, two.load_rate
        if one.arc_length is None or two.arc_length is None or None in rates:
            raise ParameterError('limit points are known on a path by="arc-length" only.')
        step = two.arc_length - one.arc_length
        begin, end = (step * float(rate or 0.0) for rate in rates)
        if (begin > 0) == (end > 0):
            continue
        rise = two.load_factor - one.load_factor
        cubic = np.poly1d([begin + end - 2 * rise, 3 * rise - 2 * begin - end, begin, 0.0])
        # The rates have different signs, so that one root lies between, up to rounding.
        root = min(cubic.deriv().roots, key=lambda r: abs(r - 0.5))
        place = float(np.clip(root.real, 0.0, 1.0))
        found.append(LimitPoint(one.load_factor + float(cubic(place)), begin > 0, k, place))
    return found
