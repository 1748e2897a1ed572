"""Method of moving asymptotes, distributed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem._mpi import smallest, sum_over_ranks
from toros_fem.errors import ParameterError
from toros_fem.parameters import require_between, require_positive
from toros_fem.subproblem import Subproblem, solve_subproblem

Floats = npt.NDArray[np.float64]

SMALL = 1e-5  # Svanberg's raa0, which keeps the approximation strictly convex
CURVATURE_DECAY = 0.5  # what a retry has learnt is forgotten at this rate


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
    """All that the next iteration depends on; plain arrays, so that a run resumes exactly."""

    previous: Floats | None = None
    before_previous: Floats | None = None
    low: Floats | None = None
    upp: Floats | None = None
    multipliers: Floats | None = None
    curvature: float = 0.0


class MMA:
    """Svanberg's MMA for min f₀(x), fᵢ(x) ≤ 0, x̲ ≤ x ≤ x̄ with distributed variables.

    `step` proposes; whoever finds the objective risen there may call `retry`, which raises the
    curvature of the approximation as GCMMA does until the proposal descends (eqs. 4.5, 4.7).
    Only numbers of the size of the constraints are reduced over the ranks (Aage & Lazarov 2013).
    Equations and default parameters: K. Svanberg, "MMA and GCMMA – two methods for nonlinear
    optimization", 2007, sections 2, 3 and 5.

    Args:
        lower, upper: Bounds; a variable whose bounds are equal stays there.
        constraints: Number m of constraints, which should be scaled to O(1).
        options: Svanberg's parameters.

    Raises:
        ParameterError: An upper bound lies below its lower bound.
    """

    def __init__(
        self,
        lower: PETSc.Vec,
        upper: PETSc.Vec,
        constraints: int = 0,
        options: MMAOptions | None = None,
    ) -> None:
        self._comm: MPI.Comm = lower.comm.tompi4py()
        self._lower, self._upper = lower.array.copy(), upper.array.copy()
        worst = smallest(self._comm, np.min(self._upper - self._lower, initial=np.inf))
        if not worst >= 0:
            raise ParameterError(f"an upper bound lies {-worst:g} below its lower bound.")
        self._m = constraints
        self.options = options or MMAOptions()
        self.state = MMAState()

    def step(
        self,
        x: PETSc.Vec,
        value: float,
        gradient: PETSc.Vec,
        values: Sequence[float] = (),
        jacobian: Sequence[PETSc.Vec] = (),
    ) -> None:
        """Replace x by the next iterate (collective).

        Args:
            x: Current variables, overwritten.
            value: f₀(x), the same on all ranks.
            gradient: ∇f₀(x).
            values: fᵢ(x), the same on all ranks.
            jacobian: ∇fᵢ(x).
        """
        if len(values) != self._m or len(jacobian) != self._m:
            raise ParameterError(
                f"{len(values)} values and {len(jacobian)} gradients for {self._m} constraints."
            )
        here = x.array.copy()
        rows = np.array([g.array for g in jacobian]).reshape(self._m, len(here))
        state = self.state
        low, upp = self._asymptotes(here)
        state.before_previous, state.previous = state.previous, here
        state.low, state.upp = low, upp
        state.curvature *= CURVATURE_DECAY
        self._value = value
        self._data = (gradient.array.copy(), np.asarray(values, dtype=float), rows)
        self._propose(x)

    def retry(self, x: PETSc.Vec, value: float) -> None:
        """Replace a rejected x by a more cautious one (collective).

        Args:
            x: The rejected variables, overwritten.
            value: f₀ there; infinite where it does not exist.
        """
        state, sub = self.state, self._sub
        here, trial = state.previous, x.array
        assert here is not None
        up, lo = sub.upp - trial, trial - sub.low
        model = sub.p0 / up + sub.q0 / lo - sub.p0 / (sub.upp - here) - sub.q0 / (here - sub.low)
        span = np.maximum(self._upper - self._lower, 1e-5)
        unit = (sub.upp - sub.low) * (trial - here) ** 2 / (up * lo * span)
        predicted, distance = sum_over_ranks(self._comm, np.array([model.sum(), unit.sum()]))
        missing = (value - self._value - predicted) / max(distance, np.finfo(float).tiny)
        if np.isfinite(missing):
            state.curvature = 1.1 * (state.curvature + max(missing, 0.0))
        else:
            state.curvature = max(10 * state.curvature, 1e-3)
        self._propose(x)

    def _propose(self, x: PETSc.Vec) -> None:
        self._sub = sub = self._approximate(*self._data)
        solution = solve_subproblem(self._comm, sub, self.options.tolerance)
        x.array[:], self.state.multipliers = solution

    def _asymptotes(self, x: Floats) -> tuple[Floats, Floats]:
        """Asymptotes of the next approximation (Svanberg 2007, eqs. 3.11-3.14)."""
        state, o = self.state, self.options
        span = self._upper - self._lower
        if state.before_previous is None or state.previous is None:
            low, upp = x - o.asymptote_start * span, x + o.asymptote_start * span
        else:
            assert state.low is not None
            assert state.upp is not None
            turn = (x - state.previous) * (state.previous - state.before_previous)
            factor = np.ones(len(x))
            factor[turn > 0], factor[turn < 0] = o.asymptote_grow, o.asymptote_shrink
            low = x - factor * (state.previous - state.low)
            upp = x + factor * (state.upp - state.previous)
            low = np.clip(low, x - 10 * span, x - 0.01 * span)
            upp = np.clip(upp, x + 0.01 * span, x + 10 * span)
        # A fixed variable has no range: any asymptotes around it do.
        still = np.where(span > 0, 0.0, 1.0)
        return low - still, upp + still

    def _approximate(self, df0: Floats, f: Floats, df: Floats) -> Subproblem:
        """The convex separable approximation (Svanberg 2007, eqs. 3.2-3.8)."""
        state, o = self.state, self.options
        x, low, upp = state.previous, state.low, state.upp
        assert x is not None
        assert low is not None
        assert upp is not None
        span = self._upper - self._lower
        alpha = np.maximum.reduce([self._lower, low + 0.1 * (x - low), x - o.move * span])
        beta = np.minimum.reduce([self._upper, upp - 0.1 * (upp - x), x + o.move * span])

        def split(g: Floats, curvature: float = 0.0) -> tuple[Floats, Floats]:
            rise, fall = np.maximum(g, 0), np.maximum(-g, 0)
            small = (SMALL + curvature) / np.maximum(span, 1e-5)
            p = (upp - x) ** 2 * (1.001 * rise + 0.001 * fall + small)
            q = (x - low) ** 2 * (0.001 * rise + 1.001 * fall + small)
            return p, q

        p0, q0 = split(df0, state.curvature)
        p, q = split(df)
        local = (p / (upp - x) + q / (x - low)).sum(axis=1)
        b = sum_over_ranks(self._comm, local) - f
        return Subproblem(p0, q0, p, q, b, low, upp, alpha, beta, np.full(self._m, o.penalty))
