"""The shape objective inside a design."""

import numpy as np
import pytest

from toros_fem import errors
from toros_fem.measures.shape import ShapeObjective
from toros_fem.meshes import Skin


def test_objective_by_hand(tube: Skin) -> None:
    target = tube.pattern.points + [0.003, 0.0, 0.004]
    state = tube.pattern.points[tube.owned_vertices]
    value = ShapeObjective(tube, target).forward(state)
    assert value == pytest.approx(0.5 * (0.005 / tube.pattern.size) ** 2, rel=1e-12)
    only = (tube.pattern.points[:, 2] > 0.059).astype(float)
    away = np.where(only[:, None] > 0, tube.pattern.points + [0, 0.001, 0], 7.0)
    value = ShapeObjective(tube, away, only).forward(state)
    assert value == pytest.approx(0.5 * (0.001 / tube.pattern.size) ** 2, rel=1e-12)


def test_relative_objective_sees_turning_and_not_place(tube: Skin) -> None:
    """A part that is moved as it is costs nothing; turned, it costs by its own extent."""
    pattern = tube.pattern
    tip = (pattern.points[:, 2] > 0.059).astype(float)
    objective = ShapeObjective(tube, pattern.points, np.full(len(tip), 1e-12), tip)
    own = tube.owned_vertices
    moved = pattern.points + [0.01, 0.02, 0.0]
    assert objective.forward(moved[own]) < 1e-9 * objective.forward(0 * moved[own])
    weight = tip * pattern.vertex_areas
    gap = np.random.default_rng(0).normal(size=pattern.points.shape)
    gap -= weight @ gap / weight.sum()
    expected = 0.5 * weight @ (gap**2).sum(axis=1)
    expected /= 1e-12 * pattern.vertex_areas.sum() * pattern.size**2
    state = (moved + gap)[own]
    assert objective.forward(state) == pytest.approx(expected, rel=1e-9)


def test_bad_targets(tube: Skin) -> None:
    points = tube.pattern.points
    with pytest.raises(errors.TargetError, match=f"has {len(points)} vertices"):
        ShapeObjective(tube, points[:-1])
    wrong = points.copy()
    wrong[11, 2] = np.nan
    with pytest.raises(errors.TargetError, match="target vertex 11"):
        ShapeObjective(tube, wrong)
    with pytest.raises(errors.ParameterError, match="weights"):
        ShapeObjective(tube, points, np.zeros(len(points)))
