"""MMA for sums of squares: against independent solvers, and against MMA that sees only the sum."""

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import lsq_linear

from toros_fem.base.errors import ParameterError
from toros_fem.design.mma.optimizer import MMA, Functions, MMAOptions

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def springs(n: int, target: np.ndarray) -> Residuals:
    """Weighted means of x³, relative to their targets: like stiffnesses of a grey pattern."""
    rng = np.random.default_rng(2)
    weight = rng.random((len(target), n)) ** 2
    weight /= weight.sum(axis=1, keepdims=True)

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return weight @ x**3 / target - 1, 3 * weight * x**2 / target[:, None]

    return residuals


def count(residuals: Residuals, n: int, least: float, *, apart: bool) -> tuple[int, np.ndarray]:
    """Evaluations until the sum of squares is small enough, by the design loop's rule, and x."""
    x: np.ndarray = np.full(n, 0.5)
    r, slopes = residuals(x)
    mma = MMA(MPI.COMM_SELF, np.zeros(n), np.ones(n), residuals=len(r) if apart else 0)
    tried = 0
    for _ in range(300):
        before = float(r @ r)
        if before <= least:
            return tried, x.copy()
        if apart:
            x = mma.step(x, Functions(0.0, np.zeros(n), residuals=r, residual_jacobian=slopes))
        else:
            x = mma.step(x, Functions(before, 2 * r @ slopes))
        for attempt in range(5):
            r, slopes = residuals(x)
            tried += 1
            if r @ r <= before or attempt == 4:
                break
            if apart:
                x = mma.retry(x, Functions(0.0, residuals=r))
            else:
                x = mma.retry(x, Functions(float(r @ r)))
    return tried, x.copy()


def test_few_steps_where_the_sum_takes_many() -> None:
    residuals = springs(400, np.array([0.10, 0.16, 0.12, 0.14]))
    tried, x = count(residuals, 400, 1e-8, apart=True)
    many, _ = count(residuals, 400, 1e-8, apart=False)
    assert np.all((x >= 0) & (x <= 1))
    assert tried <= 8
    assert many >= 2 * tried


def linear(n: int, k: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((k, n)) / n, 0.3 * rng.standard_normal(k)


def fit(
    a: np.ndarray, b: np.ndarray, steps: int, budget: float | None = None
) -> tuple[np.ndarray, MMA]:
    """Min |Ax − b|² in the unit box, the mean of x under a budget."""
    n = a.shape[1]
    rows = 0 if budget is None else 1
    options = MMAOptions(tolerance=1e-12)
    mma = MMA(MPI.COMM_SELF, np.zeros(n), np.ones(n), rows, options, residuals=len(b))
    x: np.ndarray = np.full(n, 0.4)
    for _ in range(steps):
        values = [] if budget is None else [float(x.mean() / budget - 1)]
        jacobian = [np.full(n, 1 / n / (budget or 1.0))] * rows
        r = a @ x - b
        x = mma.step(x, Functions(0.0, np.zeros(n), values, jacobian, r, a))
        for _ in range(40):
            values = [] if budget is None else [float(x.mean() / budget - 1)]
            if mma.conservative(x, Functions(0.0, values=values, residuals=a @ x - b)):
                break
            x = mma.retry(x, Functions(0.0, values=values, residuals=a @ x - b))
        else:
            pytest.fail("no conservative approximation after 40 attempts")
    return x.copy(), mma


@pytest.mark.parametrize("seed", range(2))
def test_misfit_that_stays_is_the_least(seed: int) -> None:
    a, b = linear(60, 5, seed)
    x, mma = fit(a, b, 60)
    least = 2 * lsq_linear(a, b, (0, 1), tol=1e-13).cost
    r = a @ x - b
    assert r @ r == pytest.approx(least, rel=1e-6)
    assert mma.kkt_residual(x, Functions(0.0, 2 * r @ a)) < 1e-2


def test_small_corrections_are_spread_over_all_variables() -> None:
    """Of all x that meet one linear equation, the one whose largest change is least."""
    n = 80
    slope = np.random.default_rng(0).standard_normal(n) / n
    root = 10**0.5  # as the loop scales it: T is 10
    mma = MMA(MPI.COMM_SELF, np.zeros(n), np.ones(n), residuals=1)
    x: np.ndarray = np.full(n, 0.5)
    x = mma.step(
        x, Functions(0.0, np.zeros(n), residuals=[root], residual_jacobian=[1e3 * root * slope])
    )
    change = x - 0.5
    assert slope @ change == pytest.approx(-1e-3, rel=0.02)
    equal = -1e-3 * np.sign(slope) / np.abs(slope).sum()
    assert change == pytest.approx(equal, rel=0.03)


def test_a_retry_moves_on_whichever_sign_overshot() -> None:
    """It falls to first order and rises again beyond: it is −r that exceeds, and r that holds x."""
    n = 50
    mma = MMA(MPI.COMM_SELF, np.zeros(n), np.ones(n), 0, MMAOptions(move=0.05), residuals=1)
    x: np.ndarray = np.full(n, 0.5)

    def residual() -> float:
        d = float(x.mean()) - 0.5
        return 3 - 10 * d - 3000 * max(d, 0.0) ** 2

    x = mma.step(
        x, Functions(0.0, np.zeros(n), residuals=[3.0], residual_jacobian=[np.full(n, -10 / n)])
    )
    tried = [float(x.mean())]
    while not mma.conservative(x, Functions(0.0, residuals=[residual()])):
        x = mma.retry(x, Functions(0.0, residuals=[residual()]))
        tried.append(float(x.mean()))
    assert len(tried) > 2
    assert residual() ** 2 < 9
    assert np.all(np.diff(tried) < -1e-3)


@pytest.mark.parametrize("factor", [0.3, 1e6])
def test_other_units_change_nothing(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Curvatures, multipliers and the penalty of a constraint that cannot be met follow."""
    monkeypatch.setattr("toros_fem.design.mma.optimizer.SMALL", 1e-13)
    n, k = 60, 3
    a, b = linear(n, k, 5)
    place = np.random.default_rng(1).random(n)

    def run(factors: list[float]) -> list[np.ndarray]:
        mma = MMA(
            MPI.COMM_SELF, np.zeros(n), np.ones(n), 2, MMAOptions(tolerance=1e-12), residuals=k
        )
        x: np.ndarray = np.full(n, 0.4)
        found, scale = [], 1.0
        slopes = [np.full(n, 5 / n), np.full(n, 1 / n)]
        for one in factors:
            scale *= one
            mma.rescale(one)
            # The second one cannot be met within the move limit: y > 0 remains.
            values = [5 * x.mean() - 1.5, x.mean() + 3.0]
            r, root = a @ x - b, scale**0.5
            rest, gradient = 0.3 * place @ x / n, 0.3 * place / n
            rows = [root * row for row in a]
            x = mma.step(
                x, Functions(scale * rest, scale * gradient, values, slopes, root * r, rows)
            )
            x = mma.retry(x, Functions(np.inf, values=[np.inf] * 2, residuals=[np.inf] * k))
            found.append(x.copy())
        return found

    same = run([1.0, 1.0, 1.0])
    assert np.array(run([1.0, factor, factor**0.5])) == pytest.approx(np.array(same), abs=1e-9)
    assert np.abs(np.diff(same, axis=0)).max() > 0.01


def test_a_gradient_of_a_residual_must_be_finite() -> None:
    mma = MMA(MPI.COMM_SELF, np.zeros(4), np.ones(4), residuals=1)
    x: np.ndarray = np.full(4, 0.5)
    bad = np.array([1.0, np.nan, 1.0, 1.0])
    with pytest.raises(ParameterError, match="not finite on some rank"):
        mma.step(x, Functions(1.0, np.ones(4), residuals=[0.1], residual_jacobian=[bad]))
    assert (x == 0.5).all()
    assert mma.state.previous is None
