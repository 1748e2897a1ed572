"""Holding force: where it counts, and where it vanishes."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.meshes import Skin, sew

pytest.importorskip("ipctk")


UP = [0.3, 0.0, 1.0]


FORCE = 1000.0  # N


@pytest.fixture(scope="module")
def skin(alone: MPI.Comm) -> Skin:
    """A flat sheet at z = 0."""
    return sew(alone, square(n=5))


def objective(skin: Skin, height: float, asked: float = FORCE) -> HoldingObjective:
    """A ball that stands above the middle of the sheet, at a height of faces in m."""
    middle = skin.pattern.points.mean(axis=0)
    thickness, radius = 5e-4, 0.3 * skin.pattern.size
    ball = rigid_sphere("ball", radius, middle + [0, 0, radius + thickness / 2 + height])
    contact = Contact(
        bodies=[ball], self_contact=False, thickness=thickness, distance=0.1 * skin.pattern.size
    )
    fixed = np.zeros(skin.pattern.points.shape, dtype=bool)
    return HoldingObjective(skin, contact, contact.sizes(Composite()), fixed, UP, asked, 2.0)


def test_what_is_missing_is_squared(skin: Skin) -> None:
    made = objective(skin, 0.02 * skin.pattern.size)
    x = skin.pattern.points[skin.owned_vertices]
    force = made.force(x)
    assert 0 < force < FORCE
    assert made.forward(x) == pytest.approx((1 - force / FORCE) ** 2)


def test_a_body_far_away_is_not_held(skin: Skin) -> None:
    made = objective(skin, 0.2 * skin.pattern.size)
    x = skin.pattern.points[skin.owned_vertices]
    assert made.force(x) == 0
    assert made.forward(x) == 1.0
    assert not made.backward(x).any()


def test_no_more_than_what_is_asked_for_counts(skin: Skin) -> None:
    made = objective(skin, 0.02 * skin.pattern.size, asked=1.0)
    x = skin.pattern.points[skin.owned_vertices]
    assert made.force(x) > 1.0
    assert made.forward(x) == 0
    assert not made.backward(x).any()
