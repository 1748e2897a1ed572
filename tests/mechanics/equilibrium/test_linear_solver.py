"""Factorised tangent: both packages agree, and say what they do."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.models import bent_tube, dense_tangent, drawn, pressurize
from helpers.standing import model_on_base
from kit.terms import TERMS, model_of
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.cholmod import library
from toros_fem.mechanics.equilibrium.linear_solver import (
    LEAST,
    MILD,
    Partition,
    TangentFactor,
    find_partition,
)
from toros_fem.mechanics.skin.supports import clamp, symmetry_plane
from toros_fem.mechanics.terms.model import make_model
from toros_fem.mechanics.terms.tangent import EXACT, MATERIAL, STRAINS, UpperTangent
from toros_fem.meshes import Skin, cylinder, sew


@pytest.fixture
def mumps() -> Iterator[None]:
    options = PETSc.Options("toros_")
    options["pc_factor_mat_solver_type"] = "mumps"
    yield
    options.delValue("pc_factor_mat_solver_type")


def test_both_packages_agree(comm: MPI.Comm, mumps: None) -> None:
    """On one rank, where both can be had; also after a matrix that is not positive definite."""
    skin = sew(MPI.COMM_SELF, cylinder(MPI.COMM_SELF, 0.05, 0.02, 6e-3))
    model = model_on_base(skin)
    model.set_density(np.full(len(skin.owned_cells), 0.5))
    pressurize(model, 1e5)
    by_mumps = TangentFactor(model)
    PETSc.Options("toros_").delValue("pc_factor_mat_solver_type")
    by_cholmod = TangentFactor(model)
    told = by_mumps.describe(), by_cholmod.describe()
    assert [one.split()[0] for one in told] == ["MUMPS", "CHOLMOD"]
    rhs = model.residual(model.assembled)
    solutions = []
    for factor in (by_mumps, by_cholmod):
        factor.assemble(model.assembled)
        verdicts = [factor.factorise(shift) for shift in (0.0, 1e-3, 1e3, 0.0, 1e3)]
        assert verdicts == [False, False, True, False, True]
        assert factor.count == 5
        solutions.append(factor.solve(rhs))
    assert by_cholmod.ordering is None
    assert by_mumps.ordering in {"AMD", "AMF", "SCOTCH", "PORD", "METIS", "QAMD"}
    gap = np.linalg.norm(solutions[0] - solutions[1])
    assert np.linalg.norm(solutions[0]) > 0
    assert gap < 1e-10 * np.linalg.norm(solutions[0])


def test_shift_and_diagonal_are_added(tube: Skin) -> None:
    """K + τ M + δ D with D the mean diagonal of a vertex, zero at fixed components."""
    model = model_on_base(tube)
    model.set_density(np.full(len(tube.owned_cells), 0.5))
    factor = TangentFactor(model)
    tangent = UpperTangent(model)
    factor.assemble(model.assembled)
    assert np.all(factor.scale[~model.free] == 0)
    assert np.all(factor.scale[model.free] > 0)
    diagonals = []
    for shift, diagonal in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.0)):
        factor.fill(shift, diagonal)
        diagonals.append(factor.values[tangent.diagonal])
    assert np.array_equal(diagonals[3], diagonals[0]), "K itself is kept"
    assert diagonals[1] - diagonals[0] == pytest.approx(factor.scale, rel=1e-12, abs=1e-9)
    material = diagonals[2] - diagonals[0]
    assert material.min() >= 0
    assert material[model.free].min() > 0


def test_with_a_shift_contact_is_semidefinite() -> None:
    """What K + τ M gains beyond τ M, for a mild τ, is what the contact's part gains."""
    pytest.importorskip("ipctk")
    state, model = model_of(TERMS["the skin itself"])
    factor = TangentFactor(model)
    factor.assemble(state)
    filled = []
    for shift in (0.0, MILD / 2, MILD):
        factor.fill(shift)
        filled.append(factor.values.copy())
    gained = 2 * filled[1] - filled[2] - filled[0]
    more, less = (model.contact.entries(state, definite=part) for part in (True, False))
    assert np.abs(more - less).max() > 1e-3 * np.abs(less).max()
    assert gained.sum() == pytest.approx((more - less).sum(), rel=1e-6)


def test_above_a_mild_shift_kinks_do_not_soften(tube: Skin) -> None:
    """K lacks the geometric stiffness of bending there, and has all of it up to there."""
    thick = Composite(reinforcement=Material(26e6, 0.3, 0.5e-3))  # bending counts more in it
    model = model_on_base(tube, thick)
    model.set_density(np.full(len(tube.owned_cells), 0.5))
    kinks = 2e-4 * np.random.default_rng(4).standard_normal(model.size_local) * model.free
    factor, tangent = TangentFactor(model), UpperTangent(model)
    state = model.assembled + kinks
    factor.assemble(state)
    parts = {part: np.zeros(len(tangent.columns)) for part in (EXACT, STRAINS, MATERIAL)}
    for part, entries in parts.items():
        tangent.assemble(state, entries, part)
    parts[MATERIAL][tangent.diagonal] += LEAST * factor.scale
    scale = np.abs(parts[EXACT]).max()
    assert np.abs(parts[EXACT] - parts[STRAINS]).max() > 1e-3 * scale
    for shift, part in ((MILD, EXACT), (1.01 * MILD, STRAINS), (MILD, EXACT)):
        factor.fill(shift)
        expected = parts[part] + shift * parts[MATERIAL]
        assert factor.values == pytest.approx(expected, abs=1e-12 * scale)


def test_the_scale_is_one_of_free_components(alone: MPI.Comm) -> None:
    """It is proportional to the modulus, in a plane of symmetry and at its corners too."""
    pattern = cylinder(alone, 0.05, 0.02, 6e-3, mesh="structured", planes=(0, 1))
    skin, scales = sew(alone, pattern), []
    supports = clamp(pattern, ["base"]) | symmetry_plane(pattern, 0) | symmetry_plane(pattern, 1)
    for young in (0.1e6, 0.1e3):
        sheet = Material(young, 0.3, 0.5e-3)
        model = make_model(skin, Composite(sheet, sheet), supports)
        factor = TangentFactor(model)
        factor.assemble(model.assembled)
        places = model.positions(factor.scale)
        scales.append(places[model.free[: places.size].reshape(-1, 3)])
    assert scales[0] == pytest.approx(1e3 * scales[1], rel=1e-9)
    assert scales[0].min() > 0.1 * scales[0].max()


def test_product_and_old_factors(comm: MPI.Comm, tube: Skin) -> None:
    """K x belongs to the last `assemble`, the solution to the last `factorise`."""
    model = model_on_base(tube)
    model.set_density(np.full(len(tube.owned_cells), 0.5))
    factor = TangentFactor(model)
    factor.assemble(model.assembled)
    assert factor.factorise(1.0)
    x, count = drawn(model, 5), factor.count
    old = factor.solve(x)
    assert norm(comm, old) > 0

    state = bent_tube(model)
    factor.assemble(state)
    product = factor.multiply(x + 3.0 * ~model.free)
    assert np.all(product[~model.free] == 0)
    first = model.space.dofmap.index_map.local_range[0]
    expected = dense_tangent(model, state)[first : first + len(x)] @ np.concatenate(
        comm.allgather(x)
    )
    assert norm(comm, product - expected * model.free) < 1e-12 * norm(comm, product)
    assert np.array_equal(factor.solve(x), old)
    factor.fill(2.0)
    assert np.array_equal(factor.solve(x), old)
    assert factor.count == count


def test_without_cholmod_mumps_factorises(
    comm: MPI.Comm, tube: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where CHOLMOD's header is missing, or too many unknowns lie between the parts."""
    model = model_on_base(tube)
    model.set_density(np.full(len(tube.owned_cells), 0.5))
    own = TangentFactor(model)
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.library", lambda comm: None)
    other = TangentFactor(model)
    monkeypatch.undo()
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.LARGEST_INTERFACE", -1)
    third = TangentFactor(model)
    where = "one rank" if comm.size == 1 else f"{comm.size} ranks"
    assert own.describe().startswith(f"CHOLMOD on {where}")
    assert other.describe().startswith(f"MUMPS through PETSc on {where}")
    assert third.describe() == other.describe()
    solutions = []
    for factor in (own, other):
        factor.assemble(model.assembled)
        assert factor.factorise(1.0)
        solutions.append(factor.solve(drawn(model, 2)))
    assert norm(comm, solutions[1] - solutions[0]) < 1e-9 * norm(comm, solutions[0])


@pytest.mark.parametrize(("text", "threads"), [("", 1), ("2", 2), ("4,2", 4), ("0", 1), ("x", 1)])
def test_threads_are_those_that_the_user_allows(
    text: str, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    model = model_on_base(sew(MPI.COMM_SELF, cylinder(MPI.COMM_SELF, 0.05, 0.02, 6e-3)))

    def find(*arguments: Any, threads: int) -> Partition:
        asked.append(threads)
        return find_partition(*arguments, threads=threads)

    monkeypatch.setattr("toros_fem.mechanics.equilibrium.linear_solver.find_partition", find)
    monkeypatch.setenv("OMP_NUM_THREADS", text)
    calls = library(MPI.COMM_SELF)
    TangentFactor(model)
    assert asked == [threads if calls is not None and calls.threads else 1]
