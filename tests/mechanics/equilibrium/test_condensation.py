"""Factors in parts against dense algebra, and their verdict at the edge of definiteness."""

from pathlib import Path

import numpy as np
import pytest
from kit.skips import NO_HEADER
from mpi4py import MPI
from scipy.sparse import csr_matrix, diags, identity, kron, triu

from toros_fem.base.errors import TorosError
from toros_fem.mechanics.equilibrium import cholmod
from toros_fem.mechanics.equilibrium.linear_solver import CondensedFactor, Partition, find_partition

LENGTH, WIDTH = 60, 16


def strip(seed: int = 0) -> csr_matrix:
    """A long strip of springs with random stiffness on random supports; one unknown meets many."""
    rng = np.random.default_rng(seed)
    path = [
        diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
        for n in (LENGTH, WIDTH)
    ]
    K = kron(path[0], identity(WIDTH)) + kron(identity(LENGTH), path[1])
    scale = diags(np.exp(rng.standard_normal(LENGTH * WIDTH)))
    K = (scale @ K @ scale).tolil()
    K[7, 3::5] = K[3::5, 7] = 1e-3 * rng.standard_normal(len(range(3, LENGTH * WIDTH, 5)))
    K[7, 7] = 50.0
    return csr_matrix(K)


def owned_rows(K: csr_matrix, comm: MPI.Comm) -> tuple[slice, csr_matrix]:
    """The upper triangle of this rank's rows."""
    ends = np.linspace(0, K.shape[0], comm.size + 1).astype(int)
    rows = slice(ends[comm.rank], ends[comm.rank + 1])
    upper = triu(K).tocsr()[rows]
    upper.sort_indices()
    return rows, upper


def make(K: csr_matrix, comm: MPI.Comm, threads: int) -> tuple[CondensedFactor, slice, csr_matrix]:
    calls = cholmod.library(comm)
    assert calls is not None, "CHOLMOD with its header, or cvxopt where FEniCSx is from wheels"
    rows, upper = owned_rows(K, comm)
    pattern = upper.indptr, upper.indices
    partition = find_partition(comm, calls, *pattern, threads=threads)
    part, interface = partition.part, partition.interface
    i, j = K.nonzero()
    joined = (part[i] != part[j]) & ~np.isin(i, interface) & ~np.isin(j, interface)
    assert not joined.any()
    return CondensedFactor(comm, calls, *pattern, partition), rows, upper


def test_the_calls_are_compiled_where_they_are_not_there(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not isinstance(cholmod.library(alone), cholmod.CompiledCholmod):
        pytest.skip(NO_HEADER)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = cholmod._build.__wrapped__()
    assert made.parent == tmp_path / "toros_fem"


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_solutions_and_verdicts(
    threads: int, comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.LEAST_PART", 100)
    K = strip()
    factor, rows, upper = make(K, comm, threads)
    assert factor.parts == (comm.size if comm.size > 1 else threads)
    if factor.parts > 1:
        assert 0 < len(factor.interface) < factor.parts * 2 * WIDTH
    dense = K.toarray()
    lowest = np.linalg.eigvalsh(dense)[0]
    assert lowest > 0
    rhs = np.random.default_rng(1).standard_normal(len(dense))
    diagonal = upper.indptr[:-1]
    for shift, positive in ((0, True), (1 - 1e-8, True), (1 + 1e-8, False), (0.5, True)):
        values = upper.data.copy()
        values[diagonal] -= shift * lowest
        assert factor.factorise(values) == positive
        if positive and shift < 0.9:
            expected = np.linalg.solve(dense - shift * lowest * np.eye(len(dense)), rhs)
            found = factor.solve(rhs[rows].copy())
            assert np.linalg.norm(found - expected[rows]) < 1e-11 * np.linalg.norm(expected)


@pytest.mark.parametrize("place", [0.01, 0.5, 0.99])
@pytest.mark.parametrize("threads", [1, 2])
def test_one_negative_pivot_anywhere(
    threads: int, place: float, comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one part or in the interface: all ranks say so, and the next matrix is factorised."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.LEAST_PART", 100)
    K = strip(1)
    factor, rows, upper = make(K, comm, threads)
    chosen = int(place * K.shape[0])
    if place == 0.5 and factor.parts > 1:
        chosen = int(factor.interface[0])
    values = upper.data.copy()
    if rows.start <= chosen < rows.stop:
        values[upper.indptr[chosen - rows.start]] = -1e-3
    assert not factor.factorise(values)
    assert factor.factorise(upper.data)
    found = factor.solve(np.ones(rows.stop - rows.start))
    whole = np.concatenate(comm.allgather(found))
    assert np.abs(K @ whole - 1).max() < 1e-9


def test_parts_that_do_not_meet(comm: MPI.Comm) -> None:
    """A diagonal matrix: no interface."""
    K = csr_matrix(diags(np.arange(1.0, comm.size + 1)))
    factor, rows, upper = make(K, comm, 1)
    assert len(factor.interface) == 0
    assert factor.factorise(upper.data)
    assert factor.solve(upper.data) == pytest.approx(np.ones(rows.stop - rows.start))
    assert not factor.factorise(upper.data - (comm.rank == comm.size - 1) * 2 * comm.size)


def test_repeated_runs_agree_to_the_last_digit(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Threads change nothing from run to run."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.LEAST_PART", 100)
    results = []
    for _ in range(2):
        factor, rows, upper = make(strip(2), comm, 2)
        assert factor.factorise(upper.data)
        results.append(factor.solve(np.ones(rows.stop - rows.start)))
    assert np.array_equal(results[0], results[1])


def test_an_error_in_one_part_is_raised_on_all_ranks(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    factor, rows, upper = make(strip(), comm, 1)
    if comm.rank == comm.size - 1:

        def fail(*_: object) -> bool:
            raise TorosError("too little memory for the factors")

        monkeypatch.setattr(type(factor._parts[0].factor), "factorise", fail)
    with pytest.raises(TorosError, match="too little memory"):
        factor.factorise(upper.data)
    monkeypatch.undo()
    assert factor.factorise(upper.data)
    assert np.all(np.isfinite(factor.solve(np.ones(rows.stop - rows.start))))


def test_a_part_that_touches_no_interface(
    alone: MPI.Comm, capfd: pytest.CaptureFixture[str]
) -> None:
    """As that of a rank without unknowns; LAPACK has nothing to print about it."""
    K = csr_matrix([[2.0, -1.0, 0, 0], [-1.0, 2.0, -1.0, 0], [0, -1.0, 2.0, 0], [0, 0, 0, 3.0]])
    calls = cholmod.library(alone)
    assert calls is not None
    upper = owned_rows(K, alone)[1]
    partition = Partition(np.array([0, 0, 1, 2]), 3, np.array([1]))
    factor = CondensedFactor(alone, calls, upper.indptr, upper.indices, partition)
    assert factor.factorise(upper.data)
    rhs = np.array([0.0, 1.0, 2.0, 3.0])
    assert K @ factor.solve(rhs) == pytest.approx(rhs)
    assert capfd.readouterr().out == ""
