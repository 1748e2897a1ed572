"""Objectives after a rigid motion onto the target."""

import numpy as np
import pytest
from helpers.objectives import TARGET, check_gradient, tube_sections
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem.measures.alignment import AlignedObjective
from toros_fem.measures.cross_sections import CrossSectionObjective
from toros_fem.measures.shape import ShapeObjective, SumObjective
from toros_fem.meshes import Skin


def test_taylor(tube: Skin, comm: MPI.Comm) -> None:
    """Of a sum of two objectives, the fit with weights of its own."""
    rng = np.random.default_rng(0)
    count = len(tube.pattern.points)
    target = TARGET(tube.pattern.points)
    both = SumObjective(
        CrossSectionObjective(tube, target, tube_sections(tube)),
        ShapeObjective(tube, target, rng.uniform(0, 1, (count, 3)), rng.uniform(0, 1, count)),
    )
    objective = AlignedObjective(tube, target, both, rng.uniform(0, 1, count))
    check_gradient(objective, tube, comm)


def test_alignment_removes_rigid_motions(tube: Skin) -> None:
    points = tube.pattern.points
    target = TARGET(points)
    aligned = AlignedObjective(tube, target, ShapeObjective(tube, target))
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    moved = (target @ turn.T + [0.1, 0.2, -0.3])[tube.owned_vertices]
    assert aligned.forward(moved) == pytest.approx(0.0, abs=1e-15)
    assert aligned.aligned(moved) == pytest.approx(target[tube.owned_vertices], abs=1e-12)
    plain = points[tube.owned_vertices]
    value = aligned.forward(plain)
    assert aligned.forward(plain @ turn.T + [1.0, 0, 0]) == pytest.approx(value, rel=1e-9)
    assert value <= ShapeObjective(tube, target).forward(plain) * (1 + 1e-12)
    gradient = tube.gather_vertices(aligned.backward(plain))
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    torque = np.cross(points, gradient).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(np.cross(points, gradient)).sum()


def test_alignment_needs_a_body(tube: Skin) -> None:
    line = tube.pattern.points * [0.0, 0.0, 1.0]
    objective = AlignedObjective(tube, line, ShapeObjective(tube, line))
    with pytest.raises(errors.TargetError, match="lies on a line"):
        objective.forward(line[tube.owned_vertices])
