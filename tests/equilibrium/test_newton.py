"""What makes the equilibrium solver fast and hard to break, piece by piece."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.models import pressurize
from helpers.scenes import square
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from toros_fem import errors
from toros_fem._mpi import norm
from toros_fem.equilibrium.continuation import ContinuationResult, run_continuation
from toros_fem.equilibrium.linear_solver import TangentFactor
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.materials import CURVATURES, Bending, Composite, Material
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.supports import clamp, symmetry_plane
from toros_fem.mechanics.tangent import UpperTangent
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.pattern import Panel


@pytest.fixture(scope="module")
def disturbed(tube: Skin) -> tuple[SkinModel, np.ndarray]:
    """A random design under pressure, far from any equilibrium and from stability."""
    model = SkinModel(tube, Composite(), clamp(tube.pattern, ["base"]))
    rng = np.random.default_rng(3)
    model.set_density(rng.random(len(tube.pattern.panel))[tube.owned_cells])
    pressurize(model, 5e3)
    noise = np.zeros(model.size_local)
    drawn = rng.standard_normal(tube.pattern.points.shape)
    model.positions(noise)[:] = 2e-4 * drawn[tube.owned_vertices]
    return model, model.assembled + noise * model.free


def dense(model: SkinModel, state: np.ndarray, geometric: float) -> np.ndarray:
    """The whole tangent, or its material part, on every rank."""
    tangent = UpperTangent(model)
    values = np.zeros(len(tangent.columns))
    tangent.assemble(state, values, geometric=geometric)
    shape = (model.size_local, model.space.dofmap.index_map.size_global)
    rows = csr_matrix((values, tangent.columns, tangent.indptr), shape=shape).toarray()
    upper = np.concatenate(model.skin.comm.allgather(rows))
    return upper + np.triu(upper, 1).T


def test_material_part_makes_the_tangent_positive(disturbed: tuple[SkinModel, np.ndarray]) -> None:
    model, state = disturbed
    K, M = (dense(model, state, geometric) for geometric in (1.0, 0.0))
    scale = 1 / np.sqrt(np.abs(np.diag(K)))
    K, M = (scale[:, None] * matrix * scale for matrix in (K, M))
    assert np.linalg.eigvalsh(K)[0] < -0.1
    lowest = np.linalg.eigvalsh(M)
    assert lowest[0] > -1e-12 * lowest[-1]
    assert np.linalg.eigvalsh(K + 2 * M)[0] > 0


@pytest.fixture
def mumps() -> Iterator[None]:
    options = PETSc.Options("toros_")
    options["pc_factor_mat_solver_type"] = "mumps"
    yield
    options.delValue("pc_factor_mat_solver_type")


def test_both_packages_agree(comm: MPI.Comm, mumps: None) -> None:
    """On one rank, where both can be had; also after a matrix that is not positive definite."""
    pattern = cylinder(MPI.COMM_SELF, 0.05, 0.02, 6e-3)
    skin = sew(MPI.COMM_SELF, pattern)
    model = SkinModel(skin, Composite(), clamp(pattern, ["base"]))
    model.set_density(np.full(len(pattern.panel), 0.5))
    pressurize(model, 1e5)
    by_mumps = TangentFactor(model)
    PETSc.Options("toros_").delValue("pc_factor_mat_solver_type")
    by_cholmod = TangentFactor(model)
    assert (by_mumps.package, by_cholmod.package) == ("mumps", "cholmod")
    rhs = model.residual(model.assembled)
    solutions = []
    for factor in (by_mumps, by_cholmod):
        factor.assemble(model.assembled)
        verdicts = [factor.factorise(shift) for shift in (0.0, 1e-3, 1e3, 0.0, 1e3)]
        assert verdicts == [False, False, True, False, True]
        assert factor.count == 5
        solutions.append(factor.solve(rhs))
    gap = np.linalg.norm(solutions[0] - solutions[1])
    assert np.linalg.norm(solutions[0]) > 0
    assert gap < 1e-10 * np.linalg.norm(solutions[0])


def test_neighbouring_design_takes_few_steps(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    rng = np.random.default_rng(1)
    base = 0.5 + 0.3 * rng.random(len(tube.pattern.panel))
    near = base + 0.01 * rng.random(len(base))
    first = tube_solver.solve(base[tube.owned_cells], 2e3)
    warm = tube_solver.solve(near[tube.owned_cells], 2e3, start=first.state)
    assert warm.history[0].modified, "the factors at hand predict the change"
    assert warm.steps <= 2
    assert warm.factorisations == warm.steps + 1, "the last one serves stability and adjoint"
    cold = tube_solver.solve(near[tube.owned_cells], 2e3)
    assert norm(tube.comm, warm.state - cold.state) < 1e-8 * norm(tube.comm, cold.state)


def test_swelling_at_once(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    """From the assembled tube to where the fabric saturates: by the diagonal it took 130 steps."""
    result = tube_solver.solve(np.zeros(len(tube.owned_cells)), 20e3)
    assert result.converged
    assert result.history[0].pressure == result.history[-1].pressure == 20e3
    assert result.steps <= 30


def test_log_shows_the_quadratic_tail(tube: Skin) -> None:
    rows: list[NewtonStep] = []
    solver = EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"]), log=rows.append)
    result = solver.solve(np.full(len(tube.owned_cells), 0.4), 2e3)
    assert tuple(rows) == result.history
    tail = [
        (row.residual, after.residual)
        for row, after in pairwise(rows)
        if not row.modified and row.shift == 0 and row.step == 1 and row.residual < 1e-2
    ]
    assert tail
    assert all(after < 10 * max(before**1.5, 1e-11) for before, after in tail)
    assert "newton" in str(rows[0])
    assert "end" in str(rows[-1])


def climbing(
    limit: float, top: float, *, jump: float = 1.0
) -> tuple[ContinuationResult, list[float]]:
    """Climb where an attempt succeeds up to a limit, and if it jumps no further than that."""
    tried: list[float] = []

    def attempt(state: np.ndarray, level: float) -> tuple[np.ndarray, int, int]:
        tried.append(level)
        good = level <= limit and level - state[0] <= jump
        return (np.array([level]), 2, 5) if good else (state + np.nan, -5, 5)

    begin = ContinuationResult(np.zeros(1), None, 0)
    return run_continuation(attempt, begin, top, 0.25, 0.05), tried


def test_climb_reaches_the_top() -> None:
    end, tried = climbing(10.0, 1.0)
    assert (end.load_factor, end.outcome, end.state[0]) == (1.0, 2, 1.0)
    assert tried == [0.25, 1.0]


def test_climb_shrinks_its_steps() -> None:
    end, tried = climbing(10.0, 1.0, jump=0.3)
    assert end.load_factor == end.state[0] == 1.0
    assert len(tried) < 9


def test_climb_keeps_the_last_good_level() -> None:
    end, tried = climbing(0.7, 1.0)
    assert end.outcome < 0
    assert end.load_factor is not None
    assert 0.7 - 0.05 <= end.load_factor <= 0.7
    assert end.state[0] == end.load_factor
    assert len(tried) < 20


def test_climb_that_never_starts() -> None:
    end, tried = climbing(-1.0, 1.0)
    assert end.load_factor is None
    assert end.state[0] == 0.0
    assert len(tried) < 5


def half_tube(*, mirrored: bool) -> Pattern:
    """Half a capped tube, y > 0, on a structured grid; or both halves, exact mirror images."""
    length, radius, around, rows = 0.04, 0.01, 7, 8
    angles, heights = np.linspace(0, np.pi, around), np.linspace(0, length, rows)
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    modified = np.linalg.norm(ring[1] - ring[0])
    u, v = np.meshgrid(modified * np.arange(around), heights)
    node = np.arange(around * rows).reshape(rows, around)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    grid = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    flat = np.column_stack([u.ravel(), v.ravel()])
    wall = np.column_stack([np.tile(ring, (rows, 1)), v.ravel()])
    disc = np.concatenate([ring, np.zeros((1, 2))])
    first = np.arange(around - 1)
    fan = np.stack([first, first + 1, np.full(around - 1, around)], axis=1)
    sheets: list[tuple[str, Any, Any, Any]] = [("wall", flat, grid, wall)]
    for name, height in (("base", 0.0), ("tip", length)):
        face = np.column_stack([disc, np.full(len(disc), height)])
        turned = (disc * [1, -1], fan[:, ::-1]) if name == "base" else (disc, fan)
        sheets.append((name, *turned, face))
    panels = [Panel(*sheet) for sheet in sheets]
    if mirrored:
        panels += [
            Panel(f"{name} mirrored", plane * [-1, 1], triangles[:, ::-1], points * [1, -1, 1])
            for name, plane, triangles, points in sheets
        ]
    return Pattern.from_panels(panels, tolerance=1e-6)


@pytest.mark.parametrize("curvature", [None, *CURVATURES])
def test_half_a_tube_equals_the_whole(comm: MPI.Comm, curvature: str | None) -> None:
    """Positions, energy and volume."""
    composite = Composite(bending=Bending(curvature) if curvature else None)
    half, whole = half_tube(mirrored=False), half_tube(mirrored=True)
    fixed = clamp(half, ["base"]) | symmetry_plane(half, 1)
    results, places = [], []
    for pattern, supports in ((half, fixed), (whole, clamp(whole, ["base", "base mirrored"]))):
        skin = sew(comm, pattern)
        solver = EquilibriumSolver(skin, composite, supports)
        density = (pattern.points[pattern.triangles].mean(axis=1)[:, 0] > 5e-3).astype(float)
        results.append(solver.solve(density[skin.owned_cells], 2e3))
        places.append(skin.gather_vertices(results[-1].positions))
    one, two = results
    assert 2 * one.volume == pytest.approx(two.volume, rel=1e-8)
    assert 2 * one.energy == pytest.approx(two.energy, rel=1e-8)
    there = np.linalg.norm(whole.points[:, None] - half.points, axis=2).argmin(axis=0)
    assert np.abs(places[1][there] - places[0]).max() < 1e-8 * half.size
    assert np.abs(places[0] - half.points).max() > 0.02 * half.size


def test_bad_symmetry_planes(comm: MPI.Comm) -> None:
    half = half_tube(mirrored=False)
    with pytest.raises(errors.ParameterError, match="axis = 3"):
        symmetry_plane(half, 3)
    with pytest.raises(errors.ParameterError, match="no free edge lies in the plane x = 0"):
        symmetry_plane(half, 0)
    # Held at its base alone, half a tube is open.
    skin = sew(comm, half)
    solver = EquilibriumSolver(skin, Composite(bending=None), clamp(half, ["base"]))
    with pytest.raises(errors.OpenSkinError, match="edges are free"):
        solver.solve(np.zeros(len(skin.owned_cells)), 1e3)


def test_folded_sheet_buckles(comm: MPI.Comm) -> None:
    """Pulled across stiff islands a sheet wrinkles: the flat state is a saddle to be left."""
    size, stretch = 0.02, 1.4
    flat = square(n=8, size=size).flat_points
    points = np.column_stack([stretch * flat[:, 0], flat[:, 1], 0 * flat[:, 0]])
    pattern = square(points, n=8, size=size)
    ends = (flat[:, 0] < 1e-9) | (flat[:, 0] > size - 1e-9)
    fixed = clamp(pattern, ["sheet"]).fixed & ends[:, None]
    skin = sew(comm, pattern)
    cloth = Material(young=0.1e6, poisson=0.3, thickness=0.05e-3)
    print_ = Material(young=30e6, poisson=0.3, thickness=0.05e-3)
    solver = EquilibriumSolver(
        skin, Composite(fabric=cloth, reinforcement=print_), type(clamp(pattern, ["sheet"]))(fixed)
    )
    middle = pattern.centroids - size / 2
    island = (np.linalg.norm(middle, axis=1) < size / 3).astype(float)
    result = solver.solve(island[skin.owned_cells], 0.0)
    assert result.converged
    eigenvalues = np.linalg.eigvalsh(dense(solver.model, result.state, 1.0))
    assert eigenvalues[0] > 0
