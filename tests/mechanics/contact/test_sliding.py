"""Friction on ground and bodies: its derivatives, and that it moves with the bodies."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers.scenes import taylor_rates

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact import Contact, Ground
from toros_fem.mechanics.contact.motion import placed
from toros_fem.mechanics.contact.sliding import Sliding, SlidingFriction
from toros_fem.mechanics.contact.solids import rigid_box

COUNT, SLIP = 8, 1e-4
RNG = np.random.default_rng(1)
POINTS = RNG.uniform(-1e-2, 1e-2, (COUNT, 3))
POSES = np.array([[2e-3, -1e-3, 1e-3, 0.4, -0.3, 0.9]])
NORMALS = RNG.standard_normal((2, COUNT, 3))
NORMALS[0, :2] = 0.0
NORMALS[1, 2:4] = 0.0


@pytest.fixture
def friction() -> SlidingFriction:
    """Anchors from a fraction of the slip to several times of it away."""
    contact = Contact(Ground(), [rigid_box("box", (0.02, 0.03, 0.01))], friction=0.5, slip=SLIP)
    found = SlidingFriction(contact, contact.sizes(Composite()))
    rest = found.at_rest(POINTS, POSES).anchors
    away = RNG.standard_normal(rest.shape) * SLIP * np.linspace(0.2, 3, COUNT)[:, None]
    found.begin(Sliding(rest + away))
    found.lag(NORMALS, POINTS, POSES)
    return found


def along(shape: tuple[int, ...], size: float) -> np.ndarray:
    return RNG.standard_normal(shape) * size


def check(value: Callable[[float], float], slope: float) -> None:
    assert taylor_rates(value, slope, 0.1) == pytest.approx(2, abs=0.02)


def test_at_rest_nothing_pulls(friction: SlidingFriction) -> None:
    friction.begin(friction.at_rest(POINTS, POSES))
    friction.lag(NORMALS, POINTS, POSES)
    assert np.abs(friction.force(POINTS, POSES)).max() < 1e-12
    assert friction.energy(POINTS, POSES) == pytest.approx(0, abs=1e-20)


def test_nothing_slides_where_skin_and_body_turn_together(friction: SlidingFriction) -> None:
    centre = friction._centres[0]
    where_made = friction.at_rest(POINTS, POSES).anchors[1]
    friction.begin(friction.at_rest(POINTS, POSES))
    normals = NORMALS.copy()
    normals[0] = 0
    friction.lag(normals, POINTS, POSES)
    turned = np.array([[5e-3, 0.0, 2e-3, -1.0, 0.5, 0.2]])
    assert friction.energy(placed(where_made, centre, turned[0]), turned) < 1e-20
    assert friction.energy(POINTS, turned) > 1e-6


def test_forces_are_gradients(friction: SlidingFriction) -> None:
    move, turn = along(POINTS.shape, 1e-5), along(POSES.shape, 1e-5)
    force = friction.force(POINTS, POSES)
    check(
        lambda s: friction.energy(POINTS + s * move, POSES), float((force.sum(axis=0) * move).sum())
    )
    slope = float(friction.pose_force(0, force, POSES) @ turn[0])
    check(lambda s: friction.energy(POINTS, POSES + s * turn), slope)


def test_second_derivatives(friction: SlidingFriction) -> None:
    move, turn = along(POINTS.shape, 1e-5), along(POSES.shape, 1e-5)
    force, stiffness = friction.force(POINTS, POSES), friction.stiffness(POINTS, POSES)
    mixed, twice = friction.pose_stiffness(0, force, stiffness, POSES)
    other, wrench = along(POINTS.shape, 1.0), along((6,), 1e-2)

    def value(s: float) -> float:
        points, poses = POINTS + s * move, POSES + s * turn
        found = friction.force(points, poses)
        pull = friction.pose_force(0, found, poses)
        return float((other * found.sum(axis=0)).sum() + wrench @ pull)

    by_points = np.einsum("nij,nj->ni", stiffness.sum(axis=0), move) + mixed @ turn[0]
    by_pose = np.einsum("nia,ni->a", mixed, move) + twice @ turn[0]
    check(value, float((other * by_points).sum() + wrench @ by_pose))


def test_backward_through_force_and_anchors(friction: SlidingFriction) -> None:
    anchors = friction.sliding.anchors
    move = along(POINTS.shape, 1e-5)
    pushed, shifted = along(NORMALS.shape, 0.05) * (NORMALS != 0), along(anchors.shape, 1e-5)
    adjoint, slopes = along(anchors.shape, 1.0), along(anchors.shape, 1.0)

    def at(s: float) -> SlidingFriction:
        friction.begin(Sliding(anchors + s * shifted))
        friction.lag(NORMALS + s * pushed, POINTS, POSES)
        return friction

    by_normal, by_anchor = friction.force_backward(POINTS, POSES, adjoint)
    slope = float((by_normal * pushed).sum() + (by_anchor * shifted).sum())
    check(lambda s: float((at(s).force(POINTS, POSES) * adjoint).sum()), slope)
    at(0.0)
    by_point, by_normal, by_anchor = friction.end_backward(POINTS, POSES, slopes)
    slope = float((by_point * move).sum() + (by_normal * pushed).sum())
    slope += float((by_anchor * shifted).sum())
    check(lambda s: float((at(s).end(POINTS + s * move, POSES).anchors * slopes).sum()), slope)


def test_a_step_ends_at_the_elastic_slip(friction: SlidingFriction) -> None:
    force = friction.force(POINTS, POSES)
    friction.begin(friction.end(POINTS, POSES))
    friction.lag(NORMALS, POINTS, POSES)
    assert friction.force(POINTS, POSES) == pytest.approx(force, abs=1e-9 * np.abs(force).max())
    again = friction.end(POINTS, POSES).anchors
    assert again == pytest.approx(friction.sliding.anchors, abs=1e-12)
    free = ~NORMALS[0].any(axis=1)
    assert again[0, free] == pytest.approx(POINTS[free], abs=0)


def test_friction_turns_nothing_together(friction: SlidingFriction) -> None:
    """On skin and body it acts along one line, however far the anchor lies off the surface."""
    poses = POSES * [[1, 1, 1, 0, 0, 0]]
    anchors = friction.at_rest(POINTS, poses).anchors
    anchors[1] += SLIP * POINTS / 1e-2 + 5e-3 * NORMALS[1]
    friction.begin(Sliding(anchors))
    friction.lag(NORMALS, POINTS, poses)
    force = friction.force(POINTS, poses)
    wrench = friction.pose_force(0, force, poses)
    centre = rigid_box("box", (0.02, 0.03, 0.01)).centre + poses[0, :3]
    assert np.abs(force[1]).max() > 0.1
    assert wrench[:3] == pytest.approx(-force[1].sum(axis=0))
    assert wrench[3:] == pytest.approx(-np.cross(POINTS - centre, force[1]).sum(axis=0))
