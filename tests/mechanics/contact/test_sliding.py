"""Friction on ground and bodies: its derivatives backward, and that it moves with the bodies."""

import numpy as np
import pytest
from kit.slopes import slope

from toros_fem.mechanics.contact.bodies import placed
from toros_fem.mechanics.contact.sliding import SlidingFriction
from toros_fem.mechanics.contact.solids import rigid_box

COUNT, SLIP = 8, 1e-4
BOX = rigid_box("box", (0.02, 0.03, 0.01))
NUMBERS = np.random.default_rng(1)
POINTS = NUMBERS.uniform(-1e-2, 1e-2, (COUNT, 3))
POSES = np.array([[2e-3, -1e-3, 1e-3, 0.4, -0.3, 0.9]])
NORMALS = NUMBERS.standard_normal((2, COUNT, 3))
NORMALS[0, :2] = 0.0
NORMALS[1, 2:4] = 0.0


@pytest.fixture
def friction() -> SlidingFriction:
    """Anchors from a fraction of the slip to several times of it away."""
    found = SlidingFriction(0.5, SLIP, 1, [BOX])
    rest = found.at_rest(POINTS, POSES)
    away = (
        np.random.default_rng(2).standard_normal(rest.shape)
        * SLIP
        * np.linspace(0.2, 3, COUNT)[:, None]
    )
    found.begin(rest + away)
    found.lag(NORMALS, POINTS, POSES)
    return found


def test_at_rest_nothing_pulls(friction: SlidingFriction) -> None:
    friction.begin(friction.at_rest(POINTS, POSES))
    friction.lag(NORMALS, POINTS, POSES)
    assert np.abs(friction.force(POINTS, POSES)).max() < 1e-12
    assert friction.energy(POINTS, POSES) == pytest.approx(0, abs=1e-20)


def test_nothing_slides_where_skin_and_body_turn_together(friction: SlidingFriction) -> None:
    centre = BOX.centre
    where_made = friction.at_rest(POINTS, POSES)[1]
    friction.begin(friction.at_rest(POINTS, POSES))
    normals = NORMALS.copy()
    normals[0] = 0
    friction.lag(normals, POINTS, POSES)
    turned = np.array([[5e-3, 0.0, 2e-3, -1.0, 0.5, 0.2]])
    assert friction.energy(placed(where_made, centre, turned[0]), turned) < 1e-20
    assert friction.energy(POINTS, turned) > 1e-6


def test_backward_through_force(friction: SlidingFriction) -> None:
    rng = np.random.default_rng(3)
    pushed = 1e-5 * rng.standard_normal(NORMALS.shape) * (NORMALS != 0)
    adjoint = rng.standard_normal(NORMALS.shape)
    anchors = friction.anchors

    def at(s: float) -> SlidingFriction:
        friction.begin(anchors)
        friction.lag(NORMALS + s * pushed, POINTS, POSES)
        return friction

    told = (friction.force_backward(POINTS, POSES, adjoint) * pushed).sum()
    found = slope(lambda h: (at(h).force(POINTS, POSES) * adjoint).sum())
    assert told == pytest.approx(found, abs=1e-7 * np.abs(told))


def test_a_step_ends_at_the_elastic_slip(friction: SlidingFriction) -> None:
    force = friction.force(POINTS, POSES)
    friction.begin(friction.end(POINTS, POSES))
    friction.lag(NORMALS, POINTS, POSES)
    assert friction.force(POINTS, POSES) == pytest.approx(force, abs=1e-9 * np.abs(force).max())
    again = friction.end(POINTS, POSES)
    assert again == pytest.approx(friction.anchors, abs=1e-12)
    free = ~NORMALS[0].any(axis=1)
    assert again[0, free] == pytest.approx(POINTS[free], abs=0)


def test_friction_turns_nothing_together(friction: SlidingFriction) -> None:
    """On skin and body it acts along one line, however far the anchor lies off the surface."""
    poses = POSES * [[1, 1, 1, 0, 0, 0]]
    anchors = friction.at_rest(POINTS, poses)
    anchors[1] += SLIP * POINTS / 1e-2 + 5e-3 * NORMALS[1]
    friction.begin(anchors)
    friction.lag(NORMALS, POINTS, poses)
    force = friction.force(POINTS, poses)
    wrench = -force[1].ravel() @ friction.by_pose(0, poses)
    centre = BOX.centre + poses[0, :3]
    assert np.abs(force[1]).max() > 0.1
    assert wrench[:3] == pytest.approx(-force[1].sum(axis=0))
    assert wrench[3:] == pytest.approx(-np.cross(POINTS - centre, force[1]).sum(axis=0))
