"""Newton's method: reuse of factors, large steps, its history, and saddles that it leaves."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.models import dense_tangent
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from benchmarks.stability.matrix import Request, Stage
from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Skin, sew


def test_neighbouring_design_takes_few_steps(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    rng = np.random.default_rng(1)
    base = 0.5 + 0.3 * rng.random(len(short_tube.pattern.panel))
    near = base + 0.01 * rng.random(len(base))
    first = short_solver.solve(base[short_tube.owned_cells], 2e3)
    warm = short_solver.solve(near[short_tube.owned_cells], 2e3, start=first)
    assert warm.history[0].kind == "modified", "the factors at hand predict the change"
    assert warm.steps <= 2
    assert warm.factorisations == warm.steps + 1, "the last one serves stability and adjoint"
    cold = short_solver.solve(near[short_tube.owned_cells], 2e3)
    assert norm(short_tube.comm, warm.state - cold.state) < 1e-8 * norm(short_tube.comm, cold.state)


def test_older_factors_take_the_place_of_factorisations(
    short_tube: Skin, short_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On large skins; here as many iterations are allowed as there."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.iteration.KRYLOV_COST", 0.3)
    solver = solver_on_base(short_tube)
    rng = np.random.default_rng(1)
    base = (0.5 + 0.3 * rng.random(len(short_tube.pattern.panel)))[short_tube.owned_cells]
    near = base + 0.1 * rng.random(len(short_tube.pattern.panel))[short_tube.owned_cells]
    first = solver.solve(base, 2e3)
    warm = solver.solve(near, 2e3, start=first)
    inexact = [row for row in warm.history if row.kind == "cg"]
    assert inexact
    assert all(0 < row.iterations < 20 and row.shift == 0 for row in inexact)
    assert any(f"cg {row.iterations}" in str(row) for row in inexact)
    assert warm.factorisations < warm.steps + 1
    direct = short_solver.solve(near, 2e3, start=short_solver.solve(base, 2e3).state)
    assert not any(row.kind == "cg" for row in direct.history), "few unknowns are factorised"
    assert norm(short_tube.comm, warm.state - direct.state) < 1e-8 * norm(
        short_tube.comm, direct.state
    )
    assert warm.residual <= 1e-10


def test_older_factors_stop_at_a_negative_curvature(
    short_tube: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their first direction tells it: one iteration with them, and one with factors of K + τM."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.iteration.KRYLOV_COST", 0.3)
    solver = solver_on_base(short_tube)
    found = solver.solve(np.zeros(len(short_tube.owned_cells)), 20e3)
    shifted = [row.iterations for row in found.history[1:] if row.shift > 0 and row.step]
    assert shifted.count(2) >= 3


def test_swelling_at_once(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """From the assembled tube to where the fabric saturates: by the diagonal it took 130 steps."""
    result = short_solver.solve(np.zeros(len(short_tube.owned_cells)), 20e3)
    assert result.converged
    assert result.history[0].pressure == result.history[-1].pressure == 20e3
    assert result.steps <= 30


def test_log_shows_the_quadratic_tail(short_tube: Skin) -> None:
    logged: list[NewtonStep | str] = []
    solver = solver_on_base(short_tube, log=logged.append)
    result = solver.solve(np.full(len(short_tube.owned_cells), 0.4), 2e3)
    rows = [row for row in logged if isinstance(row, NewtonStep)]
    assert tuple(rows) == result.history
    tail = [
        (row.residual, after.residual)
        for row, after in pairwise(rows)
        if row.kind != "modified" and row.shift == 0 and row.step == 1 and row.residual < 1e-2
    ]
    assert tail
    assert all(after < 10 * max(before**1.5, 1e-11) for before, after in tail)
    assert "newton" in str(rows[0])
    assert "end" in str(rows[-1])


def test_saddle_is_left(alone: MPI.Comm) -> None:
    """A sheet compressed in its plane is stationary when flat, and lower when buckled."""
    size, squeeze = 0.02, 0.9
    flat = square(n=6, size=size).flat_points
    points = np.column_stack([flat[:, 0] * squeeze, flat[:, 1], 0 * flat[:, 0]])
    pattern = square(points, n=6, size=size)
    fixed = np.zeros((len(points), 3), dtype=bool)
    fixed[(flat[:, 0] < 1e-9) | (flat[:, 0] > size - 1e-9)] = True
    skin = sew(alone, pattern)
    cloth = Material(young=1e6, poisson=0.0, thickness=0.5e-3)
    solver = EquilibriumSolver(skin, Composite(fabric=cloth), Supports(fixed))
    plain = np.zeros(len(skin.owned_cells))
    solver.model.set_density(plain)
    start = solver.model.assembled
    assert norm(alone, solver.model.residual(start)) < 1e-10 * 50 * size
    assert np.linalg.eigvalsh(dense_tangent(solver.model, start))[0] < 0
    result = solver.solve(plain, 0.0)
    assert result.converged
    assert np.linalg.eigvalsh(dense_tangent(solver.model, result.state))[0] > 0
    height = skin.gather_vertices(result.positions)[:, 2]
    # The elastica between pins, k over K(k) high where 2 E(k)/K(k) − 1 is the squeeze.
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - squeeze, 1e-6, 0.5)
    high = size * np.sqrt(m) / ellipk(m)
    assert np.abs(height).max() == pytest.approx(high, rel=0.012)  # 0.0102 seen


def test_stretched_sheet_wrinkles(alone: MPI.Comm) -> None:
    """Pulled around a stiff island a thin sheet leaves its plane: flat it is at a saddle."""
    size, stretch = 0.02, 1.4
    flat = square(n=8, size=size).flat_points
    points = np.column_stack([stretch * flat[:, 0], flat[:, 1], 0 * flat[:, 0]])
    pattern = square(points, n=8, size=size)
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[(flat[:, 0] < 1e-9) | (flat[:, 0] > size - 1e-9)] = True
    in_plane = fixed.copy()
    in_plane[:, 2] = True
    skin = sew(alone, pattern)
    cloth = Material(young=0.1e6, poisson=0.3, thickness=0.05e-3)
    stiff = Material(young=30e6, poisson=0.3, thickness=0.05e-3)
    composite = Composite(fabric=cloth, reinforcement=stiff)
    middle = pattern.centroids - size / 2
    island = (np.linalg.norm(middle, axis=1) < size / 3).astype(float)[skin.owned_cells]
    kept_flat = EquilibriumSolver(skin, composite, Supports(in_plane)).solve(island, 0.0)
    assert np.abs(kept_flat.positions[:, 2]).max() < 1e-12 * size
    solver = EquilibriumSolver(skin, composite, Supports(fixed))
    model = solver.model
    model.set_density(island)
    pull = norm(alone, model.reaction(kept_flat.state))
    assert norm(alone, model.residual(kept_flat.state)) < 1e-9 * pull, "stationary"
    assert np.linalg.eigvalsh(dense_tangent(model, kept_flat.state))[0] < 0, "but no minimum"
    result = solver.solve(island, 0.0, start=kept_flat)
    assert result.converged
    assert np.linalg.eigvalsh(dense_tangent(model, result.state))[0] > 0
    height = skin.gather_vertices(result.positions)[:, 2]
    assert np.abs(height).max() > 1e-3 * size, "it has left the plane"
    assert result.energy < kept_flat.energy * (1 - 1e-6)


def test_rounding_ends_a_solve_with_few_steps() -> None:
    """A slender stiff tube at a low pressure, where older factors once hid the rounding."""
    stage = Stage("slender")
    density = stage.density(Request("slender", "random", 1e4, 16.6))
    result = stage.solver(1e4).solve(density, 16.6)
    assert result.converged
    assert 1e-10 < result.residual < 1e-7
    assert result.steps <= 40


def test_rounding_does_not_hide_a_step_that_moves_something() -> None:
    """Slivers and a stiff helix: the residual is of the size of rounding before the last step."""
    stage = Stage("slivers")
    request = Request("slivers", "helix", 1e4, 5e3)
    solver = stage.solver(1e4)
    result = solver.solve(stage.density(request), request.load)
    assert 1e-9 < result.residual < 1e-7
    left = solver._newton.direction(result.state, solver.model.residual(result.state))
    assert np.abs(left).max() < 1e-11 * stage.scene.skin.pattern.size
    assert result.history[-1].kind == "end", "and the tangent there is factorised"
    newton, end = result.history[-2:]
    # Rounding decides whether the factors of the state before still serve ("cg").
    assert newton.kind in ("newton", "cg")
    assert newton.step == 1.0
    assert end.residual < 1.5 * newton.residual
