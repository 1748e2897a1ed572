"""Motion of rigid bodies against differences, matrices and the exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from toros_fem.mechanics.contact.bodies import (
    placed,
    pose_curvature,
    pose_jacobian,
    rotation,
    shortest,
)

AXIS = np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])
ANGLES = [0.0, 1e-9, 1e-3, 0.3, 0.999, 1.001, 2.0, 3.0, 6.0]


@pytest.fixture(scope="module")
def cloud() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a body of centimetres, its centre and a force on each point."""
    rng = np.random.default_rng(4)
    points = 0.01 * rng.standard_normal((7, 3))
    return points + 0.3, points.mean(axis=0) + 0.3, rng.standard_normal((7, 3))


def pose_at(angle: float) -> np.ndarray:
    return np.concatenate([[0.02, -0.01, 0.03], angle * AXIS])


@pytest.mark.parametrize("angle", ANGLES)
def test_rotations_are_exponentials(angle: float) -> None:
    x, y, z = angle * AXIS
    matrix = rotation(angle * AXIS)
    assert matrix == pytest.approx(expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])), abs=2e-14)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=4e-15)


def test_a_quarter_turn_about_the_centre() -> None:
    points = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    pose = np.array([0.0, 0.0, 5.0, 0.0, 0.0, np.pi / 2])
    expected = [[1.0, 0.0, 5.0], [1.0, 1.0, 5.0]]
    assert placed(points, points[0], pose) == pytest.approx(np.array(expected), abs=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
def test_derivatives(angle: float, cloud: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Central differences of fourth order: their error is below 1e-9 of the arm or force."""
    points, centre, force = cloud
    pose, h = pose_at(angle), 1e-3
    jacobian = pose_jacobian(points, centre, pose)
    curvature = pose_curvature(points, centre, pose, force)
    assert curvature == pytest.approx(curvature.T, abs=1e-17)
    for k, unit in enumerate(np.eye(6)):
        far = [placed(points, centre, pose + s * h * unit).ravel() for s in (-2, -1, 1, 2)]
        found = np.dot([1, -8, 8, -1], far) / (12 * h)
        assert jacobian[:, k] == pytest.approx(found, abs=1e-11)
        slopes = [
            force.ravel() @ pose_jacobian(points, centre, pose + s * h * unit)
            for s in (-2, -1, 1, 2)
        ]
        assert curvature[:, k] == pytest.approx(np.dot([1, -8, 8, -1], slopes) / (12 * h), abs=1e-9)


def test_a_whole_turn_loses_two_ranks(
    cloud: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    points, centre, _ = cloud
    ranks = {
        angle: np.linalg.matrix_rank(pose_jacobian(points, centre, pose_at(angle)), 1e-9)
        for angle in (0.0, np.pi, 2 * np.pi)
    }
    assert ranks == {0.0: 6, np.pi: 6, 2 * np.pi: 4}


@pytest.mark.parametrize("angle", [0.0, 3.0, 3.3, 6.0, 2 * np.pi, 9.0, 20.0])
def test_shortest(angle: float) -> None:
    vector = shortest(angle * AXIS)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    assert rotation(vector) == pytest.approx(rotation(angle * AXIS), abs=1e-14)
