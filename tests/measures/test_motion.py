"""Residuals along the responses to the pressures."""

import numpy as np
import pytest
from helpers.designs import bounded, make_problem

from toros_fem.base.mpi import dot
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.measures.motion import motion_along
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def shapes(tube: Skin) -> tuple[ShapeObjective, np.ndarray, list[np.ndarray]]:
    """An objective, positions and two directions."""
    points = tube.pattern.points
    target = points + 0.01 * np.sin(50 * points[:, ::-1])
    owned = points[tube.owned_vertices]
    moves = [
        3.0 * np.cos(40 * owned),
        np.stack([owned[:, 2], 0 * owned[:, 0], owned[:, 0]], axis=1),
    ]
    return ShapeObjective(tube, target), owned, moves


def test_squares_are_the_quadratic_part_along_the_directions(short_tube: Skin) -> None:
    objective, owned, moves = shapes(short_tube)
    motion = motion_along(short_tube, objective, owned, moves)
    base = objective.forward(owned) - (motion.offsets**2).sum()
    for a, b in ((2e-3, 0.0), (-1e-3, 0.1), (0.0, -0.2)):
        there = owned + a * moves[0] + b * moves[1]
        squares = (motion.along(there) ** 2).sum()
        assert objective.forward(there) - squares == pytest.approx(base, rel=1e-9)
        assert squares != pytest.approx((motion.offsets**2).sum(), rel=1e-3)
    # Across the directions the residuals stay.
    across = np.stack([0 * owned[:, 0], owned[:, 1] * owned[:, 2], 0 * owned[:, 0]], axis=1)
    local = [dot(short_tube.comm, d.ravel(), across.ravel()) for d in motion.directions]
    np.testing.assert_allclose(motion.along(owned + across) - motion.offsets, local)


def test_directions_that_do_nothing(short_tube: Skin) -> None:
    """Or the same as another one: the residuals stay finite."""
    objective, owned, moves = shapes(short_tube)
    assert motion_along(short_tube, objective, owned, []).offsets.size == 0
    none = motion_along(short_tube, objective, owned, [0 * owned])
    assert none.along(owned + moves[0]) == [0.0]
    (once,) = motion_along(short_tube, objective, owned, moves[:1]).offsets
    twice = motion_along(short_tube, objective, owned, [moves[0], moves[0]])
    assert (twice.offsets**2).sum() == pytest.approx(once**2, rel=1e-3)
    mixed = motion_along(short_tube, objective, owned, [moves[0], 0 * owned])
    np.testing.assert_allclose(mixed.offsets, [once, 0.0], rtol=1e-12)


class Saddle:
    """T = ½ Σ (y² − x²)."""

    def forward(self, positions: np.ndarray) -> float:
        raise NotImplementedError

    def backward(self, positions: np.ndarray) -> np.ndarray:
        return positions * [-1.0, 1.0, 0.0]


def test_a_concave_direction_has_a_finite_residual(short_tube: Skin) -> None:
    owned = short_tube.pattern.points[short_tube.owned_vertices]
    moves = [np.tile(row, (len(owned), 1)) for row in np.eye(3)[:2]]
    found = motion_along(short_tube, Saddle(), owned, moves)
    assert np.isfinite(found.offsets).all()
    assert np.isfinite(found.directions).all()
    assert np.abs(found.directions).max(axis=(1, 2)).min() > 0


def test_the_pressure_alone_can_gain_the_square(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    """T without the residual has no slope by the pressure."""
    problem = bounded(make_problem(short_tube, short_solver), 1e3, 9e3)
    density = random_density(short_tube, 1, spread=0.3)
    base, slopes = problem.evaluate(density, pressure=3e3)
    near = slopes.residuals
    (here,) = near.values(base.equilibrium)
    part = 2 * here * near.pressure_gradients[0]
    np.testing.assert_allclose(part, slopes.pressure_gradient, rtol=1e-7)


def test_a_prescribed_pressure_has_no_residual(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    problem = make_problem(short_tube, short_solver)
    base, slopes = problem.evaluate(random_density(short_tube, 1))
    assert slopes.residuals.gradients == []
    assert slopes.residuals.values(base.equilibrium).size == 0


@pytest.mark.slow
def test_the_pressure_does_not_swing(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """After the first steps it turns back by less than its move limit."""
    problem = bounded(make_problem(short_tube, short_solver), 1e3, 2e4)
    result = optimize(problem, DesignOptions((Stage(12),)), seed=1)
    pressures = np.log([row.pressure for row in result.history])
    changes = np.diff(pressures)[5:]
    turns = changes[1:] * changes[:-1] < 0
    assert np.abs(changes[1:][turns]).max(initial=0.0) < 0.1 * np.log(20) / 2
