"""Distances from a target, motions along directions, best rotations."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.designs import bounded, make_problem
from helpers.objectives import TARGET
from scipy.spatial.transform import Rotation

from toros_fem.base.mpi import dot
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.measures.shape import (
    ShapeObjective,
    SumObjective,
    axial,
    best_rotation,
    motion_along,
    polar_rotation,
)
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_objective_by_hand(short_tube: Skin) -> None:
    """Weights by vertex and by component, and the term of shape and orientation."""
    pattern, rng = short_tube.pattern, np.random.default_rng(0)
    count, areas, own = len(pattern.points), pattern.vertex_areas, short_tube.owned_vertices
    gap = rng.normal(size=(count, 3))
    target = TARGET(pattern.points)
    for weights in (None, rng.uniform(0, 1, count), rng.uniform(0, 1, (count, 3))):
        relative = None if weights is None else rng.uniform(0, 1, count)
        objective = ShapeObjective(short_tube, target, weights, relative)
        factors = np.ones((count, 1)) if weights is None else weights.reshape(count, -1)
        unit = (areas[:, None] * factors).sum() / factors.shape[1] * pattern.size**2
        expected = 0.5 * (areas[:, None] * factors * gap**2).sum() / unit
        if relative is not None:
            r = areas * relative
            expected += 0.5 * r @ ((gap - r @ gap / r.sum()) ** 2).sum(axis=1) / unit
        assert objective.forward((target + gap)[own]) == pytest.approx(expected, rel=1e-12)


def test_sum(short_tube: Skin) -> None:
    points = short_tube.pattern.points
    parts = [ShapeObjective(short_tube, TARGET(points)), ShapeObjective(short_tube, 1.1 * points)]
    x = points[short_tube.owned_vertices]
    both = SumObjective(*parts)
    assert both.forward(x) == sum(part.forward(x) for part in parts) > 0
    assert np.array_equal(both.backward(x), parts[0].backward(x) + parts[1].backward(x))


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


def test_polar_rotation_and_its_derivative() -> None:
    rng = np.random.default_rng(3)
    moments = rng.standard_normal((4, 3, 3))
    rotation, matrix = polar_rotation(moments)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert np.einsum("kij,kil->kjl", rotation, rotation) == pytest.approx(
        np.broadcast_to(np.eye(3), (4, 3, 3)), abs=1e-12
    )
    change, h = rng.standard_normal((4, 3, 3)), 1e-6
    plus, minus = (polar_rotation(moments + s * h * change)[0] for s in (1, -1))
    spin = np.asarray(np.swapaxes(rotation, 1, 2) @ (plus - minus) / (2 * h), dtype=np.float64)
    omega = np.linalg.solve(
        matrix, axial(np.swapaxes(rotation, 1, 2) @ change)[:, :, None]
    )[:, :, 0]  # fmt: skip
    assert axial(spin) / 2 == pytest.approx(omega, rel=1e-5)
    turn = Rotation.from_rotvec([0.3, 0.2, -1.0]).as_matrix()
    points = rng.standard_normal((9, 3))
    assert best_rotation(points, points @ turn.T + 1.0) == pytest.approx(turn, abs=1e-12)
