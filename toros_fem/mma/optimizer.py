"""Method of moving asymptotes, distributed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem._mpi import largest, smallest, total
from toros_fem._types import Floats
from toros_fem._validate import require_between, require_positive
from toros_fem.errors import ParameterError
from toros_fem.mma.approximation import TINY, Approximation, blocks
from toros_fem.mma.subproblem import Price, solve_subproblem

Numbers = Sequence[float] | Floats

SMALL = 1e-5  # Svanberg's raa0, which keeps the approximations strictly convex
CURVATURE_DECAY = 0.5  # what a retry has learnt is forgotten at this rate
RAISES = 20  # of curvatures in one retry: each may be tenfold
ROUNDING = 1e-10  # of what a function can change by: nothing less makes it not conservative


@dataclass(frozen=True)
class MMAOptions:
    """Svanberg's parameters; the defaults are his but for the move limit.

    Attributes:
        move: Largest change of a variable over its range, in one iteration.
        asymptote_start: First distance of the asymptotes over the range.
        asymptote_grow, asymptote_shrink: Its factors where a variable goes on, or turns back.
        penalty: cᵢ, the price of violating a constraint by one unit.
        tolerance: Residual to which the subproblem is solved.
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
    """All that the next iteration depends on; plain arrays, so that a run resumes exactly.

    Attributes:
        previous, before_previous: xᵏ of the last two steps.
        distance: Of the asymptotes from `previous`, to both sides.
        multipliers: λᵢ of the last subproblem: of the constraints, of r and of −r.
        curvature: ρᵢ that retries have added, the objective's first.
        unit: What `rescale` has made of the objective's unit: the price of constraints follows.
    """

    previous: Floats | None = None
    before_previous: Floats | None = None
    distance: Floats | None = None
    multipliers: Floats | None = None
    curvature: Floats | None = None
    unit: float = 1.0


class MMA:
    """Svanberg's MMA and GCMMA for min f₀ + Σ rₖ², fᵢ ≤ 0, x̲ ≤ x ≤ x̄ with distributed variables.

    `step` proposes. For plain MMA the proposal is the next iterate. For GCMMA it is so once
    `conservative` finds that no function exceeds its approximation there; until then `retry`
    raises the curvatures of those that do, and proposes anew: then the iterates stay feasible and
    f₀ falls monotonically. A caller with a test of its own may call `retry` without asking.
    Residuals rₖ are approximated each for itself and both ways, rₖ and −rₖ, as constraints whose
    violation costs its square (Svanberg 2007, section 2). So the subproblem knows where their
    squares stop falling, as Gauss and Newton's does.
    Only numbers of the size of the constraints are reduced over the ranks (Aage & Lazarov,
    Struct. Multidiscip. Optim. 47, 2013). Equations and default parameters: K. Svanberg, "MMA and
    GCMMA – two methods for nonlinear optimization", 2007; GCMMA's convergence: K. Svanberg, SIAM
    J. Optim. 12(2), 2002.

    Args:
        lower, upper: Finite bounds; a variable whose bounds are equal stays there.
        constraints: Number m of constraints, which should be scaled to O(1).
        options: Svanberg's parameters.
        move: Move limit of each variable over its range, in place of the options' one for all.
        residuals: Number of rₖ.

    Raises:
        ParameterError: An upper bound lies below its lower bound, a bound is not finite, or a
            move limit lies outside of (0, 1].
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
    ) -> None:
        self._comm: MPI.Comm = lower.comm.tompi4py()
        # PETSc frees this communicator with the last vector on it: that must not be the caller's.
        self._anchor = PETSc.Vec().createMPI(0, comm=lower.comm)
        self._lower, self._upper = lower.array.copy(), upper.array.copy()
        worst = smallest(self._comm, np.min(self._upper - self._lower, initial=np.inf))
        if not worst >= 0:
            raise ParameterError(f"an upper bound lies {-worst:g} below its lower bound.")
        if not np.isfinite(largest(self._comm, np.max(self._upper - self._lower, initial=0.0))):
            raise ParameterError("MMA needs finite bounds of every variable.")
        self.options = options or MMAOptions()
        self._move: float | Floats = self.options.move
        if move is not None:
            self._move = move.array.copy()
            for end in (
                smallest(self._comm, np.min(self._move, initial=1.0)),
                largest(self._comm, np.max(self._move, initial=0.5)),
            ):
                require_positive(move=end, at_most=1.0)
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
        slopes: Sequence[PETSc.Vec] = (),
    ) -> None:
        """Replace x by the next proposal (collective).

        Args:
            x: Current variables, overwritten.
            value: f₀(x), the same on all ranks.
            gradient: ∇f₀(x).
            values: fᵢ(x), the same on all ranks.
            jacobian: ∇fᵢ(x).
            residuals: rₖ(x), the same on all ranks.
            slopes: ∇rₖ(x).
        """
        self._check(values, jacobian)
        if len(residuals) != self._r or len(slopes) != self._r:
            raise ParameterError(
                f"{len(residuals)} residuals and {len(slopes)} slopes for {self._r} residuals."
            )
        state, here = self.state, x.array.copy()
        distance = self._distance(here)
        state.before_previous, state.previous, state.distance = state.previous, here, distance
        if state.curvature is None:
            state.curvature = np.zeros(self._rows + 1)
        state.curvature = CURVATURE_DECAY * state.curvature
        up = [row.array for row in slopes]
        gradients = [gradient.array, *(row.array for row in jacobian), *up, *(-row for row in up)]
        bounds = (self._lower, self._upper)
        self._model.expand(here, distance, bounds, self._move, gradients)
        self._values = _stacked(value, values, residuals)
        # What GCMMA starts from: a tenth of the mean |∂fᵢ/∂xⱼ| (x̄ⱼ − x̲ⱼ), weighted by dⱼ here.
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
        """Whether no function exceeds its approximation at the proposal (collective).

        Args:
            x: The proposal.
            value: f₀ there, the same on all ranks; infinite where it does not exist.
            values: fᵢ there.
            residuals: rₖ there.

        Raises:
            ParameterError: There is no proposal yet, or the counts of numbers are wrong.
        """
        self._count(values, residuals)
        missing, _ = self._missing(x, value, values, residuals)
        return bool(np.all(missing <= 0))

    def retry(
        self,
        x: PETSc.Vec,
        value: float,
        values: Numbers = (),
        residuals: Numbers = (),
    ) -> None:
        """Replace a rejected proposal by a more cautious one (collective).

        A function that exceeds its approximation by δᵢ d(x) there gets the curvature
        min(1.1 (ρᵢ + δᵢ), 10 ρᵢ) (section 4). Where a value is infinite, or all approximations
        are conservative and the caller rejects x nevertheless, all curvatures rise tenfold. What
        proposes the same x again, at its move limits say, and not conservative, is raised again.

        Args:
            x: The proposal, overwritten.
            value: f₀ there, the same on all ranks; infinite where it does not exist.
            values: fᵢ there. Without them, and residuals, all but f₀ count as conservative.
            residuals: rₖ there.

        Raises:
            ParameterError: There is no proposal yet, or the counts of numbers are wrong.
        """
        if len(values) or len(residuals):
            self._count(values, residuals)
        state = self.state
        assert state.curvature is not None
        before = x.array.copy()
        missing, distance = self._missing(x, value, values, residuals)
        for _ in range(RAISES):
            limit = 10 * np.maximum(state.curvature, self._start_curvature)
            if np.all(np.isfinite(missing)) and np.any(missing > 0):
                rise = 1.1 * (state.curvature + missing / max(distance, TINY))
                state.curvature = np.where(missing > 0, np.minimum(rise, limit), state.curvature)
            else:
                state.curvature = limit
            self._propose(x)
            if largest(self._comm, np.max(np.abs(x.array - before), initial=0.0)) > 0:
                break
            missing, distance = self._missing(x, value, values, residuals)
            if not np.any(missing > 0):  # the caller may want it now
                break

    def rescale(self, factor: float) -> None:
        """Take f₀ and Σ rₖ² as so many times what they were, from the next step on.

        But for what keeps the approximations convex, the next proposal is the one it would be.
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

    def kkt(
        self,
        x: PETSc.Vec,
        gradient: PETSc.Vec,
        values: Numbers = (),
        jacobian: Sequence[PETSc.Vec] = (),
    ) -> float:
        """How far x is from satisfying the optimality conditions (collective).

        The largest entry of the natural residual, which is zero at KKT points and there alone.
        With ξⱼ = (xⱼ − x̲ⱼ)/(x̄ⱼ − x̲ⱼ), the last subproblem's λ, L = f₀ + Σ rₖ² + Σ λᵢfᵢ in the
        units before any `rescale`, and N variables that have a range it is

            |ξⱼ − clip(ξⱼ − N ∂L/∂ξⱼ, 0, 1)|  for each of these, and  |min(λᵢ, −fᵢ)|.

        For densities N makes it independent of the mesh: N ∂L/∂ξⱼ is the density of a derivative
        whose single entries shrink as the mesh is refined. Other variables count N times.

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
        shared = np.abs(np.minimum(lam / self.state.unit, -np.asarray(values, dtype=np.float64)))
        return max(largest(self._comm, np.max(gap, initial=0.0)), float(np.max(shared, initial=0)))

    def _check(self, values: Numbers, jacobian: Sequence[PETSc.Vec]) -> None:
        if len(values) != self._m or len(jacobian) != self._m:
            raise ParameterError(
                f"{len(values)} values and {len(jacobian)} gradients for {self._m} constraints."
            )

    def _count(self, values: Numbers, residuals: Numbers) -> None:
        if len(values) != self._m or len(residuals) != self._r:
            raise ParameterError(
                f"{len(values)} values for {self._m} constraints, {len(residuals)} residuals of "
                f"{self._r}."
            )

    def _distance(self, x: Floats) -> Floats:
        """Distance of the asymptotes from x (Svanberg 2007, eqs. 3.11-3.14)."""
        state, o = self.state, self.options
        out = self._upper - self._lower
        if state.before_previous is None:
            out *= o.asymptote_start
            return out
        assert state.previous is not None
        assert state.distance is not None
        for part in blocks(len(x)):
            span = out[part]
            turn = x[part] - state.previous[part]
            turn *= state.previous[part] - state.before_previous[part]
            distance = np.where(turn > 0, o.asymptote_grow, 1.0)
            np.copyto(distance, o.asymptote_shrink, where=turn < 0)
            distance *= state.distance[part]
            np.maximum(distance, 0.01 * span, out=distance)
            np.minimum(distance, 10 * span, out=span)
        return out

    def _missing(
        self, x: PETSc.Vec, value: float, values: Numbers, residuals: Numbers
    ) -> tuple[Floats, float]:
        """By how much each function exceeds its approximation, and d(x) of `retry`."""
        state = self.state
        if state.previous is None or state.distance is None:
            raise ParameterError("there is no proposal yet: call step first.")
        change, distance = self._model.change_at(state.previous, state.distance, x.array)
        there = _stacked(value, values, residuals)
        there[~np.isfinite(there)] = np.inf
        count = len(there)
        missing: Floats = np.zeros(self._rows + 1)
        missing[:count] = there - self._values[:count] - change[:count]
        noise = ROUNDING * (np.abs(self._values) + self._model.size)
        missing[missing <= noise] = 0.0
        # Where one of r and −r exceeds its approximation, it is often the other that holds x.
        pairs = missing[1 + self._m :].reshape(2, -1)
        pairs[:] = pairs.max(axis=0)
        return missing, distance

    def _propose(self, x: PETSc.Vec) -> None:
        state, model = self.state, self._model
        assert state.curvature is not None
        assert state.previous is not None
        assert state.distance is not None
        model.curvature = SMALL + state.curvature
        counts, unit = [self._m, 2 * self._r], state.unit
        price = Price(
            np.repeat([self.options.penalty * unit, 0.0], counts),
            np.repeat([unit, 2.0], counts),
        )
        tolerance = self.options.tolerance
        found = solve_subproblem(model, self._values[1:], price, state.multipliers, tolerance)
        state.multipliers = found.multipliers
        bounds = (self._lower, self._upper)
        model.minimiser(found.multipliers, state.previous, state.distance, bounds, x.array)


def _stacked(value: float, values: Numbers, residuals: Numbers) -> Floats:
    """f₀, fᵢ, r and −r, which are functions of their own to the approximations."""
    r = np.asarray(residuals, dtype=np.float64)
    return np.concatenate([[value], np.asarray(values, dtype=np.float64), r, -r])
