"""Starts of contact: the closest place, and where surfaces cross."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.contact.opening import skin_mesh
from toros_fem.contact.settings import ContactSizes, Ground
from toros_fem.contact.start_check import check_start
from toros_fem.meshes import Pattern, rectangle
from toros_fem.meshes.pattern import Panel

pytestmark = pytest.mark.one_rank

ipctk = pytest.importorskip("ipctk")

SIZES = ContactSizes(5e-4, 1.25e-4, 1e5, 1e-4)


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
    mesh, ground = skin_mesh(pattern, SIZES), Ground((0.0, 0.0, -5e-4))
    positions = pattern.points.copy()
    assert check_start(mesh, positions, SIZES.thickness, grounds=[ground]).admissible
    positions[3, 2] = height - 5e-4
    found = check_start(mesh, positions, SIZES.thickness, grounds=[ground])
    assert found.vertices == (3,)
    assert found.distance == pytest.approx(height)
    assert "'low' and the ground" in found.sentence(pattern, positions)
    others = np.delete(np.arange(len(positions)), 3)
    found = check_start(mesh, positions, 1e-6, grounds=[ground], grounded=others)
    assert not found.ground
