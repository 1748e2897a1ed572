"""MMA's subproblem against independent solvers, and where it is hard."""

import numpy as np
import pytest
from helpers.mma_problems import Case, random_case
from mmapy import subsolv

from toros_fem.design.mma import subproblem
from toros_fem.design.mma.subproblem import Solution


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


def check_optimality(case: Case, x: np.ndarray, solution: Solution, tolerance: float) -> None:
    """The conditions as the paper has them: those of x, and of λ and y."""
    p, q, b, low, upp, alpha, beta = case.classical()
    lam = solution.multipliers
    weights = np.concatenate([[1.0], lam])
    assert np.all((x >= case.lower) & (x <= case.upper))
    assert np.all((x >= alpha - 1e-14) & (x <= beta + 1e-14))
    slope = (weights @ p) / (upp - x) ** 2 - (weights @ q) / (x - low) ** 2
    steep = (weights @ p) / (upp - x) ** 2 + (weights @ q) / (x - low) ** 2
    below, above = x < beta - 1e-12, x > alpha + 1e-12
    assert np.all(slope[below] >= -1e-10 * steep[below])
    assert np.all(slope[above] <= 1e-10 * steep[above])
    g = (p[1:] / (upp - x) + q[1:] / (x - low)).sum(axis=1) - b
    y = np.maximum(lam - case.penalty, 0)
    size = np.abs(case.values) + np.abs(case.gradients[1:] * case.distance).sum(axis=1)
    error = tolerance * size + np.where(lam >= case.penalty, 1e-15 * lam, 0.0)  # y's rounding
    assert np.all(lam >= 0)
    assert np.all(g - y <= error)
    assert np.all(np.abs(g - y)[lam > 0] <= error[lam > 0])


@pytest.mark.filterwarnings("ignore:Ill-conditioned matrix")  # theirs, at a barrier that low
@pytest.mark.parametrize("infeasible", [False, True])
@pytest.mark.parametrize("m", [1, 2, 5])
def test_equals_mmapy(m: int, infeasible: bool) -> None:
    for seed in range(4):
        case = random_case(seed, 40, m)
        if infeasible:
            case.values += 3 * np.abs(case.gradients[1:] * case.distance).sum(axis=1)
        x, solution = case.solve()
        p, q, b, low, upp, alpha, beta = case.classical()
        columns = [v[:, None] for v in (low, upp, alpha, beta, p[0], q[0])]
        ones = np.ones((m, 1))
        theirs = subsolv(
            m, 40, 1e-13, *columns, p[1:], q[1:], 1.0, 0 * ones, b[:, None], 1000 * ones, ones
        )
        assert x == pytest.approx(theirs[0].ravel(), abs=1e-8)
        assert solution.multipliers == pytest.approx(theirs[3].ravel(), rel=1e-8, abs=1e-8)
        assert np.maximum(solution.multipliers - 1000, 0) == pytest.approx(
            theirs[1].ravel(), abs=1e-8
        )
        assert np.all(solution.multipliers > 1000) or not infeasible
        assert np.any(solution.multipliers > 1e-3), "a constraint counts"


def test_without_constraints_nothing_is_to_be_found() -> None:
    x, solution = (case := random_case(0, 40, 0)).solve()
    assert solution.evaluations == solution.residual == len(solution.multipliers) == 0
    check_optimality(case, x, solution, 0.0)


@pytest.mark.parametrize("m", [1, 3, 20])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_random_ones_satisfy_the_conditions(m: int, scale: float) -> None:
    rng = np.random.default_rng(m)
    for seed in range(8):
        case = random_case(seed, 200, m, move=0.2)
        case.gradients *= scale * 10.0 ** rng.uniform(-2, 2, size=(m + 1, 1))
        case.values = rng.normal(size=m) * np.abs(case.gradients[1:] * case.distance).sum(axis=1)
        if seed % 2:
            fixed = rng.random(200) < 0.3
            case.lower[fixed] = case.upper[fixed] = case.x[fixed]
            case.distance[fixed] = 0.0
        x, solution = case.solve(rng.random(m) * 10.0 ** rng.uniform(-3, 5) if seed > 4 else None)
        assert solution.residual <= 1e-9
        assert solution.evaluations <= 60
        check_optimality(case, x, solution, 1e-8)


def test_hard_ones() -> None:
    """Where W is linear in places, or its Hessian singular."""
    n = 30
    same = random_case(1, n, 4)
    same.gradients[2:] = same.gradients[1]
    same.values[:] = same.values[0]
    alike = random_case(2, n, 2)
    for name in ("x", "distance", "lower", "upper"):
        getattr(alike, name)[:] = getattr(alike, name)[0]
    alike.gradients[:] = np.array([[-1.0], [1.0], [-0.2]])
    alike.values[:] = 0.1 * n * alike.distance[0], -1.0
    stuck = random_case(3, n, 2)
    stuck.lower[:] = stuck.upper[:] = stuck.x
    stuck.distance[:] = 0.0
    stuck.values[:] = 0.3, -0.3
    pushed = random_case(4, n, 2, move=1e-3)  # all x at bounds for most multipliers
    pushed.values[:] = 1e-4, -1e-4
    flat = random_case(5, n, 2)
    flat.gradients[1] = 0.0
    more = random_case(6, 2, 5)  # more constraints than variables
    for case in (same, alike, stuck, pushed, flat, more):
        for start in (None, np.zeros(len(case.values)), np.full(len(case.values), 2e4)):
            x, solution = case.solve(start)
            assert solution.residual <= 1e-9
            assert solution.evaluations <= 60
            check_optimality(case, x, solution, 1e-8)
    assert np.array_equal(stuck.solve()[0], stuck.x)
    assert stuck.solve()[1].multipliers == pytest.approx([1000.3, 0])


def test_a_start_changes_the_way_and_not_the_solution() -> None:
    case = random_case(7, 300, 3)
    x, cold = case.solve()
    again, warm = case.solve(cold.multipliers)
    assert warm.evaluations == 2 < cold.evaluations, "one Newton step more"
    assert warm.residual < 0.1 * cold.residual
    assert again == pytest.approx(x, abs=1e-8)
    same, third = case.solve(warm.multipliers)
    assert third.evaluations == 1, "solved to rounding"
    assert np.array_equal(same, again)
    for start in (np.zeros(3), np.full(3, 1e5)):
        other, solution = case.solve(start)
        assert other == pytest.approx(x, abs=1e-7)
        assert solution.evaluations > 1
