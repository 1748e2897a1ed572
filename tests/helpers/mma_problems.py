"""Optimisation problems with known solutions, and random subproblems of MMA."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.design.mma.subproblem import Approximation, Penalty, Solution, solve_subproblem

Problem = Callable[[np.ndarray], tuple[float, np.ndarray, list[float], list[np.ndarray]]]


def beam(x: np.ndarray) -> tuple[float, np.ndarray, list[float], list[np.ndarray]]:
    """Svanberg 1987: the cantilever of five box sections."""
    c = np.array([61.0, 37, 19, 7, 1])
    return 0.0624 * x.sum(), np.full(5, 0.0624), [float((c / x**3).sum() - 1)], [-3 * c / x**4]


SMALL = 1e-5


@dataclass
class Case:
    """The data of a subproblem."""

    x: np.ndarray
    distance: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    gradients: np.ndarray
    values: np.ndarray
    curvature: np.ndarray
    penalty: float = 1000.0
    move: float = 1.0

    def approximation(self) -> Approximation:
        bounds, rows = (self.lower, self.upper), list(self.gradients)
        model = Approximation(MPI.COMM_SELF, self.x, self.distance, bounds, self.move, rows)
        model.curvature = self.curvature
        return model

    def solve(self, start: np.ndarray | None = None) -> tuple[np.ndarray, Solution]:
        model, ones = self.approximation(), np.ones(len(self.values))
        penalty = Penalty(self.penalty * ones, ones)
        solution = solve_subproblem(model, self.values, penalty, start, 1e-9)
        return model.minimizer(solution.multipliers), solution

    def classical(self) -> tuple[np.ndarray, ...]:
        """Svanberg's p, q, b, asymptotes and box, as his paper writes them."""
        span = self.upper - self.lower
        d = np.where(span > 0, self.distance, 1.0)
        low, upp = self.x - d, self.x + d
        rise, fall = np.maximum(self.gradients, 0), np.maximum(-self.gradients, 0)
        bend = self.curvature[:, None] / np.where(span > 0, span, 1.0)
        p = (upp - self.x) ** 2 * (1.001 * rise + 0.001 * fall + bend)
        q = (self.x - low) ** 2 * (0.001 * rise + 1.001 * fall + bend)
        b = (p[1:] / (upp - self.x) + q[1:] / (self.x - low)).sum(axis=1) - self.values
        limits = 0.9 * d, self.move * span
        alpha = np.maximum.reduce([self.lower, *(self.x - limit for limit in limits)])
        beta = np.minimum.reduce([self.upper, *(self.x + limit for limit in limits)])
        return p, q, b, low, upp, alpha, beta


def random_case(seed: int, n: int, m: int, **changes: object) -> Case:
    rng = np.random.default_rng(seed)
    lower, upper = -rng.random(n), rng.random(n)
    x = lower + (upper - lower) * rng.random(n)
    distance = (upper - lower) * (0.1 + rng.random(n))
    gradients = rng.standard_normal((m + 1, n)) / n
    values = 0.2 * rng.random(m) * np.abs(gradients[1:] * distance).sum(axis=1)
    case = Case(x, distance, lower, upper, gradients, values, np.full(m + 1, SMALL))
    for name, value in changes.items():
        setattr(case, name, value)
    return case
