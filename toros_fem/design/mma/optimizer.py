"""Svanberg's MMA and GCMMA with variables distributed over ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Fraction, In, Positive, Table, key
from toros_fem.base.mpi import largest, require_comm, rounded, together, total
from toros_fem.base.validation import (
    Floats,
    checked_floats,
    real_numbers,
    require_count,
    require_finite,
    require_kind,
    require_positive,
)
from toros_fem.design.mma.subproblem import TINY, Approximation, Penalty, solve_subproblem

SMALL = 1e-5  # Svanberg's raa0; it keeps the approximations strictly convex
CURVATURE_DECAY = 0.5  # factor on the curvature of retries in each new step
RAISES = 20  # largest number of increases of the curvature in one retry, each up to tenfold
GRADED = 5.0  # times ab/(a² + b²) of two moves: they count in full up to a ratio of five
ROUNDING = 1e-10  # of a function's largest change: a smaller excess counts as rounding


class MMAOptions(Table):
    """Svanberg's parameters; the defaults are his except for the move limit."""

    move: Fraction = key(0.2, "largest change of a variable in one iteration, over its range")
    asymptote_start: Positive = key(0.5, "initial distance of the asymptotes over the range")
    asymptote_grow: Annotated[float, In(at_least=1, at_most=10)] = key(
        1.2, "factor on the distance where a variable continues in one direction"
    )
    asymptote_shrink: Annotated[float, In(at_least=0.01, at_most=1)] = key(
        0.7, "factor on the distance where a variable turns back"
    )
    penalty: Positive = key(1000.0, "cᵢ, the penalty for violating a constraint by one unit")
    tolerance: Positive = key(
        1e-9, "largest residual of the subproblem; near the solution it is solved more exactly"
    )


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


@dataclass(frozen=True, eq=False)
class Functions:
    """What MMA minimises, at one point: values, which are alike on all ranks, and owned gradients.

    Where only values are asked for, gradients are left out.

    Attributes:
        value, gradient: f₀ and ∇f₀; f₀ is infinite where it does not exist.
        values, jacobian: fᵢ and ∇fᵢ.
        residuals, residual_jacobian: rₖ and ∇rₖ.
    """

    value: float
    gradient: Floats | None = None
    values: Sequence[float] | Floats = ()
    jacobian: Sequence[Floats] | Floats = ()
    residuals: Sequence[float] | Floats = ()
    residual_jacobian: Sequence[Floats] | Floats = ()

    @property
    def numbers(self) -> Floats:
        """f₀, fᵢ, r and −r, each of which has its own approximation."""
        r = np.asarray(self.residuals, dtype=np.float64)
        return np.concatenate([[self.value], np.asarray(self.values, dtype=np.float64), r, -r])

    @property
    def slopes(self) -> list[Floats]:
        """Gradients of `numbers`."""
        assert self.gradient is not None
        up = list(self.residual_jacobian)
        return [self.gradient, *self.jacobian, *up, *(-row for row in up)]

    def require_all(self, constraints: int, residuals: int, *, gradients: bool = False) -> None:
        """Check that each function has a value, and a gradient if there must be some."""
        found = [len(self.values), len(self.residuals)]
        asked = [constraints, residuals]
        if gradients:
            require_kind("gradient", self.gradient, np.ndarray, "one number for each variable")
            found += [len(self.jacobian), len(self.residual_jacobian)]
            asked += asked
        if found != asked:
            raise ParameterError(
                f"{found} values of constraints and residuals, and gradients of both, were given; "
                f"it must be {asked}."
            )

    def require_finite(self, comm: MPI.Comm, count: int) -> None:
        """Check that values and gradients, (count,) on this rank, are finite (collective)."""
        require_finite(value=self.value)
        for name in ("values", "residuals"):
            numbers = getattr(self, name)
            checked_floats(name, numbers, "finite numbers, the same on all ranks", lambda _: True)
        what = "the derivative by each owned variable"
        with together(comm):
            rows = [
                checked_floats("a gradient", row, what, (count,), finite=False)
                for row in self.slopes
            ]
            if not np.isfinite(rows).all():
                raise ParameterError(
                    "a gradient is not finite on some rank. Do not step from such a point: `retry`."
                )


@dataclass(eq=False, repr=False)
class MMA:
    """Svanberg's MMA and GCMMA: min f₀ + Σ rₖ² subject to fᵢ ≤ 0, x̲ ≤ x ≤ x̄.

    `step` proposes a point. In plain MMA it is the next iterate. In GCMMA it is accepted once
    `conservative` finds that no function exceeds its approximation there. Otherwise `retry` raises
    the curvatures of those that do, and proposes another point; the iterates then stay feasible
    and f₀ decreases monotonically. A caller may also call `retry` after another test. Points are
    arrays of the variables that a rank owns.
    Each residual is approximated twice, as rₖ and −rₖ, by constraints with a quadratic penalty
    (Svanberg 2007, section 2). The subproblem then finds the minimum of the squares, like the
    Gauss-Newton method.
    Only arrays of the size of the constraints are reduced over the ranks (Aage & Lazarov,
    Struct. Multidiscip. Optim. 47, 2013). Equations and default parameters: K. Svanberg, "MMA and
    GCMMA – two methods for nonlinear optimization", 2007; GCMMA's convergence: K. Svanberg, SIAM
    J. Optim. 12(2), 2002.

    Attributes:
        comm: Communicator over which the variables are distributed.
        lower, upper: Finite bounds; a variable with equal bounds keeps its value.
        constraints: Number m of constraints, which should be scaled to O(1).
        options: Svanberg's parameters.
        move: Move limit of each variable over its range; None: that of the options for all.
        residuals: Number of rₖ.
        resolution: Part of its range to which a variable is rounded in proposed points, so that
            steps do not depend on the rounding of gradients; None for Svanberg's method as it is.
        state: What a run continues from.
    """

    comm: MPI.Comm
    lower: Floats
    upper: Floats
    constraints: int = 0
    options: MMAOptions = field(default_factory=MMAOptions)
    move: Floats | None = None
    residuals: int = field(default=0, kw_only=True)
    resolution: float | None = field(default=None, kw_only=True)
    state: MMAState = field(default_factory=MMAState, init=False)

    def __post_init__(self) -> None:
        require_comm(self.comm)
        require_count(0, constraints=self.constraints, residuals=self.residuals)
        require_kind("options", self.options, MMAOptions, "MMAOptions")
        if self.resolution is not None:
            require_positive(resolution=self.resolution, at_most=1.0)
        with together(self.comm):
            self.lower, self.upper = _checked_bounds(self.lower, self.upper)
            if self.move is not None:
                what = "one move limit for each owned variable"
                shape = self.lower.shape
                self.move = checked_floats("move", self.move, what, shape, finite=False)
                for limit in np.sort(self.move)[[0, -1]] if self.move.size else ():
                    require_positive(move=limit, at_most=1.0)
        self._span = self.upper - self.lower
        self._unit = None if self.resolution is None else self.resolution * self._span
        self._rows = self.constraints + 2 * self.residuals
        self._here: Functions | None = None
        self._model: Approximation | None = None

    def step(self, x: Floats, here: Functions) -> Floats:
        """Return the next proposed point; all functions at x have gradients (collective)."""
        here.require_all(self.constraints, self.residuals, gradients=True)
        here.require_finite(self.comm, len(self._span))
        state, x = self.state, np.array(x, dtype=np.float64)
        distance = self._distance(x)
        state.before_previous, state.previous, state.distance = state.previous, x, distance
        if state.curvature is None:
            state.curvature = np.zeros(self._rows + 1)
        state.curvature = CURVATURE_DECAY * state.curvature
        self._here = here
        move: float | Floats = self.options.move if self.move is None else self.move
        bounds = self.lower, self.upper
        self._model = Approximation(self.comm, x, distance, bounds, move, here.slopes)
        return self._proposed(self._model)

    def conservative(self, x: Floats, there: Functions) -> bool:
        """Return whether no function exceeds its approximation at the proposed point (collective).

        Values are infinite where they do not exist.
        """
        there.require_all(self.constraints, self.residuals)
        excess, _ = self._excess(x, there)
        return bool(np.all(excess <= 0))

    def retry(self, x: Floats, there: Functions) -> Floats:
        """Return a more cautious point than a rejected one (collective).

        A function that exceeds its approximation by δᵢ d(x) there gets the curvature
        min(1.1 (ρᵢ + δᵢ), 10 ρᵢ) (section 4), where ρᵢ is at least GCMMA's initial curvature. Where
        a value is infinite, or all approximations are conservative and the caller still rejects x,
        all curvatures are multiplied by ten. If the same x results, for example at its move limits,
        and is not conservative, the curvatures are raised again. If values and residuals are left
        out, only f₀ is tested.
        """
        if len(there.values) or len(there.residuals):
            there.require_all(self.constraints, self.residuals)
        before, state = x, self.state
        excess, distance = self._excess(x, there)
        model = self._model
        assert model is not None
        assert state.curvature is not None
        # A tenth of the mean |∂fᵢ/∂xⱼ| (x̄ⱼ − x̲ⱼ), weighted by dⱼ here.
        least = np.maximum(0.2 * model.size / max(model.total_weight, TINY), 1e-6)
        for _ in range(RAISES):
            limit = 10 * np.maximum(state.curvature, least)
            if np.all(np.isfinite(excess)) and np.any(excess > 0):
                rise = 1.1 * (state.curvature + excess / max(distance, TINY))
                state.curvature = np.where(excess > 0, np.minimum(rise, limit), state.curvature)
            else:
                state.curvature = limit
            x = self._proposed(model)
            if largest(self.comm, np.max(np.abs(x - before), initial=0.0)) > 0:
                break
            excess, distance = self._excess(x, there)
            if not np.any(excess > 0):  # the caller may accept it now
                break
        return x

    def rescale(self, factor: float) -> None:
        """Multiply the unit of f₀ and Σ rₖ² by a factor, from the next step on.

        The next proposed point does not change, except for the constant 1e-5 that keeps the
        approximations convex.
        """
        state, m, root = self.state, self.constraints, factor**0.5
        state.unit *= factor
        if state.curvature is not None:
            state.curvature[0] *= factor
            state.curvature[1 + m :] *= root
        if state.multipliers is not None:
            state.multipliers[:m] *= factor
            state.multipliers[m:] *= root

    def kkt_residual(self, x: Floats, here: Functions) -> float:
        """Return the residual of the optimality conditions at x (collective).

        It is the largest entry of the natural residual, which is zero at KKT points only.
        With ξⱼ = (xⱼ − x̲ⱼ)/(x̄ⱼ − x̲ⱼ), the last subproblem's λ, L = f₀ + Σ rₖ² + Σ λᵢfᵢ in the
        units before any `rescale`, and N the number of variables with a range, it is

            |ξⱼ − clip(ξⱼ − N ∂L/∂ξⱼ, 0, 1)|  for each of these, and  |min(λᵢ, −fᵢ)|.

        The factor N makes it independent of the mesh for densities, since ∂L/∂ξⱼ is proportional to
        the area of a triangle. Other variables count N times. Functions come with their gradients;
        the squares of residuals that are left out are a part of f₀.
        """
        here.require_all(self.constraints, len(here.residuals), gradients=True)
        assert here.gradient is not None
        multipliers = self.state.multipliers
        lam = np.zeros(self.constraints) if multipliers is None else multipliers[: self.constraints]
        slope = here.gradient.copy()
        for weight, row in zip(lam, here.jacobian, strict=True):
            slope += weight * row
        for residual, row in zip(here.residuals, here.residual_jacobian, strict=True):
            slope += 2 * residual * row
        ranged = self._span > 0
        slope *= total(self.comm, np.count_nonzero(ranged)) / self.state.unit * self._span
        place = (x - self.lower) / np.where(ranged, self._span, 1.0)
        gap = np.abs(place - np.clip(place - slope, 0.0, 1.0))[ranged]
        values = np.asarray(here.values, dtype=np.float64)
        complementarity = np.abs(np.minimum(lam / self.state.unit, -values))
        worst = float(np.max(complementarity, initial=0))
        return max(largest(self.comm, np.max(gap, initial=0.0)), worst)

    def _distance(self, x: Floats) -> Floats:
        """Return the distance of the asymptotes from x (Svanberg 2007, eqs. 3.11-3.14).

        His factor jumps where one of the last two moves changes its sign. With a resolution it
        passes through 1 there, so that a difference of one unit cannot change the next step much.
        """
        state, o, span = self.state, self.options, self._span
        if state.previous is None or state.before_previous is None or state.distance is None:
            return o.asymptote_start * span
        move, before = x - state.previous, state.previous - state.before_previous
        turn = move * before
        if self._unit is None:
            turn = np.sign(turn)
        else:
            turn = turn / np.maximum(move**2 + before**2 + self._unit**2, TINY)
            turn = np.clip(GRADED * turn, -1.0, 1.0)
        factor = np.where(turn > 0, o.asymptote_grow - 1, 1 - o.asymptote_shrink) * turn + 1
        return np.clip(factor * state.distance, 0.01 * span, 10 * span)

    def _excess(self, x: Floats, there: Functions) -> tuple[Floats, float]:
        """Return by how much each function exceeds its approximation, and d(x) of `retry`."""
        assert self._model is not None
        assert self._here is not None
        change, distance = self._model.change_at(x)
        here, found = self._here.numbers, there.numbers
        found[~np.isfinite(found)] = np.inf
        count = len(found)
        excess: Floats = np.zeros(self._rows + 1)
        excess[:count] = found - here[:count] - change[:count]
        noise = ROUNDING * (np.abs(here) + self._model.size)
        excess[excess <= noise] = 0.0
        # Where r exceeds its approximation, often that of −r limits x, and vice versa.
        pairs = excess[1 + self.constraints :].reshape(2, -1)
        pairs[:] = pairs.max(axis=0)
        return excess, distance

    def _proposed(self, model: Approximation) -> Floats:
        """Return the solution of the subproblem with the curvatures of the state."""
        state = self.state
        assert self._here is not None
        model.curvature = SMALL + np.asarray(state.curvature)
        counts, unit = [self.constraints, 2 * self.residuals], state.unit
        penalty = Penalty(
            np.repeat([self.options.penalty * unit, 0.0], counts),
            np.repeat([unit, 2.0], counts),
        )
        values, tolerance = self._here.numbers[1:], self.options.tolerance
        found = solve_subproblem(model, values, penalty, state.multipliers, tolerance)
        state.multipliers = found.multipliers
        x = model.minimizer(found.multipliers)
        if self._unit is None:
            return x
        return np.clip(self.lower + rounded(x - self.lower, self._unit), self.lower, self.upper)


def _checked_bounds(lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Return the bounds of the owned variables, checked."""
    what = "a bound of each owned variable"
    lower, upper = real_numbers("lower", lower, what), real_numbers("upper", upper, what)
    alike = lower.ndim == 1 and lower.shape == upper.shape
    if not (alike and np.isfinite(upper - lower).all() and (upper >= lower).all()):
        raise ParameterError(
            f"lower, of shape {lower.shape}, and upper, of shape {upper.shape}, must hold {what}, "
            "finite and in this order."
        )
    return lower.copy(), upper.copy()
