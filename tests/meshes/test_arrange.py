"""Panels beside each other: upright, packed in rows, at their own places where these are free."""

import numpy as np
import pytest
import shapely
from helpers import surfaces
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder, rectangle, two_panels, unwrap
from toros_fem.meshes.arrange import Place, arranged, panel_offsets, panel_places

SQUARE = 0.02 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def boxes(pattern: Pattern, offsets: list[np.ndarray]) -> np.ndarray:
    """Corners of each panel's bounding box on the drawing, (p, 2 corners, 2)."""
    placed = [
        pattern.corners[pattern.panel == k].reshape(-1, 2) + offset
        for k, offset in enumerate(offsets)
    ]
    return np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])


def least_gap(found: np.ndarray) -> float:
    """Smallest gap between two boxes; negative where two overlap."""
    low, high = found[:, 0], found[:, 1]
    gaps = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    return float(gaps[np.triu_indices(len(low), 1)].min())


def test_arranged_panels_are_upright_and_apart() -> None:
    """Rectangles of several sizes and directions: congruent, long sides along y, no overlap."""
    rng = np.random.default_rng(0)
    panels = []
    for size in rng.uniform(0.01, 0.05, (7, 2)):
        angle = rng.uniform(0, 2 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        panels.append(SQUARE / 0.02 * size @ np.array([[c, s], [-s, c]]) + rng.normal(size=2))
    placed = arranged(panels)
    for before, after in zip(panels, placed, strict=True):
        one, two = (np.linalg.norm(p[:, None] - p, axis=2) for p in (before, after))
        assert two == pytest.approx(one, abs=1e-15)
        width, height = np.ptp(after, axis=0)
        assert width * height == pytest.approx(one[0, 1] * one[1, 2], rel=1e-12)
        assert width <= height
    found = np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])
    side = np.sqrt(np.prod(found[:, 1] - found[:, 0], axis=1).sum())
    assert least_gap(found) == pytest.approx(0.04 * side)
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)


@pytest.mark.parametrize("kind", ["tube", "two panels", "touching"])
def test_panels_that_overlap_or_touch_are_packed(alone: MPI.Comm, kind: str) -> None:
    if kind == "tube":
        pattern = cylinder(alone, 0.06, 0.02, 5e-3, mesh="structured")
    else:  # the bottom is (x, −y): it touches the top along y = 0 if the outline begins there
        pattern = two_panels(alone, SQUARE - (0 if kind == "touching" else 0.01), 5e-3)
    found = boxes(pattern, panel_offsets(pattern, 7e-3))
    assert least_gap(found) == pytest.approx(7e-3)
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)


def test_panels_that_are_apart_keep_their_places(alone: MPI.Comm) -> None:
    pattern = unwrap(alone, surfaces.welded_box(2)).pattern
    assert len(pattern.panel_names) == 6
    offsets = np.array(panel_offsets(pattern, 0.1))
    assert np.ptp(offsets, axis=0) == pytest.approx([0, 0], abs=0)
    found = boxes(pattern, list(offsets))
    assert least_gap(found) > 1e-3
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)
    places = panel_places(pattern, 0.1, (1, 1))
    assert np.ptp([place.offset for place in places], axis=0) == pytest.approx([0, 0], abs=0)
    one = rectangle(alone, 0.02, 0.01, 5e-3)
    assert np.array(panel_offsets(one, 0.1)) == pytest.approx(
        -one.flat_points.min(axis=0)[None], abs=0
    )


@pytest.mark.parametrize(
    ("page", "turned", "size"),
    # The wall lies, with both ends above each other beside it; or it stands, with both below it.
    [((13, 6.5), True, (0.15 + 0.015 + 0.02, 0.0628)), ((4, 9), False, (0.0628, 0.185))],
)
def test_slim_panels_fill_a_page(
    alone: MPI.Comm, page: tuple[float, float], turned: bool, size: tuple[float, float]
) -> None:
    pattern = cylinder(alone, 0.15, 0.02, 5e-3, mesh="structured")
    places = panel_places(pattern, 0.015, page)
    placed = [
        place.points(pattern.corners[pattern.panel == k].reshape(-1, 2))
        for k, place in enumerate(places)
    ]
    found = np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])
    assert [place.turned for place in places] == [turned] * 3
    assert least_gap(found) >= 0.015 - 1e-12
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-12)
    assert found.max(axis=(0, 1)) == pytest.approx(size, rel=0.02)


def test_a_place_turns_points_and_regions_alike() -> None:
    place = Place(True, np.array([0.1, 0.2]))
    square = shapely.box(0, 0, 0.02, 0.05)
    corners = shapely.get_coordinates(square)
    assert shapely.get_coordinates(place.region(square)) == pytest.approx(place.points(corners))
    assert place.region(square).area == pytest.approx(square.area)
    assert place.vectors(np.array([0.0, 1.0])) == pytest.approx([1.0, 0.0]), "clockwise"
