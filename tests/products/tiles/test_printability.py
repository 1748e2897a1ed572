"""Printability of a tile in the endless sheet."""

import math

import numpy as np
import pytest
import shapely
from mpi4py import MPI
from shapely.affinity import affine_transform, translate
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.cleaning import CleanedRegions, clean
from toros_fem.making.printability import PrintLimits, printed_cells
from toros_fem.meshes import Tile, tile
from toros_fem.products.tiles.printability import (
    RepeatedTile,
    TilePrintability,
    island_areas,
    repeated,
    tile_printability,
)

SIZE = 0.01


def measured(patch: Tile, region: BaseGeometry) -> TilePrintability:
    """Return the printability of a region with limits of 0.6 mm."""
    return tile_printability(patch, region, printed_cells(patch.pattern, [region]), PrintLimits())


def test_repeated_regions_are_joined(alone: MPI.Comm) -> None:
    patch = tile(alone, (0.02, 0.01), 2e-3)
    band = shapely.box(0.0, 0.004, 0.02, 0.006)
    region = repeated(band, patch, 3, 2)
    assert region.area == pytest.approx(6 * band.area, rel=1e-6)
    assert len(shapely.get_parts(region)) == 2
    assert region.bounds == pytest.approx((0.0, 0.004, 0.06, 0.016))


def test_widths_across_the_border(alone: MPI.Comm) -> None:
    """A line on the border is as wide as its halves together; a gap likewise."""
    patch = tile(alone, 0.01, 0.1e-3)
    sides = [shapely.box(0, y, 0.01, y + h) for y, h in ((0, 0.2e-3), (9.7e-3, 0.3e-3))]
    line = shapely.union_all(sides)
    found = measured(patch, line)
    assert found.lines.smallest.width == pytest.approx(0.5e-3, abs=2e-6)
    assert found.gaps.smallest.width == pytest.approx(9.5e-3, abs=2e-6)
    assert found.lines.narrow
    assert not found.gaps.narrow
    assert not found.clean
    inverse = measured(patch, shapely.box(0, 0, 0.01, 0.01).difference(line))
    assert inverse.gaps.smallest.width == pytest.approx(0.5e-3, abs=2e-6)
    assert inverse.gaps.narrow
    assert not inverse.lines.narrow
    # A single tile cuts the bar's ends to tips; in the endless sheet it has none.
    bar = shapely.LineString([(-0.01, -0.01), (0.02, 0.02)]).buffer(0.7e-3)
    copies = [translate(bar, *shift) for shift in ((0, 0), (0.01, 0), (0, 0.01))]
    box = shapely.box(0, 0, 0.01, 0.01)
    diagonal = measured(patch, shapely.intersection(shapely.union_all(copies), box))
    assert diagonal.clean
    assert diagonal.lines.smallest.width == pytest.approx(1.4e-3, abs=2e-6)
    assert diagonal.summary() == {
        "islands": 0, "island_areas_mm2": [], "narrow_places": 0, "tight_places": 0,
        "smallest_width_mm": 1e3 * diagonal.lines.smallest.width,
        "smallest_gap_mm": pytest.approx(10 / np.sqrt(2) - 1.4, abs=2e-3),
    }  # fmt: skip


def test_an_island_is_a_flaw(alone: MPI.Comm) -> None:
    patch = tile(alone, 0.01, 0.25e-3)
    band = shapely.box(0, 0.001, 0.01, 0.003)
    assert measured(patch, band).clean
    spotted = measured(patch, band | shapely.Point(0.005, 0.0065).buffer(0.001))
    assert not spotted.clean
    assert spotted.summary()["islands"] == 1
    assert spotted.summary()["island_areas_mm2"] == pytest.approx([np.pi], rel=0.05)
    nothing = measured(patch, shapely.Polygon())
    assert nothing.summary()["smallest_width_mm"] is None


def test_islands(alone: MPI.Comm) -> None:
    """A line through the border is connected; a spot is an island, also across the border."""
    patch = tile(alone, 0.01, 1e-3)
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


@pytest.fixture(scope="module")
def sheet_tile(alone: MPI.Comm) -> Tile:
    return tile(alone, SIZE, 0.2e-3)


def cleaned(
    patch: Tile, region: BaseGeometry, island_area: float = 1e-6, symmetry: str = "none"
) -> CleanedRegions:
    """The print of a region; checked to keep all limits among its equals."""
    made = clean(RepeatedTile(patch, symmetry), [region], PrintLimits(), island_area)
    (one,) = made.regions
    found = tile_printability(patch, one, printed_cells(patch.pattern, [one]), PrintLimits())
    assert found.clean
    return made


def test_lines_on_the_border_count_with_both_halves(sheet_tile: Tile) -> None:
    """One of 0.8 mm stays, one of 0.4 mm gets the least width, although halves are thinner."""
    for half, width in ((0.4e-3, 0.8e-3), (0.2e-3, 0.609e-3)):
        line = box(0, 0, SIZE, half) | box(0, SIZE - half, SIZE, SIZE)
        made = cleaned(sheet_tile, line)
        assert made.regions[0].area == pytest.approx(width * SIZE, rel=0.01)


def test_gaps_across_the_border(sheet_tile: Tile) -> None:
    plate = box(0, 0.2e-3, SIZE, 8e-3)
    made = cleaned(sheet_tile, plate | box(0, 8.4e-3, SIZE, SIZE))
    heights = sorted(
        p.area / SIZE for p in shapely.get_parts(repeated(made.regions[0], sheet_tile, 1, 3))
    )
    assert made.regions[0].area < plate.area + 1.6e-3 * SIZE
    assert heights[-1] == pytest.approx(8e-3 + 1.4e-3, rel=0.02)


def test_islands_are_removed_or_joined_everywhere(sheet_tile: Tile) -> None:
    line, island = box(0, 1e-3, SIZE, 2e-3), Point(0.01, 6e-3).buffer(1e-3)
    here = (island | Point(0, 6e-3).buffer(1e-3)) & box(0, 0, SIZE, SIZE)
    gone = cleaned(sheet_tile, line | here, island_area=1e-5)
    assert len(gone.dropped) == 1
    assert gone.regions[0].area == pytest.approx(line.area, rel=1e-2)
    joined = cleaned(sheet_tile, line | here)
    assert [len(joined.dropped), len(joined.bridged)] == [0, 1]
    assert joined.regions[0].area == pytest.approx((line | here).area + 1.2e-3 * 3e-3, rel=0.03)


@pytest.mark.parametrize(
    ("side", "place"),
    [
        (8.0, (0.5, 0.0)),
        (9.0, (0.5, 0.6)),
        (9.5, (0.0, 0.6)),
        (10.0, (0.5, 0.0)),
        (11.0, (0.0, 0.0)),
        (12.5, (0.5, 0.6)),
    ],
)
def test_an_island_counts_once_wherever_it_lies(
    alone: MPI.Comm, side: float, place: tuple[float, float]
) -> None:
    """Of a spot on the tile's border each copy is removed, or joined by one line."""
    size = side * 1e-3
    patch = tile(alone, size, size / 20)
    line, (x, y) = box(0, 0.25 * size, size, 0.25 * size + 1e-3), np.multiply(place, size)
    spots = [Point(x + i * size, y + j * size).buffer(0.8e-3) for i in (0, 1) for j in (0, 1)]
    region = shapely.union_all([line, *spots]) & box(0, 0, size, size)
    gone = cleaned(patch, region, island_area=math.inf)
    assert [len(gone.dropped), len(gone.bridged)] == [1, 0]
    assert gone.regions[0].area == pytest.approx(line.area, rel=1e-2)
    joined = cleaned(patch, region, island_area=0.0)
    assert [len(joined.dropped), len(joined.bridged)] == [0, 1]


def test_gaps_between_a_bridge_and_its_image_are_closed(sheet_tile: Tile) -> None:
    """Bridges of 1.2 mm from two teeth on either side of a mirror would leave 0.4 mm."""
    quarter = box(0, 0, 5e-3, 1e-3) | box(3.9e-3, 0, 4.5e-3, 3e-3) | box(3e-3, 4.5e-3, 5e-3, 5e-3)
    half = quarter | affine_transform(quarter, [-1, 0, 0, 1, SIZE, 0])
    region = half | affine_transform(half, [1, 0, 0, -1, 0, SIZE])
    assert cleaned(sheet_tile, region, 0.0, "orthotropic").bridged


def test_smooth_contours_go_on_across_the_border(sheet_tile: Tile) -> None:
    steps = [box(x, 4e-3, x + 0.5e-3, 6e-3 + 0.2e-3 * (k % 2))
             for k, x in enumerate(0.5e-3 * i for i in range(20))]  # fmt: skip
    region = shapely.union_all(steps)
    made = clean(RepeatedTile(sheet_tile, "none"), [region], PrintLimits(), 0.0, 1e-3)
    left, right = (made.regions[0] & box(x, 0, x + 1e-4, SIZE) for x in (0, SIZE - 1e-4))
    assert left.bounds[3] == pytest.approx(right.bounds[3], abs=1e-5)
    assert left.bounds[3] == pytest.approx(6.1e-3, abs=2e-5)


def test_tetragonal_prints_stay_so(sheet_tile: Tile) -> None:
    """A net whose islands and thin lines are cleaned alike in all images."""
    net = box(0, 0, SIZE, 0.7e-3) | box(0, 9.3e-3, SIZE, SIZE) | box(0, 0, 0.7e-3, SIZE)
    net |= box(9.3e-3, 0, SIZE, SIZE)
    spots = [Point(x, y).buffer(0.9e-3) for x in (3e-3, 7e-3) for y in (3.2e-3, 6.8e-3)]
    spots += [Point(y, x).buffer(0.9e-3) for x in (3e-3, 7e-3) for y in (3.2e-3, 6.8e-3)]
    made = cleaned(sheet_tile, shapely.union_all([net, *spots]), 0.0, "tetragonal")
    one = made.regions[0]
    assert made.bridged
    for turn in ([0, -1, 1, 0, SIZE, 0], [-1, 0, 0, 1, SIZE, 0], [0, 1, 1, 0, 0, 0]):
        image = affine_transform(one, turn)
        assert image.symmetric_difference(one).area < 1e-6 * one.area
