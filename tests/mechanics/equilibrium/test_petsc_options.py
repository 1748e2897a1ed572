"""Options of PETSc with the prefix "toros_": each acts, and what cannot act is refused or told."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.errors import ParameterError, TorosWarning
from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import given_options
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Skin, cylinder, sew

Solve = Callable[..., Equilibrium]


@pytest.fixture(scope="module")
def small(comm: MPI.Comm) -> Skin:
    """A tube of some 150 triangles."""
    return sew(comm, cylinder(comm, 0.04, 0.02, 7e-3))


@pytest.fixture
def solve(small: Skin) -> Iterator[Solve]:
    """Solve a cold tube at 1 kPa by a solver that is made under options."""

    def run(options: str = "", skin: Skin = small, **given: Any) -> Equilibrium:
        with given_options(options):
            solver = solver_on_base(skin)
            density = np.full(len(skin.owned_cells), 0.5)
            return solver.solve(density, 1e3, **given)

    yield run
    left = [name for name in PETSc.Options().getAll() if name.startswith("toros_")]
    assert not left, "no option outlives its block"


def kinds(found: Equilibrium) -> list[str]:
    return [row.kind for row in found.history]


def test_the_view_shows_what_works(
    tube: Skin, solve: Solve, capfd: pytest.CaptureFixture[str]
) -> None:
    solve("-toros_snes_view")
    seen = capfd.readouterr().out
    if tube.comm.rank > 0:  # the first rank prints
        return
    for text in ("type: newtonls", "type: bt", "type: cg", "ShiftedCholesky", "last shift"):
        assert text in seen, text
    assert "CHOLMOD" in seen or "MUMPS" in seen


def test_the_monitor_has_a_line_for_each_step(
    tube: Skin, solve: Solve, capfd: pytest.CaptureFixture[str]
) -> None:
    found = solve("-toros_snes_monitor -toros_snes_converged_reason")
    lines = capfd.readouterr().out.splitlines()
    if tube.comm.rank > 0:
        return
    sizes = [float(line.split()[-1]) for line in lines if "Function norm" in line]
    assert len(sizes) == len(found.history)
    ratios = [row.residual / size for row, size in zip(found.history, sizes, strict=True)]
    assert ratios == pytest.approx([ratios[0]] * len(ratios), rel=0.2), "residuals of the steps"
    assert any("CONVERGED_FNORM_RELATIVE" in line for line in lines)


@pytest.mark.parametrize(
    "options",
    [
        "-toros_pc_type lu",
        "-toros_pc_type cholesky -toros_pc_factor_mat_solver_type mumps",
        "-toros_pc_type gamg",
        "-toros_pc_type lu -toros_ksp_type preonly",
        "-toros_ksp_type gmres",
        "-toros_snes_type newtontr",
        "-toros_snes_linesearch_type l2",
        "-toros_snes_linesearch_order 3",
        "-toros_pc_factor_mat_solver_type mumps",
    ],
)
def test_the_equilibrium_is_the_same(small: Skin, solve: Solve, options: str) -> None:
    own, found = solve(), solve(options)
    assert found.residual <= 2e-10  # 1.05e-10 with gamg
    assert norm(small.comm, found.state - own.state) < 1e-7 * norm(small.comm, own.state)
    assert found.steps > 2


def test_preconditioners_of_petsc_take_the_place_of_factors(solve: Solve) -> None:
    assert solve().factorisations > 3
    assert solve("-toros_pc_type gamg").factorisations == 1, "that of the proof"


def test_another_tolerance(solve: Solve) -> None:
    found = solve("-toros_snes_rtol 1e-3")
    assert 1e-10 < found.residual <= 1e-3
    assert found.steps < solve().steps


def test_an_absolute_tolerance(solve: Solve) -> None:
    """In N: larger than any force here, so that the assembled tube is good enough."""
    assert kinds(solve("-toros_snes_atol 1e3"))[-1] == "end"
    assert solve("-toros_snes_atol 1e3").steps < solve().steps


def test_fewer_steps(solve: Solve) -> None:
    found = solve("-toros_snes_max_it 2", raise_on_failure=False, trial=True)
    assert not found.converged
    assert sum(kind != "end" for kind in kinds(found)) == 2


def test_a_damped_step(solve: Solve) -> None:
    found = solve("-toros_snes_linesearch_type basic -toros_snes_linesearch_damping 0.5")
    steps = [row.step for row in found.history if row.step]
    assert max(steps) == pytest.approx(0.5, abs=1e-3)


def test_krylov_iterations(tube: Skin, solve: Solve) -> None:
    """An exact linear solve by an incomplete factorisation takes many."""
    options = "-toros_pc_type bjacobi -toros_ksp_rtol"
    few, many = (solve(f"{options} {rtol}", tube) for rtol in ("1e-1", "1e-10"))
    assert len(many.history) <= len(few.history)
    assert mean_iterations(many) > 2 * mean_iterations(few)


def mean_iterations(found: Equilibrium) -> float:
    return float(np.mean([row.iterations for row in found.history if row.kind == "newton"]))


def test_the_end_of_another_snes_is_proven(alone: MPI.Comm) -> None:
    """A trust region stops at a sheet that is squeezed in its plane: a saddle is no equilibrium."""
    flat = square(n=4).flat_points
    points = np.column_stack([0.9 * flat[:, 0], flat[:, 1], 0 * flat[:, 0]])
    pattern = square(points, n=4)
    held = np.zeros((len(points), 3), dtype=bool)
    held[(points[:, 0] < 1e-9) | (points[:, 0] > points[:, 0].max() - 1e-9)] = True
    with given_options("-toros_snes_type newtontr"):
        cloth = Composite(fabric=Material(1e6, 0.0, 0.5e-3))
        solver = EquilibriumSolver(sew(alone, pattern), cloth, Supports(held))
    model = solver.model
    model.set_density(np.zeros(len(pattern.panel)))
    found = solver._newton(model.assembled)
    assert found.outcome == int(PETSc.SNES.ConvergedReason.DIVERGED_INNER)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ("-toros_snes_type foo", "requested SNES type foo"),
        ("-toros_pc_type foo", "requested PC type foo"),
        ("-toros_ksp_type foo", "requested KSP type foo"),
        ("-toros_snes_max_it few", "few has no integer value"),
        ("-toros_pc_factor_mat_solver_type superlu", "take one of cholmod, mumps"),
        ("-snes_monitor", "must each begin with -toros_"),
        ("snes_monitor", "must each begin with -toros_"),
    ],
)
def test_wrong_options_are_refused_by_name(solve: Solve, options: str, text: str) -> None:
    with pytest.raises(ParameterError, match=text) as caught:
        solve(options)
    assert options in str(caught.value)


def test_an_unused_option_is_told(tube: Skin, solve: Solve) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        solve("-toros_snes_monitr")
    texts = [str(warning.message) for warning in told if warning.category is TorosWarning]
    assert len(texts) == (tube.comm.rank == 0)
    assert all("-toros_snes_monitr" in text for text in texts)


def test_what_a_hook_raises_passes(solve: Solve, monkeypatch: pytest.MonkeyPatch) -> None:
    """As an interruption does: PETSc would make an error of its own of it."""

    def interrupted(*_: Any) -> float:
        raise KeyboardInterrupt("by the user")

    monkeypatch.setattr("toros_fem.mechanics.terms.model.SkinModel.largest_step", interrupted)
    with pytest.raises(KeyboardInterrupt, match="by the user"):
        solve()
