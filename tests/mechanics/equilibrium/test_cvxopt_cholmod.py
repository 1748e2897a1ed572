"""CHOLMOD of cvxopt against dense algebra, where FEniCSx comes from wheels."""

import numpy as np
import pytest
from kit.skips import NO_WHEELS
from scipy.sparse import csc_matrix, diags, identity, kron, tril

from toros_fem.mechanics.equilibrium.cholmod import CvxoptCholmod, load_cvxopt


@pytest.fixture
def calls() -> CvxoptCholmod:
    pytest.importorskip("dolfinx_solver", reason=NO_WHEELS)
    found = load_cvxopt()
    assert found is not None, "cvxopt and METIS are of the versions whose factors are known"
    return found


def lower_grid(n: int) -> csc_matrix:
    """The lower triangle of a stiff grid of n × n unknowns, held everywhere a bit."""
    path = diags([-np.ones(n - 1), 2.1 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    lower = tril(kron(path, identity(n)) + kron(identity(n), path)).tocsc()
    lower.sort_indices()
    return lower


def dense(lower: csc_matrix) -> np.ndarray:
    return np.asarray((lower + lower.T - diags(lower.diagonal())).toarray())


@pytest.mark.parametrize("count", [0, 1, 7, 60])
def test_solutions_and_the_corner(calls: CvxoptCholmod, count: int) -> None:
    """The corner begins within a supernode, and spans several."""
    lower = lower_grid(8)
    factor = calls.factor(lower.indptr, lower.indices)
    L = np.linalg.cholesky(dense(lower))
    assert factor.factorise(lower.data)
    expected = L[64 - count :, 64 - count :][::-1, ::-1]
    assert np.allclose(factor.corner(count), expected, rtol=0, atol=1e-14 * 64)
    x = np.arange(64, dtype=np.float64)
    factor.forward(x)
    assert np.allclose(L @ x, np.arange(64.0), rtol=0, atol=1e-11)
    factor.backward(x)
    assert np.allclose(dense(lower) @ x, np.arange(64.0), rtol=0, atol=1e-10)


def test_a_matrix_that_is_not_positive_definite(calls: CvxoptCholmod) -> None:
    lower = lower_grid(8)
    factor = calls.factor(lower.indptr, lower.indices)
    bad = lower.data.copy()
    bad[lower.indptr[30]] = -1.0
    assert [factor.factorise(values) for values in (bad, lower.data, bad)] == [False, True, False]


def test_the_order_keeps_the_factor_sparse(calls: CvxoptCholmod) -> None:
    """Of nested dissection: a fraction of the entries of the natural order."""
    lower = lower_grid(40)
    order = calls.order(lower.indptr, lower.indices)
    assert np.array_equal(np.sort(order), np.arange(1600))
    A = dense(lower)
    entries = [
        np.count_nonzero(np.abs(np.linalg.cholesky(matrix)) > 1e-14)
        for matrix in (A, A[np.ix_(order, order)])
    ]
    assert entries[1] < 0.5 * entries[0]


def test_halves_meet_at_the_separator_alone(calls: CvxoptCholmod) -> None:
    lower = lower_grid(20)
    part = calls.bisect(lower.indptr, lower.indices)
    i, j = dense(lower).nonzero()
    assert not np.any((part[i] == 0) & (part[j] == 1))
    assert np.bincount(part, minlength=3)[2] <= 30
    assert np.bincount(part)[:2].min() > 150


def test_options_of_others_are_kept(calls: CvxoptCholmod) -> None:
    """Cvxopt has one table of options for the whole process."""
    from cvxopt import cholmod

    cholmod.options["supernodal"] = 0
    try:
        lower = lower_grid(4)
        assert calls.factor(lower.indptr, lower.indices).factorise(lower.data)
        assert cholmod.options == {"supernodal": 0}
    finally:
        cholmod.options.clear()


def test_no_unknowns(calls: CvxoptCholmod) -> None:
    """A rank may have none."""
    none = np.zeros(0, dtype=np.int32)
    pointers = np.zeros(1, dtype=np.int32)
    assert len(calls.order(pointers, none)) == 0
    factor = calls.factor(pointers, none)
    assert factor.factorise(np.zeros(0))
    factor.forward(np.zeros(0))
    assert factor.corner(0).shape == (0, 0)
