"""Distance from a target shape."""

import numpy as np
import pytest
from helpers.objectives import TARGET

from toros_fem.measures.shape import ShapeObjective, SumObjective
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
