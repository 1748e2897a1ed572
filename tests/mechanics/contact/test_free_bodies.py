"""Unknowns of free bodies: their vertices, and the chain rule through them."""

from dataclasses import replace

import numpy as np
import pytest
from kit.slopes import slope

from toros_fem.mechanics.contact.bodies import FreeBodies
from toros_fem.mechanics.contact.solids import rigid_box, rigid_sphere

THICKNESS = 4e-4


@pytest.fixture(scope="module")
def bodies() -> FreeBodies:
    """A free sphere, a held box and a free box."""
    ball = rigid_sphere("ball", 0.02, (0.1, 0.0, 0.0), edge_length=0.02)
    table = rigid_box("table", (0.1, 0.1, 0.02), edge_length=0.1)
    crate = rigid_box("crate", (0.03, 0.02, 0.01), (0.0, 0.0, 0.5), edge_length=0.02)
    solids = [replace(ball, free=True), table, replace(crate, free=True)]
    return FreeBodies(solids, THICKNESS)


def some_poses() -> np.ndarray:
    return 0.3 * np.random.default_rng(3).standard_normal((3, 6))


def unknowns_of(bodies: FreeBodies, poses: np.ndarray) -> np.ndarray:
    return np.asarray(poses[bodies.free] / bodies.scale)


def test_poses_and_unknowns(bodies: FreeBodies) -> None:
    held = some_poses()
    unknowns = unknowns_of(bodies, held)
    assert (bodies.count, list(bodies.free), unknowns.shape) == (2, [0, 2], (2, 6))
    assert bodies.poses(unknowns, held) == pytest.approx(held, abs=1e-15)
    # The arm of a rotation is the radius: the unknown is the way of the farthest vertex.
    reach = np.linalg.norm([0.015, 0.01, 0.005])
    assert unknowns[1] == pytest.approx(held[2] * np.repeat([1, reach], 3), rel=1e-12)


def test_rotations_beyond_half_a_turn_are_replaced(bodies: FreeBodies) -> None:
    held = some_poses()
    held[0, 3:] = [0.0, 0.0, 6.0]
    unknowns = unknowns_of(bodies, held)
    turned = bodies.shortest(unknowns)
    assert np.array_equal(turned[1], unknowns[1])
    found = bodies.poses(turned, held)
    assert found[0, 3:] == pytest.approx(np.array([0.0, 0.0, 6.0 - 2 * np.pi]), abs=1e-14)
    assert bodies.vertices(found) == pytest.approx(bodies.vertices(held), abs=1e-15)


def test_vertices_lie_half_a_thickness_inside(bodies: FreeBodies) -> None:
    poses = np.zeros((3, 6))
    poses[1, 2] = 7.0
    places = bodies.vertices(poses)
    assert bodies.triangles.max() == len(places) - 1
    table = places[np.abs(places[:, 2] - 7.0) < 0.1]
    assert np.ptp(table, axis=0) == pytest.approx(np.array([0.1, 0.1, 0.02]) - THICKNESS)


def test_taylor(bodies: FreeBodies) -> None:
    """Of a potential that is not quadratic: gradient and second derivative by the chain rule."""
    rng = np.random.default_rng(5)
    held = some_poses()
    start = unknowns_of(bodies, held)
    change = rng.standard_normal(start.shape) * 0.01
    pull = rng.standard_normal((len(bodies.vertices(held)), 3))

    def potential(step: float) -> float:
        places = bodies.vertices(bodies.poses(start + step * change, held))
        return float(((pull * places).sum(axis=1) ** 3).sum())

    def gradient(step: float) -> np.ndarray:
        poses = bodies.poses(start + step * change, held)
        along = (pull * bodies.vertices(poses)).sum(axis=1)
        forces = 3 * along[:, None] ** 2 * pull
        return np.asarray(bodies.jacobian(poses).T @ forces.ravel())

    rise = slope(lambda h: potential(1e-3 * h)) / 1e-3
    assert gradient(0) @ change.ravel() == pytest.approx(rise, rel=1e-8)

    along = (pull * bodies.vertices(held)).sum(axis=1)
    arm = bodies.jacobian(held) @ change.ravel()
    second = (6 * along * (pull * arm.reshape(-1, 3)).sum(axis=1))[:, None] * pull
    by_motion = bodies.jacobian(held).T @ second.ravel()
    curvature = bodies.curvature(held, 3 * along[:, None] ** 2 * pull)
    expected = by_motion + np.einsum("kij,kj->ki", curvature, change).ravel()
    h = 1e-4
    assert (gradient(h) - gradient(-h)) / (2 * h) == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_a_contact_without_free_bodies() -> None:
    table = rigid_box("table", (0.1, 0.1, 0.02), edge_length=0.1)
    bodies = FreeBodies([table], THICKNESS)
    poses = np.zeros((1, 6))
    assert bodies.count == 0
    assert bodies.jacobian(poses).shape == (24, 0)
    assert np.array_equal(bodies.poses(np.zeros((0, 6)), poses), poses)
    none = FreeBodies([], THICKNESS)
    assert none.vertices(np.zeros((0, 6))).shape == none.triangles.shape == (0, 3)
