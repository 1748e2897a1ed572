"""Svanberg's MMA and GCMMA with variables distributed over ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import largest, smallest, total
from toros_fem.base.rounding import rounded
from toros_fem.base.validation import (
    checked_floats,
    require_between,
    require_count,
    require_finite,
    require_kind,
    require_positive,
)
from toros_fem.design.mma.approximation import TINY, Approximation, cache_blocks
from toros_fem.design.mma.subproblem import Penalty, solve_subproblem

Numbers = Sequence[float] | Floats

SMALL = 1e-5  # Svanberg's raa0; it keeps the approximations strictly convex
CURVATURE_DECAY = 0.5  # factor on the curvature of retries in each new step
RAISES = 20  # largest number of increases of the curvature in one retry, each up to tenfold
GRADED = 5.0  # times ab/(a² + b²) of two moves: they count in full up to a ratio of five
ROUNDING = 1e-10  # of a function's largest change: a smaller excess counts as rounding


@dataclass(frozen=True)
class MMAOptions:
    """Svanberg's parameters; the defaults are his except for the move limit.

    Attributes:
        move: Largest change of a variable in one iteration, over its range.
        asymptote_start: Initial distance of the asymptotes over the range.
        asymptote_grow, asymptote_shrink: Factors on the distance where a variable continues in one
            direction, and where it turns back.
        penalty: cᵢ, the penalty for violating a constraint by one unit.
        tolerance: Largest residual of the subproblem; near the solution it is solved more exactly.

    Raises:
        ParameterError: A value is out of bounds.
    """

    move: float = 0.2
    asymptote_start: float = 0.5
    asymptote_grow: float = 1.2
    asymptote_shrink: float = 0.7
    penalty: float = 1000.0
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        require_positive(
            asymptote_start=self.asymptote_start, penalty=self.penalty, tolerance=self.tolerance
        )
        require_positive(move=self.move, at_most=1.0)
        require_between(1.0, 10.0, asymptote_grow=self.asymptote_grow)
        require_between(0.01, 1.0, asymptote_shrink=self.asymptote_shrink)


@dataclass
class MMAState:
    """State of the iteration as plain arrays; a run that starts from it continues exactly.

    Attributes:
        previous, before_previous: xᵏ of the last two steps.
        distance: Distance of both asymptotes from `previous`.
        multipliers: λᵢ of the last subproblem: of the constraints, of r and of −r.
        curvature: ρᵢ added by retries, the objective's first.
        unit: Product of all factors of `rescale`; the penalty of constraints is multiplied by it.
    """

    previous: Floats | None = None
    before_previous: Floats | None = None
    distance: Floats | None = None
    multipliers: Floats | None = None
    curvature: Floats | None = None
    unit: float = 1.0


class MMA:
    """Svanberg's MMA and GCMMA: min f₀ + Σ rₖ² subject to fᵢ ≤ 0, x̲ ≤ x ≤ x̄.

    `step` proposes a point. In plain MMA it is the next iterate. In GCMMA it is accepted once
    `conservative` finds that no function exceeds its approximation there. Otherwise `retry` raises
    the curvatures of those that do, and proposes another point; the iterates then stay feasible
    and f₀ decreases monotonically. A caller may also call `retry` after another test.
    Each residual is approximated twice, as rₖ and −rₖ, by constraints with a quadratic penalty
    (Svanberg 2007, section 2). The subproblem then finds the minimum of the squares, like the
    Gauss-Newton method.
    Only arrays of the size of the constraints are reduced over the ranks (Aage & Lazarov,
    Struct. Multidiscip. Optim. 47, 2013). Equations and default parameters: K. Svanberg, "MMA and
    GCMMA – two methods for nonlinear optimization", 2007; GCMMA's convergence: K. Svanberg, SIAM
    J. Optim. 12(2), 2002.

    Args:
        lower, upper: Finite bounds; a variable with equal bounds keeps its value.
        constraints: Number m of constraints, which should be scaled to O(1).
        options: Svanberg's parameters.
        move: Move limit of each variable over its range; None: that of the options for all.
        residuals: Number of rₖ.
        resolution: Part of its range to which a variable is rounded in proposed points, so that
            steps do not depend on the rounding of gradients; None for Svanberg's method as it is.

    Raises:
        ParameterError: An upper bound is below its lower bound, a bound is not finite, or a move
            limit or the resolution is outside (0, 1].
    """

    def __init__(
        self,
        lower: PETSc.Vec,
        upper: PETSc.Vec,
        constraints: int = 0,
        options: MMAOptions | None = None,
        move: PETSc.Vec | None = None,
        *,
        residuals: int = 0,
        resolution: float | None = None,
    ) -> None:
        for name, vector in (("lower", lower), ("upper", upper)):
            require_kind(name, vector, PETSc.Vec, "a PETSc.Vec")
        require_count(0, constraints=constraints, residuals=residuals)
        require_kind("options", options, (MMAOptions, type(None)), "MMAOptions, or None")
        self._comm: MPI.Comm = lower.comm.tompi4py()
        # PETSc frees this communicator with its last vector, which the caller may delete.
        self._anchor = PETSc.Vec().createMPI(0, comm=lower.comm)
        self._lower, self._upper = lower.array.copy(), upper.array.copy()
        apart = largest(self._comm, abs(len(self._lower) - len(self._upper)))
        if apart:
            raise ParameterError(
                "lower and upper have different sizes on a rank; make both by duplicate()."
            )
        worst = smallest(self._comm, np.min(self._upper - self._lower, initial=np.inf))
        if not worst >= 0:
            raise ParameterError(
                f"an upper bound is {-worst:g} less than its lower bound. Exchange them."
            )
        if not np.isfinite(largest(self._comm, np.max(self._upper - self._lower, initial=0.0))):
            raise ParameterError("MMA needs finite bounds for every variable.")
        self.options = options or MMAOptions()
        self._move: float | Floats = float(self.options.move)
        require_kind("move", move, (PETSc.Vec, type(None)), "a PETSc.Vec, or None")
        if move is not None:
            self._move = move.array.copy()
            for end in (
                smallest(self._comm, np.min(self._move, initial=1.0)),
                largest(self._comm, np.max(self._move, initial=0.5)),
            ):
                require_positive(move=end, at_most=1.0)
        self._unit: Floats | None = None
        if resolution is not None:
            require_positive(resolution=resolution, at_most=1.0)
            self._unit = resolution * (self._upper - self._lower)
        self._m, self._r = constraints, residuals
        self._rows = constraints + 2 * residuals
        self._model = Approximation(self._comm, len(self._lower), self._rows)
        self._values: Floats = np.zeros(self._rows + 1)
        self._start_curvature: Floats = np.zeros(self._rows + 1)
        self.state = MMAState()

    def step(
        self,
        x: PETSc.Vec,
        value: float,
        gradient: PETSc.Vec,
        values: Numbers = (),
        jacobian: Sequence[PETSc.Vec] = (),
        residuals: Numbers = (),
        residual_jacobian: Sequence[PETSc.Vec] = (),
    ) -> None:
        """Replace x by the next proposed point (collective).

        Args:
            x: Current variables, overwritten.
            value: f₀(x), the same on all ranks.
            gradient: ∇f₀(x).
            values: fᵢ(x), the same on all ranks.
            jacobian: ∇fᵢ(x).
            residuals: rₖ(x), the same on all ranks.
            residual_jacobian: ∇rₖ(x).

        Raises:
            ParameterError: The number of values or gradients is wrong.
        """
        given = {"values": values, "jacobian": jacobian, "residuals": residuals}
        for name, rows in {**given, "residual_jacobian": residual_jacobian}.items():
            require_kind(name, rows, (list, tuple, np.ndarray), "a list, () for none")
        for vector in (x, gradient, *jacobian, *residual_jacobian):
            require_kind("x or a gradient", vector, PETSc.Vec, "a PETSc.Vec")
        self._check(values, jacobian)
        require_finite(value=value)
        for name, numbers in (("values", values), ("residuals", residuals)):
            checked_floats(name, numbers, "finite numbers, the same on all ranks", lambda _: True)
        rows = (gradient, *jacobian, *residual_jacobian)
        if largest(self._comm, sum(not np.isfinite(row.array).all() for row in rows)):
            raise ParameterError(
                "a gradient is not finite on some rank. Do not step from such a point: `retry`."
            )
        if len(residuals) != self._r or len(residual_jacobian) != self._r:
            raise ParameterError(
                f"{len(residuals)} residuals and {len(residual_jacobian)} gradients were given for "
                f"{self._r} residuals."
            )
        state, here = self.state, x.array.copy()
        distance = self._distance(here)
        state.before_previous, state.previous, state.distance = state.previous, here, distance
        if state.curvature is None:
            state.curvature = np.zeros(self._rows + 1)
        state.curvature = CURVATURE_DECAY * state.curvature
        up = [row.array for row in residual_jacobian]
        gradients = [gradient.array, *(row.array for row in jacobian), *up, *(-row for row in up)]
        bounds = (self._lower, self._upper)
        self._model.expand(here, distance, bounds, self._move, gradients)
        self._values = _stacked(value, values, residuals)
        # GCMMA's initial curvature, a tenth of the mean |∂fᵢ/∂xⱼ| (x̄ⱼ − x̲ⱼ), weighted by dⱼ here.
        weight = max(self._model.total_weight, TINY)
        self._start_curvature = np.maximum(0.2 * self._model.size / weight, 1e-6)
        self._propose(x)

    def conservative(
        self,
        x: PETSc.Vec,
        value: float,
        values: Numbers = (),
        residuals: Numbers = (),
    ) -> bool:
        """Return whether no function exceeds its approximation at the proposed point (collective).

        Args:
            x: The proposed point.
            value: f₀ there, the same on all ranks; infinite where it does not exist.
            values: fᵢ there.
            residuals: rₖ there.

        Raises:
            ParameterError: `step` was not called yet, or the number of values is wrong.
        """
        self._count(values, residuals)
        excess, _ = self._excess(x, value, values, residuals)
        return bool(np.all(excess <= 0))

    def retry(
        self,
        x: PETSc.Vec,
        value: float,
        values: Numbers = (),
        residuals: Numbers = (),
    ) -> None:
        """Replace a rejected point by a more cautious one (collective).

        A function that exceeds its approximation by δᵢ d(x) there gets the curvature
        min(1.1 (ρᵢ + δᵢ), 10 ρᵢ) (section 4). Where a value is infinite, or all approximations are
        conservative and the caller still rejects x, all curvatures are multiplied by ten. If the
        same x results, for example at its move limits, and is not conservative, the curvatures are
        raised again.

        Args:
            x: The proposed point, overwritten.
            value: f₀ there, the same on all ranks; infinite where it does not exist.
            values: fᵢ there. If values and residuals are left out, only f₀ is tested.
            residuals: rₖ there.

        Raises:
            ParameterError: `step` was not called yet, or the number of values is wrong.
        """
        if len(values) or len(residuals):
            self._count(values, residuals)
        state = self.state
        assert state.curvature is not None
        before = x.array.copy()
        excess, distance = self._excess(x, value, values, residuals)
        for _ in range(RAISES):
            limit = 10 * np.maximum(state.curvature, self._start_curvature)
            if np.all(np.isfinite(excess)) and np.any(excess > 0):
                rise = 1.1 * (state.curvature + excess / max(distance, TINY))
                state.curvature = np.where(excess > 0, np.minimum(rise, limit), state.curvature)
            else:
                state.curvature = limit
            self._propose(x)
            if largest(self._comm, np.max(np.abs(x.array - before), initial=0.0)) > 0:
                break
            excess, distance = self._excess(x, value, values, residuals)
            if not np.any(excess > 0):  # the caller may accept it now
                break

    def rescale(self, factor: float) -> None:
        """Multiply the unit of f₀ and Σ rₖ² by a factor, from the next step on.

        The next proposed point does not change, except for the constant 1e-5 that keeps the
        approximations convex.

        Raises:
            ParameterError: The factor is not positive.
        """
        require_positive(factor=factor)
        state, m, root = self.state, self._m, factor**0.5
        state.unit *= factor
        if state.curvature is not None:
            state.curvature[0] *= factor
            state.curvature[1 + m :] *= root
        if state.multipliers is not None:
            state.multipliers[:m] *= factor
            state.multipliers[m:] *= root

    def kkt_residual(
        self,
        x: PETSc.Vec,
        gradient: PETSc.Vec,
        values: Numbers = (),
        jacobian: Sequence[PETSc.Vec] = (),
    ) -> float:
        """Return the residual of the optimality conditions at x (collective).

        It is the largest entry of the natural residual, which is zero at KKT points only.
        With ξⱼ = (xⱼ − x̲ⱼ)/(x̄ⱼ − x̲ⱼ), the last subproblem's λ, L = f₀ + Σ rₖ² + Σ λᵢfᵢ in the
        units before any `rescale`, and N the number of variables with a range, it is

            |ξⱼ − clip(ξⱼ − N ∂L/∂ξⱼ, 0, 1)|  for each of these, and  |min(λᵢ, −fᵢ)|.

        The factor N makes it independent of the mesh for densities, since ∂L/∂ξⱼ is proportional to
        the area of a triangle. Other variables count N times.

        Args:
            x: Variables.
            gradient: ∇(f₀ + Σ rₖ²)(x).
            values: fᵢ(x), the same on all ranks.
            jacobian: ∇fᵢ(x).
        """
        self._check(values, jacobian)
        multipliers = self.state.multipliers
        lam = np.zeros(self._m) if multipliers is None else multipliers[: self._m]
        span = self._upper - self._lower
        ranged = span > 0
        slope = gradient.array.copy()
        for weight, row in zip(lam, jacobian, strict=True):
            slope += weight * row.array
        slope *= total(self._comm, np.count_nonzero(ranged)) / self.state.unit * span
        place = (x.array - self._lower) / np.where(ranged, span, 1.0)
        gap = np.abs(place - np.clip(place - slope, 0.0, 1.0))[ranged]
        complementarity = np.abs(
            np.minimum(lam / self.state.unit, -np.asarray(values, dtype=np.float64))
        )
        worst = float(np.max(complementarity, initial=0))
        return max(largest(self._comm, np.max(gap, initial=0.0)), worst)

    def _check(self, values: Numbers, jacobian: Sequence[PETSc.Vec]) -> None:
        if len(values) != self._m or len(jacobian) != self._m:
            raise ParameterError(
                f"{len(values)} values and {len(jacobian)} gradients were given for {self._m} "
                "constraints."
            )

    def _count(self, values: Numbers, residuals: Numbers) -> None:
        if len(values) != self._m or len(residuals) != self._r:
            raise ParameterError(
                f"{len(values)} values were given for {self._m} constraints, and {len(residuals)} "
                f"residuals for {self._r}."
            )

    def _distance(self, x: Floats) -> Floats:
        """Return the distance of the asymptotes from x (Svanberg 2007, eqs. 3.11-3.14).

        His factor jumps where one of the last two moves changes its sign. With a resolution it
        passes through 1 there, so that a difference of one unit cannot change the next step much.
        """
        state, o = self.state, self.options
        out = self._upper - self._lower
        if state.before_previous is None:
            out *= o.asymptote_start
            return out
        here, there = state.previous, state.before_previous
        assert here is not None
        assert state.distance is not None
        for part in cache_blocks(len(x)):
            span = out[part]
            move, before = x[part] - here[part], here[part] - there[part]
            turn = move * before
            if self._unit is not None:
                turn /= np.maximum(move**2 + before**2 + self._unit[part] ** 2, TINY)
                turn *= GRADED
                np.clip(turn, -1.0, 1.0, out=turn)
            else:
                np.sign(turn, out=turn)
            distance = np.where(turn > 0, o.asymptote_grow - 1, 1 - o.asymptote_shrink)
            distance *= turn
            distance += 1
            distance *= state.distance[part]
            np.maximum(distance, 0.01 * span, out=distance)
            np.minimum(distance, 10 * span, out=span)
        return out

    def _excess(
        self, x: PETSc.Vec, value: float, values: Numbers, residuals: Numbers
    ) -> tuple[Floats, float]:
        """Return by how much each function exceeds its approximation, and d(x) of `retry`."""
        state = self.state
        if state.previous is None or state.distance is None:
            raise ParameterError("there is no proposed point yet: call step first.")
        change, distance = self._model.change_at(state.previous, state.distance, x.array)
        there = _stacked(value, values, residuals)
        there[~np.isfinite(there)] = np.inf
        count = len(there)
        excess: Floats = np.zeros(self._rows + 1)
        excess[:count] = there - self._values[:count] - change[:count]
        noise = ROUNDING * (np.abs(self._values) + self._model.size)
        excess[excess <= noise] = 0.0
        # Where r exceeds its approximation, often that of −r limits x, and vice versa.
        pairs = excess[1 + self._m :].reshape(2, -1)
        pairs[:] = pairs.max(axis=0)
        return excess, distance

    def _propose(self, x: PETSc.Vec) -> None:
        state, model = self.state, self._model
        assert state.curvature is not None
        assert state.previous is not None
        assert state.distance is not None
        model.curvature = SMALL + state.curvature
        counts, unit = [self._m, 2 * self._r], state.unit
        penalty = Penalty(
            np.repeat([self.options.penalty * unit, 0.0], counts),
            np.repeat([unit, 2.0], counts),
        )
        tolerance = self.options.tolerance
        found = solve_subproblem(model, self._values[1:], penalty, state.multipliers, tolerance)
        state.multipliers = found.multipliers
        bounds = (self._lower, self._upper)
        model.write_minimizer(found.multipliers, state.previous, state.distance, bounds, x.array)
        if self._unit is not None:
            steps = rounded(x.array - self._lower, self._unit)
            np.clip(self._lower + steps, *bounds, out=x.array)


def _stacked(value: float, values: Numbers, residuals: Numbers) -> Floats:
    """Return f₀, fᵢ, r and −r, each of which has its own approximation."""
    r = np.asarray(residuals, dtype=np.float64)
    return np.concatenate([[value], np.asarray(values, dtype=np.float64), r, -r])
