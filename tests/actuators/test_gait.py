"""The cycle of a walker: which feet grip, and where the robot goes."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem.actuators.gait import Gait, walking_positions
from toros_fem.actuators.legs import tip_positions
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.meshes import WALKER, plane_centroids, walker


def test_pressures_of_a_cycle() -> None:
    """From the end of the last phase through all phases, in equal steps."""
    gait = Gait(("front", "rear"), np.array([[1.0, 0.0], [0.5, 1.0]]), 2, (0, 1), 0.4)
    fractions = np.array([[0.5, 1.0], [0.75, 0.5], [1.0, 0.0], [0.75, 0.5], [0.5, 1.0]])
    assert gait.pressure_fractions == pytest.approx(fractions)
    assert gait.gripping.tolist() == [[True, True], [True, True], [True, False], [True, True],
                                      [True, True]]  # fmt: skip


def test_feet_that_grip_stay(comm: MPI.Comm) -> None:
    """A robot that only swings its legs gets ahead by what the gripping ones swing back."""
    pattern = walker(comm, 8e-3)
    gait = Gait(("front", "rear"), np.array([[1.0, 0], [1, 1], [0, 1]]), 1, (0, 1, 1, 0))
    swing = np.array([0.0, -3e-3, -3e-3, 0.0])  # of the front legs: back while they grip
    place = plane_centroids(pattern)
    assert len(place) == len(pattern.panel)
    points = []
    tilt = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    legs = (pattern.points[:, :2] @ WALKER.directions.T > WALKER.root).any(axis=1)
    for back in swing:
        moved = pattern.points.copy()
        moved[legs & (moved[:, 0] > 0), 0] += back
        result: Any = None
        points.append(TracePoint(0.0, moved @ tilt.T + 0.7, {}, result))
    shapes, feet = walking_positions(gait, pattern, points, WALKER.directions, WALKER.root)
    assert feet[0, :, 2] == pytest.approx(0.0, abs=1e-9)
    front = WALKER.directions[:, 0] > 0
    # Phase 1: the front feet do not grip before; then they hold, later the rear ones do.
    step = np.diff(feet[:, :, 0], axis=0)
    assert step[1, front] == pytest.approx(0.0, abs=1e-12)
    assert step[2, ~front] == pytest.approx(0.0, abs=1e-12)
    assert len(shapes) == 4
    assert tip_positions(pattern, shapes[0], WALKER.directions) == pytest.approx(feet[0])
    with pytest.raises(errors.ParameterError, match="phases has shape"):
        Gait(("one",), np.zeros((2, 2)), 1, (0,))
    with pytest.raises(errors.ParameterError, match="no foot grips the ground at step 2"):
        Gait(("front", "rear"), np.array([[1.0, 0], [0, 0], [0, 1]]), 1, (0, 1))


def test_a_step_on_other_feet_loses_no_ground(comm: MPI.Comm) -> None:
    """From front feet to rear feet at once: the body stays above where it got to."""
    pattern = walker(comm, 8e-3)
    gait = Gait(("front", "rear"), np.array([[1.0, 1], [1, 0], [0, 1]]), 1, (0, 1, 1, 0))
    legs = (pattern.points[:, :2] @ WALKER.directions.T > WALKER.root).any(axis=1)
    points = []
    for back in np.array([0.0, -3e-3, -3e-3, -3e-3]):
        moved = pattern.points.copy()
        moved[legs, 0] += back
        result: Any = None
        points.append(TracePoint(0.0, moved, {}, result))
    shapes, feet = walking_positions(gait, pattern, points, WALKER.directions, WALKER.root)
    body = ~legs & (np.hypot(*pattern.points[:, :2].T) < 0.01)
    ahead = [shape[body, 0].mean() for shape in shapes]
    assert np.diff(ahead) == pytest.approx([3e-3, 0.0, 0.0], abs=1e-9)
    assert (feet[-1] - feet[0])[:, 0] == pytest.approx(0.0, abs=1e-9)
