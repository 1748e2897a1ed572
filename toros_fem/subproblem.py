"""MMA's subproblem: convex, separable, solved by an interior point over all ranks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._mpi import largest, sum_over_ranks

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Subproblem:
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


def solve_subproblem(comm: MPI.Comm, sub: Subproblem, tolerance: float) -> tuple[Floats, Floats]:
    """Variables and multipliers of the subproblem's solution (collective).

    By a primal-dual interior point (Svanberg 2007, section 5.4); without constraints each
    variable stands alone and has a closed form.

    Args:
        comm: Communicator that the variables are spread over.
        sub: The subproblem: its variables' entries owned, its constraints' the same on all ranks.
        tolerance: Residual of the optimality conditions to reach.
    """
    if len(sub.b) == 0:
        return _unconstrained(sub), np.zeros(0)
    point = _start(sub)
    barrier = 1.0
    while barrier > 0.1 * tolerance:
        barrier *= 0.1
        for _ in range(200):
            size = _residual(comm, sub, point, barrier)
            if size[1] < 0.9 * barrier:
                break
            direction = _direction(comm, sub, point, barrier)
            share = _longest(comm, sub, point, direction)
            while share > 1e-12:
                trial = point.moved(direction, share)
                if _residual(comm, sub, trial, barrier)[0] < size[0]:
                    break
                share /= 2
            else:
                break  # rounding: no step lowers the residual any more
            point = trial
    return np.clip(point.x, sub.alpha, sub.beta), point.lam


def _residual(comm: MPI.Comm, sub: Subproblem, v: _Point, barrier: float) -> tuple[float, float]:
    """Euclidean and maximum norm of the relaxed optimality conditions."""
    up, lo = sub.upp - v.x, v.x - sub.low
    g = sum_over_ranks(comm, (sub.p / up + sub.q / lo).sum(axis=1))
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
    squares = sum_over_ranks(comm, np.array([sum(float(r @ r) for r in local)]))[0]
    top = max((float(np.abs(r).max(initial=0)) for r in local), default=0.0)
    return (
        float(np.sqrt(squares + shared @ shared)),
        max(largest(comm, top), float(np.abs(shared).max(initial=0))),
    )


def _direction(comm: MPI.Comm, sub: Subproblem, v: _Point, barrier: float) -> _Point:
    up, lo = sub.upp - v.x, v.x - sub.low
    at_alpha, at_beta = v.x - sub.alpha + v.slack, sub.beta - v.x + v.slack
    plam, qlam = sub.p0 + v.lam @ sub.p, sub.q0 + v.lam @ sub.q
    G = sub.p / up**2 - sub.q / lo**2
    g = sum_over_ranks(comm, (sub.p / up + sub.q / lo).sum(axis=1))
    curve = 2 * (plam / up**3 + qlam / lo**3) + v.xsi / at_alpha + v.eta / at_beta
    dx_rhs = plam / up**2 - qlam / lo**2 - barrier / at_alpha + barrier / at_beta
    dy_rhs = sub.c + v.y - v.lam - barrier / v.y
    y_curve = 1 + v.mu / v.y
    lam_rhs = g - v.y - sub.b + barrier / v.lam
    m = len(v.lam)
    scaled = G / curve
    sums = sum_over_ranks(comm, np.concatenate([(scaled @ G.T).ravel(), scaled @ dx_rhs]))
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


def _longest(comm: MPI.Comm, sub: Subproblem, v: _Point, d: _Point) -> float:
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
    return 1 / (1.01 * largest(comm, worst))


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


def _start(sub: Subproblem) -> _Point:
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


def _unconstrained(sub: Subproblem) -> Floats:
    """Without constraints each variable stands alone and has a closed form."""
    p, q = np.sqrt(sub.p0), np.sqrt(sub.q0)
    return np.asarray(np.clip((sub.low * p + sub.upp * q) / (p + q), sub.alpha, sub.beta))
