"""Several pressure chambers: walls between them, balance, gradients, symmetry."""

import numpy as np
import pytest
from helpers.models import pressurize
from helpers.scenes import TABLE_A
from helpers.standing import model_on_base, solver_on_base
from kit.slopes import slope
from mpi4py import MPI
from scipy.sparse import csr_matrix

from toros_fem.base.mpi import norm, total
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.chambers import Chambers, Fan, chambers_of_panels, find_walls
from toros_fem.mechanics.skin.supports import Planes, clamp
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.mechanics.terms.tangent import UpperTangent
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
    sheet = Composite(bending=None)
    chambers = sectors(grid.pattern, count) if count else halves(grid.pattern)
    models = [model_on_base(grid, sheet), model_on_base(grid, sheet, chambers=chambers)]
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


RING = np.stack([np.arange(5), np.roll(np.arange(5), -1)], axis=1)
EVEN = np.full(5, 0.2) + 0.1 * np.array([1, -1, 0.5, -0.5, 0])
FANS = {
    "closed wall": Fan(np.arange(5), RING, (0, 1), np.zeros(3), EVEN, np.ones(3)),
    "wall at a plane": Fan(
        np.arange(5), RING[:4], (0, 1), np.zeros(3), EVEN, np.array([1.0, 0, 1])
    ),
    "lid": Fan(np.arange(4), RING[:3], (0, -1), np.array([0, 0, 0.7]), np.zeros(4), np.zeros(3)),
}


@pytest.mark.parametrize("fan", FANS.values(), ids=FANS)
def test_derivatives_of_a_fan(fan: Fan) -> None:
    x, y = np.random.default_rng(0).standard_normal((2, len(fan.vertices), 3))
    rise = slope(lambda h: fan.volume(x + h * y))  # a cubic: exact
    assert (fan.gradient(x) * y).sum() == pytest.approx(rise, rel=1e-12)
    gap = fan.gradient(x + 0.5 * y) - fan.gradient(x - 0.5 * y)  # quadratic: exact
    rows, columns = np.indices((x.size, x.size)).reshape(2, -1)
    matrix = fan.hessian(x, rows, columns).reshape(x.size, x.size)
    assert matrix @ y.ravel() == pytest.approx(gap.ravel(), rel=1e-12, abs=1e-14)
    if fan is FANS["lid"]:
        blocks = np.abs(matrix).reshape(4, 3, 4, 3).max(axis=(1, 3)) > 0
        assert np.array_equal(blocks, fan.linked)


def test_axial_balance_across_a_wall(alone: MPI.Comm) -> None:
    """Each part of a tube pulls along with its pressure times the section; the wall takes the rest.

    At the assembled shape, a prism, what the border's nodes receive along z is known exactly.
    """
    pattern = cylinder(alone, LENGTH, 2 * RADIUS, 5e-3, mesh="structured")
    skin = sew(alone, pattern)
    composite = Composite(fabric=TABLE_A, bending=None)
    solver = solver_on_base(skin, composite, chambers=halves(pattern))
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
    solver = solver_on_base(grid, chambers=sectors(grid.pattern, 3))
    plain = np.zeros(len(grid.owned_cells))
    bent = solver.solve(plain, (3e3, 2e3, 2e3))
    assert min(bent.volumes) > 0
    assert "crosses" not in bent.reason
    tip = grid.pattern.vertices_of("tip")
    assert np.linalg.norm(grid.gather_vertices(bent.positions)[tip].mean(axis=0)[:2]) > LENGTH / 4
    crossed = solver.solve(plain, (4e3, 1e3, 1e3), start=bent.state)
    assert min(crossed.volumes) < 0
    assert "has a volume of -" in crossed.reason


def test_panels_as_chambers(grid: Skin) -> None:
    pattern = grid.pattern
    made = chambers_of_panels(pattern, {"ends": ["base", "tip"], "side": ["wall"]})
    assert made.of_cell[pattern.cells_of("tip")].tolist() == [0] * len(pattern.cells_of("tip"))
    fixed = clamp(pattern, ["base"])
    assert len(find_walls(pattern, made, Planes(pattern, fixed))) == 2
