"""Gap between a skin and a body: distances and objective."""

import numpy as np
import pytest

from toros_fem.measures.gap import Body, GapObjective
from toros_fem.meshes import Skin


def test_distance_from_bodies() -> None:
    ball = Body("sphere", 0.04, (0.0, 0.0, 0.1))
    points = np.array([[0.0, 0.0, 0.13], [0.01, 0.0, 0.1], [0.03, 0.04, 0.1]])
    distance, gradient = ball.distance(points)
    assert distance == pytest.approx([0.01, -0.01, 0.03])
    assert gradient == pytest.approx(np.array([[0, 0, 1], [1, 0, 0], [0.6, 0.8, 0]]))
    box = Body("box", 0.04, (0.0, 0.0, 0.0))
    points = np.array([[0.03, 0.0, 0.0], [0.0, -0.01, 0.0], [0.015 + 0.03, 0.015 + 0.04, 0.0]])
    distance, gradient = box.distance(points)
    assert distance == pytest.approx([0.01, -0.01, 0.05 - 0.005])
    assert gradient == pytest.approx(np.array([[1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]]))


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_integers_and_lists_are_numbers(short_tube: Skin, shape: str) -> None:
    weights = np.random.default_rng(4).uniform(0, 1, len(short_tube.pattern.points))
    x = short_tube.pattern.points[short_tube.owned_vertices] * 1.5
    whole = Body(shape, 1, (0, 0, 0), 1)
    plain = Body(shape, 1.0, (0.0, 0.0, 0.0), 1.0)
    ones = np.ones(len(weights))
    listed = GapObjective(short_tube, whole, [1] * len(weights), 2)  # type: ignore[arg-type]
    assert listed.forward(x) == GapObjective(short_tube, plain, ones, 2.0).forward(x) > 0
