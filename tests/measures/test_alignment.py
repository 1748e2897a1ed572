"""Objectives after a rigid motion onto the target."""

import numpy as np
import pytest
from helpers.objectives import TARGET
from scipy.spatial.transform import Rotation

from toros_fem.measures.alignment import AlignedObjective
from toros_fem.measures.shape import ShapeObjective
from toros_fem.meshes import Skin


def test_alignment_removes_rigid_motions(short_tube: Skin) -> None:
    points = short_tube.pattern.points
    target = TARGET(points)
    aligned = AlignedObjective(short_tube, target, ShapeObjective(short_tube, target))
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    moved = (target @ turn.T + [0.1, 0.2, -0.3])[short_tube.owned_vertices]
    assert aligned.forward(moved) == pytest.approx(0.0, abs=1e-15)
    assert aligned.aligned(moved) == pytest.approx(target[short_tube.owned_vertices], abs=1e-12)
    plain = points[short_tube.owned_vertices]
    value = aligned.forward(plain)
    assert aligned.forward(plain @ turn.T + [1.0, 0, 0]) == pytest.approx(value, rel=1e-9)
    assert value <= ShapeObjective(short_tube, target).forward(plain) * (1 + 1e-12)
    gradient = short_tube.gather_vertices(aligned.backward(plain))
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    torque = np.cross(points, gradient).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(np.cross(points, gradient)).sum()
