"""Turns and ways of a region seen from another: rigid motions that are known."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.measures.between_regions import (
    bend_between,
    length_between,
    tip_frame,
    twist_between,
)
from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern

X = (1.0, 0.0, 0.0)
# Swing about an axis across z, then what a twist about z came before.
SWING, TWIST = Rotation.from_rotvec([0.0, 0.9, 0.0]), Rotation.from_rotvec([0.0, 0.0, -2.5])


@pytest.fixture(scope="module")
def tube(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.1, 0.02, 5e-3)


@pytest.mark.parametrize("whole", [Rotation.identity(), Rotation.from_rotvec([1.0, -2.0, 0.5])])
def test_known_motion(tube: Pattern, whole: Rotation) -> None:
    """The tip turns and moves; seen from the root it is the same if all is turned once more."""
    root, tip = tube.points[:, 2] < 0.02, tube.points[:, 2] > 0.07
    way, positions = np.array([4e-3, -7e-3, 2e-3]), tube.points.copy()
    centre = np.average(tube.points[tip], axis=0, weights=tube.vertex_areas[tip])
    turn = SWING * TWIST
    positions[tip] = turn.apply(tube.points[tip] - centre) + centre + way
    positions = whole.apply(positions) + [0.1, 0.2, 0.3]
    seen = (tube, positions, tip, root)
    assert bend_between(*seen, toward=X) == pytest.approx(0.9, abs=1e-9)
    assert bend_between(*seen) == pytest.approx(turn.magnitude(), abs=1e-9)
    assert twist_between(*seen) == pytest.approx(-2.5, abs=1e-9)
    frame = tip_frame(*seen)
    np.testing.assert_allclose(frame.displacement, way, atol=1e-12)
    np.testing.assert_allclose(frame.direction, [np.sin(0.9), 0, np.cos(0.9)], atol=1e-9)
    assert frame.lean == pytest.approx(0.9, abs=1e-9)
    below = np.average(tube.points[root], axis=0, weights=tube.vertex_areas[root])
    ratio = np.linalg.norm(centre + way - below) / np.linalg.norm(centre - below)
    assert length_between(*seen) == pytest.approx(ratio, abs=1e-12)
    far = tip_frame(tube, positions, tip)
    np.testing.assert_allclose(far.direction, (whole * turn).apply([0, 0, 1]), atol=1e-9)
