"""Printability of a tile in the endless sheet."""

import numpy as np
import pytest
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.fabrication.printability import PrintLimits, printed_cells
from toros_fem.meshes import Tile, tile
from toros_fem.tiles.printability import (
    TilePrintability,
    island_areas,
    repeated,
    tile_printability,
)


def measured(patch: Tile, region: BaseGeometry) -> TilePrintability:
    """Return the printability of a region with limits of 0.6 mm."""
    return tile_printability(patch, region, printed_cells(patch.pattern, [region]), PrintLimits())


def test_repeated_regions_are_joined(comm: MPI.Comm) -> None:
    patch = tile(comm, (0.02, 0.01), 2e-3)
    band = shapely.box(0.0, 0.004, 0.02, 0.006)
    region = repeated(band, patch, 3, 2)
    assert region.area == pytest.approx(6 * band.area, rel=1e-6)
    assert len(shapely.get_parts(region)) == 2
    assert region.bounds == pytest.approx((0.0, 0.004, 0.06, 0.016))


def test_widths_across_the_border(comm: MPI.Comm) -> None:
    """A line on the border is as wide as its halves together; a gap likewise."""
    patch = tile(comm, 0.01, 0.1e-3)
    sides = [shapely.box(0, y, 0.01, y + h) for y, h in ((0, 0.2e-3), (9.7e-3, 0.3e-3))]
    line = shapely.union_all(sides)
    found = measured(patch, line)
    assert found.smallest_width is not None
    assert found.smallest_width.width == pytest.approx(0.5e-3, abs=2e-6)
    assert found.smallest_gap is not None
    assert found.smallest_gap.width == pytest.approx(9.5e-3, abs=2e-6)
    assert found.narrow_lines
    assert not found.narrow_gaps
    assert not found.clean
    inverse = measured(patch, shapely.box(0, 0, 0.01, 0.01).difference(line))
    assert inverse.smallest_gap is not None
    assert inverse.smallest_gap.width == pytest.approx(0.5e-3, abs=2e-6)
    assert inverse.narrow_gaps
    assert not inverse.narrow_lines
    # A single tile cuts the bar's ends to tips; in the endless sheet it has none.
    bar = shapely.LineString([(-0.01, -0.01), (0.02, 0.02)]).buffer(0.7e-3)
    copies = [translate(bar, *shift) for shift in ((0, 0), (0.01, 0), (0, 0.01))]
    box = shapely.box(0, 0, 0.01, 0.01)
    diagonal = measured(patch, shapely.intersection(shapely.union_all(copies), box))
    assert diagonal.clean
    assert diagonal.smallest_width is not None
    assert diagonal.smallest_width.width == pytest.approx(1.4e-3, abs=2e-6)
    assert diagonal.summary() == {
        "islands": 0, "island_areas_mm2": [], "narrow_places": 0, "tight_places": 0,
        "smallest_width_mm": 1e3 * diagonal.smallest_width.width,
        "smallest_gap_mm": pytest.approx(10 / np.sqrt(2) - 1.4, abs=2e-3),
    }  # fmt: skip


def test_an_island_is_a_flaw(comm: MPI.Comm) -> None:
    patch = tile(comm, 0.01, 0.25e-3)
    band = shapely.box(0, 0.001, 0.01, 0.003)
    assert measured(patch, band).clean
    spotted = measured(patch, band | shapely.Point(0.005, 0.0065).buffer(0.001))
    assert not spotted.clean
    assert spotted.summary()["islands"] == 1
    assert spotted.summary()["island_areas_mm2"] == pytest.approx([np.pi], rel=0.05)
    nothing = measured(patch, shapely.Polygon())
    assert nothing.summary()["smallest_width_mm"] is None


def test_islands(comm: MPI.Comm) -> None:
    """A line through the border is connected; a spot is an island, also across the border."""
    patch = tile(comm, 0.01, 1e-3)
    x, y = 1e3 * patch.pattern.centroids.T
    line = np.abs(y - 5) < 1
    spot = np.hypot(x - 5, y - 9) < 0.9
    corner = np.hypot((x + 5) % 10 - 5, (y + 5) % 10 - 5) < 2
    assert len(island_areas(patch, line)) == 0
    assert len(island_areas(patch, np.abs((x + y) % 10 - 5) < 1)) == 0
    areas = patch.pattern.areas
    assert island_areas(patch, line | spot) == pytest.approx([areas[spot].sum()])
    assert island_areas(patch, corner) == pytest.approx([areas[corner].sum()])
    assert island_areas(patch, corner | line | spot) == pytest.approx(
        [areas[corner].sum(), areas[spot].sum()]
    )
    assert len(island_areas(patch, np.ones(len(x), dtype=bool))) == 0
    assert len(island_areas(patch, np.zeros(len(x), dtype=bool))) == 0
