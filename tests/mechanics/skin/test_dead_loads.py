"""Dead loads in the simulation and in the design: the skin's own weight, and what it holds."""

import numpy as np
import pytest
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.mpi import total
from toros_fem.design.loop.fields import random_density
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.dead_loads import point_force, spread_force
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes import Skin

HEAVY = Weight(fabric=0.2, reinforcement=2.0, gravity=(9.0, 0.0, -3.0))


@pytest.fixture(scope="module")
def heavy(short_tube: Skin) -> EquilibriumSolver:
    return solver_on_base(short_tube, weight=HEAVY)


def test_supports_bear_the_weight_and_what_is_held(
    short_tube: Skin, heavy: EquilibriumSolver, alone: MPI.Comm
) -> None:
    density = random_density(short_tube, 3, spread=0.4)
    areas = short_tube.pattern.areas[short_tube.owned_cells]
    mass = total(alone, float(areas @ (0.2 + 1.8 * density)))
    fixed = spread_force(short_tube.pattern, "tip", [0.02, -0.01, 0.0])
    assert fixed.sum(axis=0) == pytest.approx([0.02, -0.01, 0.0], abs=1e-15)
    others = np.setdiff1d(np.arange(len(fixed)), short_tube.pattern.vertices_of("tip"))
    assert not fixed[others].any()
    result = heavy.solve(density, Load(3e3, force=fixed))
    assert "its own weight" in result.reason
    pull = heavy.reactions(result).sum(axis=0)
    expected = -mass * np.array(HEAVY.gravity) - [0.02, -0.01, 0.0]
    assert pull == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())
    by_weight = heavy.solve(density, 0.0)
    assert heavy.reactions(by_weight).sum(axis=0) == pytest.approx(
        -mass * np.array(HEAVY.gravity), abs=1e-8
    )


def test_force_at_a_point(short_tube: Skin) -> None:
    """It has the right sum and the right moment, wherever it acts."""
    pattern, pull = short_tube.pattern, np.array([0.3, -0.2, 0.5])
    corner = pattern.points[pattern.triangles[7]]
    inside = np.array([0.2, 0.5, 0.3]) @ corner
    found = point_force(pattern, inside, pull)
    assert found[pattern.triangles[7]] == pytest.approx(np.outer([0.2, 0.5, 0.3], pull), abs=1e-12)
    assert np.cross(pattern.points, found).sum(axis=0) == pytest.approx(
        np.cross(inside, pull), abs=1e-15
    )
    panel = pattern.panel_names[pattern.panel[7]]
    flat = point_force(pattern, [0.2, 0.5, 0.3] @ pattern.corners[7], pull, panel)
    assert flat == pytest.approx(found, abs=1e-12)
    vertex = int(pattern.triangles[7, 1])
    alone = point_force(pattern, pattern.points[vertex] * 1.0001, pull)
    assert alone[vertex] == pytest.approx(pull, rel=0.01)
    assert alone.sum(axis=0) == pytest.approx(pull)


def test_force_beside_the_skin(short_tube: Skin) -> None:
    pattern = short_tube.pattern
    cap = pattern.points[pattern.triangles[pattern.cells_of("tip")[0]]].mean(axis=0)

    def outside(part: float) -> np.ndarray:
        """Above the flat tip, by a part of the farthest that is taken, a hundredth of the skin."""
        return np.asarray(cap + [0.0, 0.0, 0.01 * part * pattern.size])

    with pytest.raises(errors.ParameterError, match="away from the assembled skin; at most"):
        point_force(pattern, outside(1.1), [0, 0, 1])
    assert point_force(pattern, outside(0.9), [0, 0, 1]).sum() == pytest.approx(1)
