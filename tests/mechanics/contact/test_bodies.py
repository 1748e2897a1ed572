"""Rigid bodies: their centre and volume, and their surface moved inwards."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.mechanics.contact.bodies import RigidBody, rotation
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_sphere
from toros_fem.meshes.surface import volume
from toros_fem.meshes.triangles import normals

DEPTH = 2e-4


def bodies() -> list[RigidBody]:
    return [
        rigid_sphere("ball", 0.02, (0.1, 0.2, 0.3)),
        rigid_box("box", (0.03, 0.02, 0.01), (0.1, 0.2, 0.3)),
        rigid_cylinder("rod", 0.01, 0.05, (1.0, 1.0, 1.0), (0.1, 0.2, 0.3)),
    ]


def unit_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    normal = normals(points, triangles)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def test_a_body_that_faces_inwards_is_turned() -> None:
    box = rigid_box("crate", (1.0, 1.0, 1.0), edge_length=1.0)
    turned = replace(box, triangles=box.triangles[:, ::-1])
    assert np.array_equal(turned.triangles, box.triangles)
    assert turned.volume == pytest.approx(1.0, rel=1e-14)


def test_centre_volume_and_radius() -> None:
    """Of a tetrahedron: the mean of its corners, a sixth of the determinant."""
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]]) + 7
    body = RigidBody("wedge", corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    assert body.volume == pytest.approx(1.0, rel=1e-13)
    assert body.centre == pytest.approx(corners.mean(axis=0), rel=1e-14)
    assert body.radius == pytest.approx(np.linalg.norm([2.25, 0.5, 0.25]), rel=1e-13)


def test_moved() -> None:
    box = replace(rigid_box("crate", (0.3, 0.2, 0.1), (1.0, 0.0, 0.0)), free=True)
    pose = np.array([0.0, 0.0, 1.0, 0.2, 0.5, -0.4])
    moved = box.moved(pose)
    assert moved.centre == pytest.approx(np.array([1.0, 0.0, 1.0]), abs=1e-15)
    assert (moved.name, moved.free) == ("crate", True)
    expected = (box.points - box.centre) @ rotation(pose[3:]).T
    assert moved.points - moved.centre == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("body", bodies(), ids=lambda body: body.name)
def test_all_faces_move_by_the_depth(body: RigidBody) -> None:
    """To rounding where three planes meet; a sphere's facets to 1e-3 of the depth."""
    exact = body.name != "ball"
    inner = body.inset(DEPTH)
    normal = unit_normals(body.points, body.triangles)
    moved = np.einsum("tci,ti->tc", (body.points - inner)[body.triangles], normal)
    assert moved == pytest.approx(np.full_like(moved, DEPTH), rel=1e-11 if exact else 1e-3)
    turned = unit_normals(inner, body.triangles) - normal
    assert np.abs(turned).max() < (1e-12 if exact else 1e-4)
    assert np.array_equal(body.inset(0.0), body.points)


def test_inset_solids_are_smaller_solids() -> None:
    ball, box, rod = bodies()
    found = [volume(body.inset(DEPTH), body.triangles) for body in (ball, box, rod)]
    assert found[0] == pytest.approx(4 / 3 * np.pi * (0.02 - DEPTH) ** 3, rel=2e-4)
    assert found[1] == pytest.approx(np.prod(np.array([0.03, 0.02, 0.01]) - 2 * DEPTH), rel=1e-12)
    # A prism with a polygon's ends: its radius shrinks by the depth at the middles of facets.
    assert found[2] == pytest.approx(np.pi * (0.01 - DEPTH) ** 2 * (0.05 - 2 * DEPTH), rel=1e-3)


def test_inset_of_a_mesh_with_hollows() -> None:
    """A torus: a thinner one about the same ring; the hollow side moves as well."""
    torus = surfaces.torus()
    body = RigidBody("ring", torus.points, torus.triangles)
    depth = 0.02 * float(np.ptp(torus.points[:, 2]))
    inner = body.inset(depth)
    normal = unit_normals(body.points, body.triangles)
    moved = np.einsum("tci,ti->tc", (body.points - inner)[body.triangles], normal)
    assert moved == pytest.approx(np.full_like(moved, depth), rel=0.05)


def test_a_card_is_moved_in_up_to_its_middle() -> None:
    card = rigid_box("card", (0.05, 0.05, 3e-4), edge_length=0.01)
    inner = card.inset(0.7 * DEPTH)  # 0.14 of 0.15 mm
    assert np.ptp(inner, axis=0) == pytest.approx(np.array([0.04972, 0.04972, 2e-5]), rel=1e-9)
