"""The best rotation and its derivative."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from toros_fem.measures.rotation import axial, best_rotation, polar_rotation


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
