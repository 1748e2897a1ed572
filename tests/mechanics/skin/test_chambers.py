"""Several pressure chambers: walls between them, balance, gradients, symmetry."""

import numpy as np
import pytest
from helpers.designs import bounded
from helpers.models import pressurize
from helpers.scenes import TABLE_A
from kit.slopes import slope
from mpi4py import MPI
from scipy.sparse import csr_matrix

from toros_fem.base.mpi import norm, total
from toros_fem.design.density.cone import cone_filter
from toros_fem.design.density.field import random_density
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.materials.sheet import Composite
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.assembly.tangent import UpperTangent
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers, Fan, chambers_of_panels, find_walls
from toros_fem.mechanics.skin.supports import Planes, clamp
from toros_fem.meshes import Pattern, Skin, cylinder, sew

LENGTH, RADIUS = 0.06, 0.01


def centres(pattern: Pattern) -> np.ndarray:
    return pattern.points[pattern.triangles].mean(axis=1)


def halves(pattern: Pattern) -> Chambers:
    """The lower and the upper half of a tube along z."""
    return Chambers(("lower", "upper"), (centres(pattern)[:, 2] > LENGTH / 2).astype(int))


def sectors(pattern: Pattern, count: int) -> Chambers:
    """Chambers side by side along a tube, which meet at the middle of both caps."""
    x, y, _ = centres(pattern).T
    of_cell = ((np.arctan2(y, x) + np.pi) / (2 * np.pi) * count).astype(int)
    return Chambers(tuple("abcdef"[:count]), of_cell)


@pytest.fixture(scope="module")
def grid(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, LENGTH, 2 * RADIUS, 5e-3, mesh="structured"))


@pytest.fixture(scope="module")
def two(grid: Skin) -> EquilibriumSolver:
    fixed = clamp(grid.pattern, ["base"])
    return EquilibriumSolver(grid, Composite(), fixed, chambers=halves(grid.pattern))


def moved(model: SkinModel) -> np.ndarray:
    """A smooth state away from symmetry, the same on any number of ranks but for rotations."""
    state = model.assembled
    x, y, z = model.positions(state).T.copy()
    s = z / LENGTH
    model.positions(state).T[:] = 1.1 * x + 0.01 * s**2, 1.05 * y + 0.002 * s, 1.05 * z + 0.1 * x
    return state


@pytest.mark.parametrize("count", [0, 2, 3, 4])
def test_equal_pressures_are_one_chamber(grid: Skin, count: int) -> None:
    """Energy, force and tangent to rounding, wherever the origin is."""
    fixed, sheet = clamp(grid.pattern, ["base"]), Composite(bending=None)
    chambers = sectors(grid.pattern, count) if count else halves(grid.pattern)
    models = [make_model(grid, sheet, fixed), make_model(grid, sheet, fixed, chambers=chambers)]
    values = []
    for model in models:
        model.set_density(np.zeros(len(grid.owned_cells)))
        pressurize(model, *[3e3] * len(model.load.pressures))
        state = moved(model)
        model.positions(state)[:] += [0.1, 0.2, -0.3]  # chambers that are closed bodies do not mind
        tangent = UpperTangent(model)
        entries = np.zeros(len(tangent.columns))
        tangent.assemble(state, entries)
        shape = (model.size_local, model.space.dofmap.index_map.size_global)
        rows = csr_matrix((entries, tangent.columns, tangent.indptr), shape=shape)
        values.append((model.energy(state), model.residual(state), rows, model.volumes(state)))
    one, many = values
    assert many[0] == pytest.approx(one[0], rel=1e-11)
    assert norm(grid.comm, many[1] - one[1]) < 1e-12 * norm(grid.comm, one[1])
    gap = (many[2] - one[2]).tocsr().data
    assert norm(grid.comm, gap) < 1e-12 * norm(grid.comm, one[2].data)
    assert many[3].sum() == pytest.approx(one[3].sum(), rel=1e-12)
    there = moved(models[1])
    shifted = there.copy()
    models[1].positions(shifted)[:] += [0.1, 0.2, -0.3]
    assert models[1].volumes(shifted) == pytest.approx(models[1].volumes(there), rel=1e-10)
    shares = models[1].volumes(models[1].assembled) / one[3].sum()
    assert shares.min() > 0.1, "each is a body"


def hessian(fan: Fan, x: np.ndarray) -> np.ndarray:
    """The whole matrix."""
    rows, columns = np.indices((x.size, x.size)).reshape(2, -1)
    return fan.hessian(x, rows, columns).reshape(x.size, x.size)


@pytest.mark.parametrize("closed", [True, False])
def test_derivatives_of_a_wall(closed: bool) -> None:
    rng = np.random.default_rng(0)
    weights, kept = rng.random(5), np.ones(3) if closed else np.array([1.0, 0.0, 1.0])
    edges = np.stack([np.arange(5), np.roll(np.arange(5), -1)], axis=1)[: 5 if closed else 4]
    wall = Fan(np.arange(5), edges, (0, 1), np.zeros(3), weights / weights.sum(), kept)
    x, y = rng.standard_normal((2, 5, 3))
    rise = slope(lambda h: wall.volume(x + h * y))  # a cubic: exact
    assert (wall.gradient(x) * y).sum() == pytest.approx(rise, rel=1e-12)
    gap = wall.gradient(x + 0.5 * y) - wall.gradient(x - 0.5 * y)  # quadratic: exact
    assert hessian(wall, x) @ y.ravel() == pytest.approx(gap.ravel(), rel=1e-12, abs=1e-14)


def test_derivatives_of_a_lid() -> None:
    rng = np.random.default_rng(0)
    edges, foot = np.array([[0, 1], [1, 2], [2, 3]]), np.array([0, 0, 0.7])
    lid = Fan(np.arange(4), edges, (0, -1), foot, np.zeros(4), np.zeros(3))
    x, y = rng.standard_normal((2, 4, 3))
    rise = slope(lambda h: lid.volume(x + h * y))  # a cubic: exact
    assert (lid.gradient(x) * y).sum() == pytest.approx(rise, rel=1e-12)
    gap = lid.gradient(x + 0.5 * y) - lid.gradient(x - 0.5 * y)  # quadratic: exact
    matrix = hessian(lid, x)
    assert matrix @ y.ravel() == pytest.approx(gap.ravel(), rel=1e-12, abs=1e-14)
    blocks = np.abs(matrix).reshape(4, 3, 4, 3).max(axis=(1, 3)) > 0
    assert np.array_equal(blocks, lid.linked)


def test_axial_balance_across_a_wall(alone: MPI.Comm) -> None:
    """Each part of a tube pulls along with its pressure times the section; the wall takes the rest.

    At the assembled shape, a prism, what the border's nodes receive along z is known exactly.
    """
    pattern = cylinder(alone, LENGTH, 2 * RADIUS, 5e-3, mesh="structured")
    skin = sew(alone, pattern)
    composite = Composite(fabric=TABLE_A, bending=None)
    solver = EquilibriumSolver(skin, composite, clamp(pattern, ["base"]), chambers=halves(pattern))
    low, high = 1e3, 4e3
    found = solver.solve(np.zeros(len(skin.owned_cells)), (high, low))
    assert found.converged
    assert found.pressure == high
    assert found.pressures == (high, low)
    assert sum(found.volumes) == pytest.approx(found.volume)
    assert "4000 and 1000 Pa" in found.reason
    # The pressure in a closed body has no resultant force, so that the supports bear none in sum.
    pull = skin.gather_vertices(solver.model.positions(solver.model.reaction(found.state)))
    area = np.pi * RADIUS**2
    assert np.abs(pull.sum(axis=0)).max() < 1e-7 * high * area
    # The assembled prism: the lower chamber pushes up with P·A on the ring it is cut at.
    gradient = solver.model.volume_gradient(solver.model.assembled, 0)
    thrust = solver.model.positions(gradient)[:, 2]
    sides = round(2 * np.pi * RADIUS / 5e-3)
    polygon = 0.5 * sides * np.sin(2 * np.pi / sides) * RADIUS**2
    assert total(alone, thrust.sum()) == pytest.approx(polygon, rel=1e-12)
    # Stretches along: where the pressure is higher the tube is longer.
    z, height = skin.gather_vertices(found.positions)[:, 2], pattern.points[:, 2]
    ring = [z[np.isclose(height, h)].mean() for h in LENGTH * np.array([0.25, 0.5, 0.75])]
    assert ring[1] - ring[0] > ring[2] - ring[1]


def test_a_wall_that_crosses_the_skin_is_told(grid: Skin) -> None:
    """Three chambers side by side bend the tube; far apart, the walls give way."""
    fixed = clamp(grid.pattern, ["base"])
    solver = EquilibriumSolver(grid, Composite(), fixed, chambers=sectors(grid.pattern, 3))
    plain = np.zeros(len(grid.owned_cells))
    bent = solver.solve(plain, (3e3, 2e3, 2e3))
    assert min(bent.volumes) > 0
    assert "crosses" not in bent.reason
    tip = grid.pattern.vertices_of("tip")
    assert np.linalg.norm(grid.gather_vertices(bent.positions)[tip].mean(axis=0)[:2]) > LENGTH / 4
    crossed = solver.solve(plain, (4e3, 1e3, 1e3), start=bent.state)
    assert min(crossed.volumes) < 0
    assert "has a volume of -" in crossed.reason


def test_gradient_by_each_pressure(grid: Skin, two: EquilibriumSolver) -> None:
    points = grid.pattern.points
    problem = ShapeProblem(
        DensityFields(grid, cone_filter(grid, 8e-3)),
        InflatedSkin(two, (2e3, 5e3), (None, (1e3, 2e4))),
        ShapeObjective(grid, points * [1, 1, 1.1]),
    )
    density = random_density(grid, 2, spread=0.3)
    base, slopes = problem.evaluate(density)
    assert slopes.pressure_gradient[0] == 0
    both = bounded(problem, 1e3, 2e4)
    base, slopes = both.evaluate(density)
    state = base.equilibrium.state
    for k in range(2):
        step = np.eye(2)[k]
        ends = [problem.simulate(density, state, np.array([2e3, 5e3]) + s * step).objective
                for s in (1.0, -1.0)]  # fmt: skip
        assert slopes.pressure_gradient[k] == pytest.approx((ends[0] - ends[1]) / 2, rel=1e-4)
    result = optimize(problem, DesignOptions((Stage(3),)), start=density)
    assert result.history[-1].objective < result.history[0].objective
    assert result.pressures[0] == 2e3
    assert result.pressures[1] != 5e3
    assert result.pressure == max(result.pressures)


def test_panels_as_chambers(grid: Skin) -> None:
    pattern = grid.pattern
    made = chambers_of_panels(pattern, {"ends": ["base", "tip"], "side": ["wall"]})
    assert made.of_cell[pattern.cells_of("tip")].tolist() == [0] * len(pattern.cells_of("tip"))
    fixed = clamp(pattern, ["base"])
    assert len(find_walls(pattern, made, Planes(pattern, fixed))) == 2
