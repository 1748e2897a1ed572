"""Printability of a known scene, of fields, and of large patterns."""

import numpy as np
import pytest
import shapely
from helpers.prints import flawed_tube, regions_of
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.cleaning import Panels, clean
from toros_fem.making.contours import printed_regions
from toros_fem.making.printability import (
    PrintLimits,
    find_holes,
    find_pieces,
    printability,
    printed_cells,
    printed_fractions,
)
from toros_fem.meshes import Pattern, cylinder


def test_pieces_across_seams(alone: MPI.Comm) -> None:
    """A body that runs out at the tube's seam, its other half, and a spot that meets nothing."""
    pattern = cylinder(alone, 0.04, 0.02, 2e-3, caps=None)
    width = np.ptp(pattern.flat_points[:, 0])
    shapes = {
        "body": box(0.02, 0.02, width, 0.03),
        "other half": box(0, 0.029, 0.01, 0.035),
        "spot at the seam": box(width - 5e-3, 5e-3, width, 10e-3),
        "spot across": box(0, 11e-3, 5e-3, 16e-3),
        "spot": box(0.02, 5e-3, 0.025, 10e-3),
    }
    (outline,) = (pattern.outline(0),)
    region = shapely.MultiPolygon(list(shapes.values())) & outline
    pieces = find_pieces(pattern, [region])
    assert [piece.main for piece in pieces] == [True] + 4 * [False]
    met = {name: piece.attached for name, shape in shapes.items()
           for piece in pieces if piece.polygon.intersects(shape.buffer(-1e-3))}  # fmt: skip
    assert met == {"body": True, "other half": True, "spot at the seam": False,
                   "spot across": False, "spot": False}  # fmt: skip
    summary = printability(pattern, [region]).summary()
    assert (summary["pieces"], summary["islands"], summary["islands_attached_by_seam"]) == (5, 3, 1)
    # The other half meets the body along 1 mm.
    for contact, attached in ((0.9e-3, 2), (1.1e-3, 1)):
        assert sum(p.attached for p in find_pieces(pattern, [region], contact)) == attached


def test_images_of_the_main_body_are_main_bodies() -> None:
    """Four legs of a symmetric print, and a spot in the middle: no leg is an island."""
    pattern = square(n=8)
    low, high = pattern.flat_points.min(axis=0), pattern.flat_points.max(axis=0)
    size = (high - low) / 10
    corners = [low + size * [x, y] for x in (0, 7) for y in (0, 7)]
    legs = [box(*at, *(at + 3 * size * [1, 1 + 1e-6 * k])) for k, at in enumerate(corners)]
    spot = box(*(low + 4.5 * size), *(low + 5.5 * size))
    pieces = find_pieces(pattern, [shapely.MultiPolygon([*legs, spot])])
    assert [piece.main for piece in pieces] == [True] * 4 + [False]
    assert [piece.attached for piece in pieces] == [True] * 4 + [False]


def test_caps_hold_what_touches_them(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 2e-3)
    wall, tip = pattern.panel_index("wall"), pattern.panel_index("tip")
    shapes = [box(0.02, 0.01, 0.04, 0.02), box(0.02, 0.03, 0.03, 0.05)]
    regions: list[BaseGeometry] = [Polygon()] * 3
    regions[wall] = shapely.MultiPolygon(shapes) & pattern.outline(wall)
    assert [p.attached for p in find_pieces(pattern, regions)] == [True, False]
    regions[tip] = pattern.outline(tip)
    pieces = find_pieces(pattern, regions)
    assert all(piece.attached for piece in pieces)
    assert sum(piece.main for piece in pieces) == 2


def test_cut_outs_are_no_holes() -> None:
    whole = square(n=8)
    centre = np.all(np.abs(whole.centroids - 0.01) < 0.005, axis=1)
    used, corners = np.unique(whole.flat_triangles[~centre], return_inverse=True)
    pattern = Pattern(
        flat_points=whole.flat_points[used],
        flat_triangles=corners.reshape(-1, 3),
        panel=whole.panel[~centre],
        sewn=np.arange(len(used)),
        points=whole.points[used],
        panel_names=whole.panel_names,
    )
    region = pattern.outline(0)
    assert len(region.interiors) == 1
    assert not find_holes(pattern, [region])
    assert clean(Panels(pattern), [region], island_area=1.0).regions[0].equals(region)


def test_border_without_the_cut() -> None:
    """Half of a sheet printed: its border is the line across, not the panel's own."""
    pattern = square(size=0.02)
    half = shapely.box(0, 0, 0.012, 0.02)
    assert printability(pattern, [half]).summary()["border_mm"] == pytest.approx(20)
    assert printability(pattern, [shapely.box(0, 0, 0.02, 0.02)]).border_length == 0


def test_printed_fractions_keep_the_area() -> None:
    """A disc over some triangles, with a hole inside one of them."""
    pattern = square(size=0.02)
    hole = shapely.Point(pattern.centroids[0]).buffer(1e-4)
    region = shapely.Point(pattern.centroids[0]).buffer(7.3e-3) & pattern.outline(0)
    found = printed_fractions(pattern, [region - hole])
    assert found @ pattern.areas == pytest.approx(region.area - hole.area, rel=1e-9)
    assert found[0] == pytest.approx(1 - hole.area / pattern.areas[0], rel=1e-9)
    assert set(found.round(12)) > {0.0, 1.0}


def test_nothing_printed() -> None:
    pattern = square()
    found = printability(pattern, regions_of(pattern, lambda points: 0 * points[:, 0]))
    summary = found.summary()
    assert summary["pieces"] == summary["islands"] == summary["holes"] == 0
    assert summary["smallest_width_mm"] is None
    assert summary["smallest_gap_mm"] is None
    assert summary["border_mm"] == 0
    assert not printed_cells(pattern, regions_of(pattern, lambda p: 0 * p[:, 0])).any()


def test_printed_cells(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 3e-3)
    values = np.random.default_rng(4).uniform(0, 1, len(pattern.panel))
    at_points = np.random.default_rng(5).uniform(0, 1, len(pattern.flat_points))
    regions = printed_regions(pattern, at_points, values, 0.5)
    assert np.array_equal(printed_cells(pattern, regions), values > 0.5)


def test_limits_must_be_positive() -> None:
    assert PrintLimits(width=0.8e-3, gap=0.4e-3).resolution == pytest.approx(0.02e-3)


def test_lines_of_a_field(alone: MPI.Comm) -> None:
    """A field linear across slanted lines keeps their widths and gaps, cut by the seam or not."""
    pattern = cylinder(alone, 0.08, 0.02, 1.5e-3, caps=None)
    across = 0.04 / np.ptp(pattern.flat_points[:, 0])  # lines meet at the seam
    along = np.array([across, np.sqrt(1 - across**2)])

    def density(points: np.ndarray) -> np.ndarray:
        return 0.5 + 40 * (0.002 - np.abs((points @ along) % 0.01 - 0.005))

    found = printability(pattern, regions_of(pattern, density))
    # At the ridges of the field the mesh rounds; the contours lie in its linear parts.
    assert found.lines.smallest.width == pytest.approx(4e-3, rel=1e-3)
    assert found.gaps.smallest.width == pytest.approx(6e-3, rel=1e-3)


def test_tube_with_flaws(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 2.85e-3)
    regions, limits = flawed_tube(pattern, 40), PrintLimits()
    found = printability(pattern, regions, limits)
    summary = found.summary()
    assert summary["pieces"] == 4
    assert summary["islands"] == summary["islands_attached_by_seam"] + 1 == 1
    assert summary["island_areas_mm2"] == pytest.approx([np.pi * 1.2**2], rel=1e-3)
    assert summary["smallest_width_mm"] == pytest.approx(0.4, abs=2e-3)
    assert summary["smallest_width_panel"] == pattern.panel_index("wall")
    assert np.mean(summary["smallest_width_ends_mm"], axis=0) == pytest.approx([18, 9.5], abs=0.1)
    assert summary["smallest_gap_mm"] == pytest.approx(0.45, abs=2e-3)
    assert summary["narrow_places"] == summary["tight_places"] == 1
    assert summary["holes"] == 1
    assert summary["smallest_hole_mm2"] == pytest.approx(np.pi * 0.35**2, rel=1e-3)
