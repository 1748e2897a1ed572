"""MMA's separable approximations against Svanberg's formulas."""

import numpy as np
import pytest
from helpers.mma_problems import Case, random_case

from toros_fem.design.mma import subproblem


def values(case: Case, x: np.ndarray) -> np.ndarray:
    """Σ p/(U − x) + q/(x − L), objective first."""
    p, q, _, low, upp, _, _ = case.classical()
    return np.asarray((p / (upp - x) + q / (x - low)).sum(axis=1))


def test_change_against_svanbergs_formula() -> None:
    case = random_case(0, 200, 3, curvature=np.array([0.1, 0.0, 2.0, 1e-5]))
    model = case.approximation()
    trial = case.x + 0.7 * case.distance * np.random.default_rng(1).uniform(-1, 1, 200)
    change, by_curvature = model.change_at(trial)
    assert change == pytest.approx(values(case, trial) - values(case, case.x), rel=1e-10)
    step = 1e-3
    model.curvature = case.curvature + step
    more, _ = model.change_at(trial)
    assert (more - change) / step == pytest.approx(by_curvature, rel=1e-8)
    assert model.size == pytest.approx(np.abs(case.gradients * case.distance).sum(axis=1))


def test_dual_is_the_minimum_over_x() -> None:
    """No other point of the box has a smaller Lagrangian; its second derivatives by differences."""
    case = random_case(3, 60, 2, move=0.4)
    model = case.approximation()
    multipliers = np.array([0.7, 1.9])
    weights = np.append(1.0, multipliers)
    change, hessian = model.evaluate_dual(multipliers)
    x = model.minimizer(multipliers)
    assert model.change_at(x)[0] == pytest.approx(change, rel=1e-12)
    least = weights @ change
    low, high = case.classical()[-2:]
    rng = np.random.default_rng(0)
    for scale in (1.0, 0.1, 1e-3):
        for _ in range(20):
            other = np.clip(x + scale * rng.uniform(-1, 1, 60) * (high - low), low, high)
            assert weights @ model.change_at(other)[0] > least
    step = 1e-6
    for k in range(2):
        plus, minus = (
            model.evaluate_dual(multipliers + s * step * np.eye(2)[k])[0][1:] for s in (1, -1)
        )
        assert -(plus - minus) / (2 * step) == pytest.approx(hessian[k], rel=1e-4)


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    case = random_case(8, 1000, 2)
    whole, _ = case.solve()
    monkeypatch.setattr(subproblem, "BLOCK", 64)
    assert case.solve()[0] == pytest.approx(whole, abs=1e-9)
    assert [part.stop for part in subproblem.cache_blocks(150)] == [64, 128, 150]


def test_a_variable_without_range_stays() -> None:
    case = random_case(4, 10, 1)
    case.lower[3] = case.upper[3] = case.x[3]
    case.distance[3] = 0.0
    x, _ = case.solve()
    assert x[3] == case.x[3]
    assert np.all(np.delete(x, 3) != np.delete(case.x, 3))
