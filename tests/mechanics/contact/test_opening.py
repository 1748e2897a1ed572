"""Starts of contact: flat skins opened without intersection; the closest place; crossings."""

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.mechanics.contact.barrier import HalfSpacePairs
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.layers import ContactSizes, check_start, opened, skin_mesh
from toros_fem.meshes import Pattern, cylinder, finger, rectangle, two_panels, walker
from toros_fem.meshes.pattern import Panel
from toros_fem.meshes.sheets import circle

ipctk = pytest.importorskip("ipctk")

SIZES = ContactSizes(5e-4, 2.5e-4, 1e5, 1e-4)
COMM = MPI.COMM_SELF
SQUARE = np.array([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])

SKINS: dict[str, Callable[[float], Pattern]] = {
    "finger": lambda edge: finger(COMM, edge),
    "half a finger": lambda edge: finger(COMM, edge, planes=(1,)),
    "walker": lambda edge: walker(COMM, edge),
    "a quarter of a walker": lambda edge: walker(COMM, edge, planes=(0, 1)),
    "discs": lambda edge: two_panels(COMM, circle(40, 0.015), edge),
    "pillow": lambda edge: two_panels(COMM, SQUARE, edge),
    "wedge": lambda edge: two_panels(COMM, np.array([[0, 0], [0.04, 0], [0.04, 0.008]]), edge),
    "strip": lambda edge: two_panels(COMM, SQUARE * [1, 0.1], edge),
}


def largest_stretch(pattern: Pattern, positions: np.ndarray) -> float:
    def sides(corners: np.ndarray) -> np.ndarray:
        return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)

    gradient = sides(positions[pattern.triangles]) @ np.linalg.inv(sides(pattern.corners))
    return float(np.linalg.svd(gradient, compute_uv=False).max())


def crosses(pattern: Pattern, positions: np.ndarray) -> bool:
    """Whether any edge crosses a triangle, neighbours in the sheet included."""
    mesh = skin_mesh(pattern, SIZES)
    mesh.can_collide = ipctk.CollisionFilter()
    return bool(ipctk.has_intersections(mesh, np.asfortranarray(positions)))


CASES = [(name, edge) for name in SKINS for edge in (3.2e-3, 1.8e-3)]
CASES += [("half a finger", 1.2e-3), ("discs", 8e-4), ("pillow", 1.2e-3), ("wedge", 7e-4)]
CASES += [("strip", 6e-4)]


@pytest.mark.parametrize(("name", "edge"), CASES)
def test_flat_skins_are_opened(name: str, edge: float) -> None:
    """Seams and symmetry planes stay where they are; nothing moves by more than 2 mm."""
    pattern = SKINS[name](edge)
    positions = opened(pattern, SIZES)
    found = check_start(skin_mesh(pattern, SIZES), positions, SIZES.thickness)
    assert found.admissible
    assert not crosses(pattern, positions)
    assert largest_stretch(pattern, positions) < 1.3
    assert np.abs(positions - pattern.points).max() < 2e-3
    inner = pattern.edges.ends[pattern.edges.inner]
    ends = inner[np.any(pattern.flat_sides[:, 0] != pattern.flat_sides[:, 1], axis=1)]
    np.testing.assert_array_equal(positions[ends], pattern.points[ends])
    for axis in (0, 1):
        across = np.abs(pattern.points[pattern.free_edges][:, :, axis]).max(axis=1) < 1e-9
        border = np.unique(pattern.free_edges[across])
        np.testing.assert_allclose(positions[border, axis], 0, atol=2e-5)


def test_vertices_stay_exactly_in_symmetry_planes() -> None:
    pattern = walker(COMM, 3.2e-3, planes=(0, 1))
    plane = np.abs(pattern.points) < 1e-9
    plane[:, 2] = False
    positions = opened(pattern, SIZES, plane)
    np.testing.assert_array_equal(positions[plane], pattern.points[plane])
    assert plane.any()
    assert check_start(skin_mesh(pattern, SIZES), positions, 5e-4).admissible


@pytest.mark.parametrize("pattern", [cylinder(COMM, 0.05, 0.02, 2e-3), rectangle(COMM, 1, 1, 0.2)])
def test_skins_whose_layers_are_apart_stay(pattern: Pattern) -> None:
    np.testing.assert_array_equal(opened(pattern, SIZES), pattern.points)


def test_layers_of_other_meshes_are_opened() -> None:
    """The edges of the lower layer cross those of the upper; corner triangles stay flat."""
    flat = rectangle(COMM, 0.05, 0.05, 5e-3).flat_points - 0.025
    triangles = rectangle(COMM, 0.05, 0.05, 5e-3).flat_triangles
    above = np.column_stack([flat, np.zeros(len(flat))])
    panels = [
        Panel("top", flat, triangles, above),
        Panel("bottom", flat, triangles, above * [-1, 1, 1]),
    ]
    pattern = Pattern.from_panels(panels, 1e-6)
    positions = opened(pattern, SIZES)
    assert check_start(skin_mesh(pattern, SIZES), positions, SIZES.thickness).admissible
    assert not crosses(pattern, positions)


def facing_alike() -> Pattern:
    """Two squares that lie in one plane and both face up, so that none is known to be above."""
    sheet = rectangle(COMM, 0.02, 0.02, 5e-3)
    flat, triangles = sheet.flat_points, sheet.flat_triangles
    shifted = sheet.points + [2e-3, 1e-3, 0]
    return Pattern.from_panels(
        [Panel("one", flat, triangles, sheet.points), Panel("two", flat, triangles, shifted)],
        tolerance=1e-6,
    )


def pierced() -> Pattern:
    """A strip that stands in the middle of a triangle of 2 cm, far from its edges."""
    flat, strip = np.array([[0, 0], [0.02, 0], [0, 0.02]]), np.array([[0, 0], [2e-3, 0], [0, 0.03]])
    stands = np.column_stack([5e-3 + strip[:, 0], np.full(3, 5e-3), strip[:, 1] - 0.01])
    lies, one = np.column_stack([flat, np.zeros(3)]), np.array([[0, 1, 2]])
    panels = [Panel("one", flat, one, lies), Panel("two", strip, one, stands)]
    return Pattern.from_panels(panels, tolerance=1e-6)


@pytest.mark.parametrize("pattern", [facing_alike(), pierced()])
def test_what_cannot_be_opened_is_named(pattern: Pattern) -> None:
    with pytest.raises(errors.ParameterError, match=r"cannot be moved apart.* 'one' and 'two'"):
        opened(pattern, SIZES)


def two_sheets() -> Pattern:
    """Two squares that are not sewn, 1 mm apart."""
    sheet = rectangle(MPI.COMM_SELF, 0.02, 0.02, 5e-3)
    flat, triangles = sheet.flat_points, sheet.flat_triangles
    above = sheet.points + [1e-3, 2e-3, 1e-3]
    panels = [Panel("low", flat, triangles, sheet.points), Panel("high", flat, triangles, above)]
    return Pattern.from_panels(panels, tolerance=1e-6)


def test_sheets_that_are_apart_are_admissible() -> None:
    pattern = two_sheets()
    mesh = skin_mesh(pattern, SIZES)
    found = check_start(mesh, pattern.points, SIZES.thickness)
    assert found.admissible
    assert found.distance == np.inf
    found = check_start(mesh, pattern.points, SIZES.thickness, distance=6e-4)
    assert found.admissible
    assert found.distance == pytest.approx(5e-4, rel=1e-6)


@pytest.mark.parametrize("low", [0.0, 2e-4, 4e-4])
def test_the_closest_place_is_found(low: float) -> None:
    pattern = two_sheets()
    positions = pattern.points.copy()
    at = 31
    positions[at, 2] = low
    found = check_start(skin_mesh(pattern, SIZES), positions, SIZES.thickness)
    assert not found.admissible
    assert not found.crossing
    assert at in found.vertices
    assert found.distance == pytest.approx(low - 5e-4, abs=1e-9)
    sentence = found.sentence(pattern, positions)
    assert f"overlap by {1e3 * (5e-4 - low):.4g} mm" in sentence
    assert "'low' and 'high'" in sentence


def test_surfaces_that_cross_are_found() -> None:
    """A long spike through a sheet, whose point is far from it."""
    pattern = two_sheets()
    positions = pattern.points.copy()
    positions[31, 2] = -0.05
    found = check_start(skin_mesh(pattern, SIZES), positions, 1e-6)
    assert found.crossing
    assert not found.admissible
    assert 31 in found.vertices
    assert "surfaces cross" in found.sentence(pattern, positions)


@pytest.mark.parametrize("height", [0.0, -2e-4, -1.0])
def test_vertices_near_or_in_the_ground_are_found(height: float) -> None:
    pattern = two_sheets()
    positions, count = pattern.points.copy(), len(pattern.points)
    ground = Ground((0.0, 0.0, -5e-4 - SIZES.thickness / 2))
    every, others = (
        HalfSpacePairs(ground, kept_out, np.ones(len(kept_out)), SIZES)
        for kept_out in (np.arange(count), np.delete(np.arange(count), 3))
    )
    assert every.check(positions).admissible
    positions[3, 2] = height - 5e-4
    found = every.check(positions)
    assert found.vertices == (3,)
    assert found.distance == pytest.approx(height)
    assert "'low' and the ground" in found.sentence(pattern, positions)
    assert others.check(positions).admissible
