"""Printability of a known scene, of fields, and of large patterns."""

import numpy as np
import pytest
import shapely
from helpers.prints import flawed_tube, regions_of
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.making.print.contours import printed_regions
from toros_fem.making.print.printability import (
    PrintLimits,
    printability,
    printed_cells,
    printed_fractions,
)
from toros_fem.meshes import cylinder


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
