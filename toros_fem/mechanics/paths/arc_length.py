"""Equilibria through limit points: along a path by arc length (Riks' method), and by volume."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Positive, Real, Table, key
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.base.validation import Floats
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import (
    Equilibrium,
    EquilibriumError,
    condition_of,
    readings,
)
from toros_fem.mechanics.equilibrium.iteration import RESOLVED, STAGNATED, STUCK, UNRESOLVED
from toros_fem.mechanics.equilibrium.linear_solver import MumpsFactor
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace_point import TracePoint, measured_point
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.tangent import UpperTangent

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
# By volume: largest predicted movement of a vertex over the skin's size, and error of a volume.
FAR_BY_VOLUME = 0.05
SAME_VOLUME = 1e-9


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
    held: Load | None = None,
) -> Iterator[TracePoint]:
    """Yield equilibria along a path of loads times a load factor, as of `trace` (collective).

    What is held stays as it is, and so does a displacement of supports.
    """
    begin = options.first
    first = solver.solve(density, with_held(load, begin, held), start)
    path = _ArcLength(solver, density.copy(), load, options, first, begin, held)
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


def follow_volumes(
    solver: EquilibriumSolver,
    density: Floats,
    volumes: Sequence[float],
    metrics: Sequence[Metric],
    start: Equilibrium,
) -> Iterator[TracePoint]:
    """Yield equilibria with given volumes in m³, whose pressure follows (collective).

    All pressures of the start are scaled by one load factor; forces and weight stay.
    """
    pressures = Load(start.load.pressures)
    rest = replace(start.load, pressure=0.0 * start.load.pressures)
    volumes_from = ArcLengthOptions(first=1.0, lowest=None, highest=None, max_points=None)
    path = _ArcLength(solver, density.copy(), pressures, volumes_from, start, 1.0, rest)
    for volume in volumes:
        path.inflate_to(volume)
        # Held volumes take one direction from the skin, in which its energy may fall.
        unstable = path.point.negative - (path.volume_rate() < 0)
        yield replace(
            measured_point(solver, path.result(), metrics),
            load_factor=path.point.factor,
            negative_eigenvalues=unstable,
        )


def with_held(load: Load, factor: float, held: Load | None) -> Load:
    """Return a load times a factor with what is held; supports and bodies stay where they are."""
    scaled = replace(load.scaled(factor), displacement=load.displacement, poses=load.poses)
    if held is None:
        return scaled
    force = [np.asarray(one.force) for one in (scaled, held) if one.force is not None]
    return replace(
        scaled,
        pressure=scaled.pressures + held.pressures,
        force=np.sum(force, axis=0) if force else None,
        weight_fraction=scaled.weight + held.weight,
        displacement=load.displacement if held.displacement is None else held.displacement,
        poses=load.poses if held.poses is None else held.poses,
    )


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
        begin: float,
        held: Load | None,
    ) -> None:
        self._solver, self._model, self._options = solver, solver.model, options
        self._density, self._load, self._held = density, load, held
        self._comm, self._size = solver.skin.comm, solver.skin.pattern.size
        self._tangent = UpperTangent(self._model)
        self._make_factors()
        self._factorisations = self._counted = 0
        # Residuals are measured by the largest load so far: it may pass through zero.
        self._peak = max(abs(begin), abs(options.first_increment))
        self.length, self._points, self.ended = 0.0, 1, False
        self._act()
        point = self._corrected(_Point(first.state, begin), None)
        if isinstance(point, str):
            raise EquilibriumError(
                f"the path has no first point at load factor {begin:g}: {point}",
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
        load = with_held(self._load, point.factor, self._held)
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

    def inflate_to(self, volume: float) -> None:
        """Find the point with a volume in m³, over points between where needed (collective)."""
        self._act()
        begin = self._volume(self.point.state)
        reached, share = 0.0, 1.0
        while reached < 1:
            share = min(share, 1 - reached)
            wanted = begin + (reached + share) * (volume - begin)
            rise = wanted - self._volume(self.point.state)
            step, response = rise / self.volume_rate(), self.point.response
            moves = np.abs(step * self._model.positions(response.state))
            far = FAR_BY_VOLUME * self._size
            step *= far / max(far, largest(self._comm, float(moves.max(initial=0.0))))
            step *= self._allowed(self.point.state, step * response.state)
            point = self._corrected(self.point.plus(response, step), None, volume=wanted)
            if not isinstance(point, str):
                self.point, reached, share = point, reached + share, 2 * share
                self._peak = max(self._peak, abs(point.factor))
                continue
            share /= 2
            if share < LEAST_STEP:
                raise EquilibriumError(
                    f"the path by volume ends at {self._volume(self.point.state):.6g} m³: {point} "
                    "Mesh the skin finer where it folds.",
                    replace(self.result(), converged=False),
                )

    def volume_rate(self) -> float:
        """Return the change of the volume in m³ by the load factor at the last point."""
        gradient = self._model.volume_gradient(self.point.state)
        return dot(self._comm, gradient, self.point.response.state)

    def _volume(self, state: Floats) -> float:
        return float(self._model.volumes(state).sum())

    def _corrected(
        self, predicted: _Point, across: _Point | None, *, volume: float | None = None
    ) -> _Equilibrium | str:
        """Return the equilibrium in the plane through a prediction, across a direction.

        Without a direction the load factor is kept, or the volume in m³ is as given. Where Newton's
        method does not converge it is said why.
        """
        model, comm = self._model, self._comm
        at, before, moved = predicted, np.inf, np.inf
        for steps in range(MAX_STEPS + 1):
            model.set_load(self._load)
            force = model.applied_load(at.state)
            model.set_load(with_held(self._load, at.factor, self._held))
            residual = model.residual(at.state)
            size = norm(comm, residual)
            share = size / max(self._peak * norm(comm, force), np.finfo(float).tiny)
            negative = self._factorise(at.state)
            if negative is None:
                return "the tangent is singular, as of a flat membrane without load."
            response = _Point(self._factors.solve(force) * model.free, 1.0)
            stuck = size > STUCK * before
            negligible = share <= STAGNATED or (share <= UNRESOLVED and moved <= RESOLVED)
            lacks = 0.0 if volume is None else volume - self._volume(at.state)
            filled = volume is None or abs(lacks) <= SAME_VOLUME * abs(volume)
            if filled and (share <= self._solver.options.tolerance or (stuck and negligible)):
                return _Equilibrium(at.state, at.factor, negative, share, response, steps)
            change = _Point(-self._factors.solve(residual) * model.free, 0.0)
            if across is not None:
                gap = self._product(across, at.plus(change).minus(predicted))
                change = change.plus(response, -gap / self._product(across, response))
            if volume is not None:
                gradient = model.volume_gradient(at.state)
                left = lacks - dot(comm, gradient, change.state)
                change = change.plus(response, left / dot(comm, gradient, response.state))
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
