"""Method of moving asymptotes, distributed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.errors import ParameterError
from toros_fem.parameters import require_between, require_positive

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


@dataclass(frozen=True)
class _Subproblem:
    """The convex separable problem that stands for the true one (Svanberg 2007, eqs. 3.1, 5.1).

    min Σⱼ p₀ⱼ/(Uⱼ−xⱼ) + q₀ⱼ/(xⱼ−Lⱼ) + Σᵢ cᵢyᵢ + ½yᵢ² subject to
    Σⱼ pᵢⱼ/(Uⱼ−xⱼ) + qᵢⱼ/(xⱼ−Lⱼ) − yᵢ ≤ bᵢ, α ≤ x ≤ β, y ≥ 0: a₀ = 1, aᵢ = 0, dᵢ = 1, so z = 0.
    """

    p0: Floats
    q0: Floats
    p: Floats
    q: Floats
    b: Floats
    low: Floats
    upp: Floats
    alpha: Floats
    beta: Floats
    c: Floats


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
        worst = self._comm.allreduce(
            float(np.min(self._upper - self._lower, initial=np.inf)), op=MPI.MIN
        )
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
        self._data = (value, gradient.array.copy(), np.asarray(values, dtype=float), rows)
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
        predicted, distance = self._sum(np.array([model.sum(), unit.sum()]))
        missing = (value - self._data[0] - predicted) / max(distance, np.finfo(float).tiny)
        if np.isfinite(missing):
            state.curvature = 1.1 * (state.curvature + max(missing, 0.0))
        else:
            state.curvature = max(10 * state.curvature, 1e-3)
        self._propose(x)

    def _propose(self, x: PETSc.Vec) -> None:
        self._sub = sub = self._approximate(*self._data)
        if self._m == 0:
            x.array[:], self.state.multipliers = _unconstrained(sub), np.zeros(0)
        else:
            x.array[:], self.state.multipliers = self._solve(sub)

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

    def _approximate(self, _: float, df0: Floats, f: Floats, df: Floats) -> _Subproblem:
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
        b = self._sum(local) - f
        return _Subproblem(p0, q0, p, q, b, low, upp, alpha, beta, np.full(self._m, o.penalty))

    def _sum(self, local: Floats) -> Floats:
        out = np.empty_like(local)
        self._comm.Allreduce(np.ascontiguousarray(local), out)
        return out

    def _solve(self, sub: _Subproblem) -> tuple[Floats, Floats]:
        """Primal-dual interior point on the subproblem (Svanberg 2007, section 5)."""
        point = _start(sub)
        barrier = 1.0
        while barrier > 0.1 * self.options.tolerance:
            barrier *= 0.1
            for _ in range(200):
                size = self._residual(sub, point, barrier)
                if size[1] < 0.9 * barrier:
                    break
                direction = self._direction(sub, point, barrier)
                share = self._longest(sub, point, direction)
                while share > 1e-12:
                    trial = point.moved(direction, share)
                    if self._residual(sub, trial, barrier)[0] < size[0]:
                        break
                    share /= 2
                else:
                    break  # rounding: no step lowers the residual any more
                point = trial
        return np.clip(point.x, sub.alpha, sub.beta), point.lam

    def _residual(self, sub: _Subproblem, v: _Point, barrier: float) -> tuple[float, float]:
        """Euclidean and maximum norm of the relaxed optimality conditions."""
        up, lo = sub.upp - v.x, v.x - sub.low
        g = self._sum((sub.p / up + sub.q / lo).sum(axis=1))
        slope = (sub.p0 + v.lam @ sub.p) / up**2 - (sub.q0 + v.lam @ sub.q) / lo**2
        local = [
            slope - v.xsi + v.eta,
            v.xsi * (v.x - sub.alpha + v.slack) - barrier,
            v.eta * (sub.beta - v.x + v.slack) - barrier,
        ]
        shared = np.concatenate(
            [
                sub.c + v.y - v.mu - v.lam,
                g - v.y + v.s - sub.b,
                v.mu * v.y - barrier,
                v.lam * v.s - barrier,
            ]
        )
        squares = self._sum(np.array([sum(float(r @ r) for r in local)]))[0]
        top = max((float(np.abs(r).max(initial=0)) for r in local), default=0.0)
        top = self._comm.allreduce(top, op=MPI.MAX)
        return (
            float(np.sqrt(squares + shared @ shared)),
            max(top, float(np.abs(shared).max(initial=0))),
        )

    def _direction(self, sub: _Subproblem, v: _Point, barrier: float) -> _Point:
        up, lo = sub.upp - v.x, v.x - sub.low
        at_alpha, at_beta = v.x - sub.alpha + v.slack, sub.beta - v.x + v.slack
        plam, qlam = sub.p0 + v.lam @ sub.p, sub.q0 + v.lam @ sub.q
        G = sub.p / up**2 - sub.q / lo**2
        g = self._sum((sub.p / up + sub.q / lo).sum(axis=1))
        curve = 2 * (plam / up**3 + qlam / lo**3) + v.xsi / at_alpha + v.eta / at_beta
        dx_rhs = plam / up**2 - qlam / lo**2 - barrier / at_alpha + barrier / at_beta
        dy_rhs = sub.c + v.y - v.lam - barrier / v.y
        y_curve = 1 + v.mu / v.y
        lam_rhs = g - v.y - sub.b + barrier / v.lam
        m = len(v.lam)
        scaled = G / curve
        sums = self._sum(np.concatenate([(scaled @ G.T).ravel(), scaled @ dx_rhs]))
        system = sums[: m * m].reshape(m, m) + np.diag(v.s / v.lam + 1 / y_curve)
        dlam = np.asarray(
            np.linalg.solve(system, lam_rhs + dy_rhs / y_curve - sums[m * m :]), dtype=np.float64
        )
        dx = -(dx_rhs + dlam @ G) / curve
        dy = (dlam - dy_rhs) / y_curve
        return _Point(
            x=dx,
            y=dy,
            lam=dlam,
            xsi=-v.xsi + (barrier - v.xsi * dx) / at_alpha,
            eta=-v.eta + (barrier + v.eta * dx) / at_beta,
            mu=-v.mu + (barrier - v.mu * dy) / v.y,
            s=-v.s + (barrier - v.s * dlam) / v.lam,
            slack=v.slack,
        )

    def _longest(self, sub: _Subproblem, v: _Point, d: _Point) -> float:
        """Longest step ≤ 1 that keeps everything positive, with 1 % to spare."""
        worst = 1 / 1.01
        pairs = [
            (v.x - sub.alpha + v.slack, d.x),
            (sub.beta - v.x + v.slack, -d.x),
            (v.y, d.y),
            (v.lam, d.lam),
            (v.xsi, d.xsi),
            (v.eta, d.eta),
            (v.mu, d.mu),
            (v.s, d.s),
        ]
        for value, change in pairs:
            worst = max(worst, float(np.max(-change / value, initial=0.0)))
        return 1 / (1.01 * float(self._comm.allreduce(worst, op=MPI.MAX)))


@dataclass(frozen=True)
class _Point:
    x: Floats
    y: Floats
    lam: Floats
    xsi: Floats
    eta: Floats
    mu: Floats
    s: Floats
    slack: Floats  # widens the box of fixed variables, whose α = β leaves no interior

    def moved(self, d: _Point, share: float) -> _Point:
        names = ("x", "y", "lam", "xsi", "eta", "mu", "s")
        return _Point(
            **{name: getattr(self, name) + share * getattr(d, name) for name in names},
            slack=self.slack,
        )


def _start(sub: _Subproblem) -> _Point:
    x = (sub.alpha + sub.beta) / 2
    ones = np.ones(len(sub.b))
    slack = np.where(sub.beta - sub.alpha > 1e-12, 0.0, 1.0)
    return _Point(
        x=x,
        y=ones.copy(),
        lam=ones.copy(),
        xsi=np.maximum(1, 1 / (x - sub.alpha + slack)),
        eta=np.maximum(1, 1 / (sub.beta - x + slack)),
        mu=np.maximum(1, sub.c / 2),
        s=ones.copy(),
        slack=slack,
    )


def _unconstrained(sub: _Subproblem) -> Floats:
    """Without constraints each variable stands alone and has a closed form."""
    p, q = np.sqrt(sub.p0), np.sqrt(sub.q0)
    return np.asarray(np.clip((sub.low * p + sub.upp * q) / (p + q), sub.alpha, sub.beta))
