"""Distance from a target shape."""

import numpy as np
import pytest
from helpers.objectives import TARGET

from toros_fem import errors
from toros_fem.measures.shape import ShapeObjective, SumObjective
from toros_fem.meshes import Skin


def test_sum(tube: Skin) -> None:
    points = tube.pattern.points
    parts = [ShapeObjective(tube, TARGET(points)), ShapeObjective(tube, 1.1 * points)]
    x = points[tube.owned_vertices]
    both = SumObjective(*parts)
    assert both.forward(x) == sum(part.forward(x) for part in parts) > 0
    assert np.array_equal(both.backward(x), parts[0].backward(x) + parts[1].backward(x))


def test_integers_and_lists_are_numbers(tube: Skin) -> None:
    points = tube.pattern.points
    count = len(points)
    x = points[tube.owned_vertices]
    plain = ShapeObjective(tube, TARGET(points), np.ones(count), np.ones(count))
    other = ShapeObjective(tube, TARGET(points).tolist(), np.ones(count, dtype=int), [1] * count)  # type: ignore[arg-type]
    assert other.forward(x) == plain.forward(x)
    assert np.array_equal(other.backward(x), plain.backward(x))


def test_bad_input(tube: Skin) -> None:
    points = tube.pattern.points
    with pytest.raises(errors.TargetError, match="the target has shape"):
        ShapeObjective(tube, points[1:])
    with pytest.raises(errors.TargetError, match="target vertex 3 = .* is not finite"):
        ShapeObjective(tube, np.where(np.arange(len(points))[:, None] == 3, np.nan, points))
    with pytest.raises(errors.ParameterError, match="weights have shape"):
        ShapeObjective(tube, points, np.ones((len(points), 2)))
    with pytest.raises(errors.ParameterError, match="relative must be finite and not negative"):
        ShapeObjective(tube, points, relative=-np.ones(len(points)))
    with pytest.raises(errors.ParameterError, match="must not all be zero"):
        ShapeObjective(tube, points, np.zeros(len(points)))
