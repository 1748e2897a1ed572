"""Pictures of a gripper that lifts: object, fingers around it, and the files."""

import numpy as np
import pytest

from toros_fem.measures.regions import Body
from toros_fem.meshes.surface import volume
from toros_fem.products.gripper.load import in_room, solid

BALL = Body("sphere", 0.04, (0.03, 0.0, 0.02))


def test_solids_have_the_surface_of_their_body() -> None:
    ball, box = solid(BALL), solid(Body("box", 0.04, (0.03, 0.0, 0.02)))
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 0.02**3, rel=1e-6)
    distance, _ = Body("box", 0.04, (0.03, 0.0, 0.02)).distance(box.points)
    assert np.abs(distance).max() < 1e-9
    r, a = 5e-3, 0.03  # radius of the edges, and the core that they go around
    exact = a**3 + 6 * a**2 * r + 3 * np.pi * a * r**2 + 4 / 3 * np.pi * r**3
    assert box.volume == pytest.approx(exact, rel=0.01)
    for body in (ball, box):
        assert body.centre == pytest.approx([0.03, 0.0, 0.02], abs=1e-5)


def test_fingers_are_shown_from_outside() -> None:
    """Turning a finger into the room must not turn it inside out."""
    ball = solid(BALL)
    for angle in (0.0, 1.0):
        turned = in_room(ball.points, 0.02, angle)
        assert volume(turned, ball.triangles) == pytest.approx(ball.volume)


def test_three_fingers_stand_around_the_object() -> None:
    """A point of the finger at the object's height is as far from its axis at every angle."""
    point = np.array([[0.03, 0.002, 0.001]])
    places = np.concatenate([in_room(point, 0.02, angle) for angle in 2 * np.pi * np.arange(3) / 3])
    assert places.sum(axis=0)[:2] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(places[:, :2], axis=1) == pytest.approx(np.hypot(0.019, 0.002))
    assert places[:, 2] == pytest.approx(-0.03), "the finger hangs down along its own x"
