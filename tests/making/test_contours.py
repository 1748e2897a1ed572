"""Contours, curves along them, widths."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres, regions_of
from helpers.scenes import square
from mpi4py import MPI
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.making.contours import Widths, measure_widths, printed_regions, smoothed
from toros_fem.meshes import cylinder

SQUARE = metres(box(-20, -20, 20, 20))
LENGTH = 0.7e-3
RESOLUTION = 0.03
PANEL = box(-20, -20, 20, 20)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8), (1.0, -1.0)])
@pytest.mark.parametrize("fraction", [0.3, 0.5, 1 / 3, 0.83])
def test_half_planes_are_exact(direction: tuple[float, float], fraction: float) -> None:
    pattern = square()
    normal = np.array(direction) / math.hypot(*direction)
    heights = pattern.flat_points @ normal
    level = heights.min() + fraction * np.ptp(heights)
    (region,) = regions_of(pattern, lambda points: 0.5 + 10 * (points @ normal - level))
    assert region.is_valid
    half = Polygon([level * normal + sign * 0.1 * np.array([-normal[1], normal[0]]) + far * normal
                    for sign, far in ((-1, 0), (1, 0), (1, 0.1), (-1, 0.1))])  # fmt: skip
    exact = half.intersection(box(0, 0, 0.02, 0.02)).area
    assert region.area == pytest.approx(exact, rel=1e-12)


def test_both_given_values_are_met() -> None:
    """A lone printed centroid makes a triangle, a lone printed vertex a star."""
    pattern = square(n=4)
    points, centroids = np.zeros(25), np.zeros(32)
    centroids[9] = 1.0
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    assert region.area == pytest.approx(pattern.areas[9] / 4)
    points, centroids = np.zeros(25), np.zeros(32)
    points[12] = 1.0
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    # Half as far along all edges of the six triangles' thirds around it.
    assert region.area == pytest.approx(6 * pattern.areas[0] * 2 / 3 / 4)
    assert region.contains(Point(pattern.flat_points[12]))


def test_whole_and_empty_panels(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 4e-3)
    ones = np.ones(len(pattern.flat_points)), np.ones(len(pattern.panel))
    for panel, region in enumerate(printed_regions(pattern, *ones, 0.5)):
        outline = pattern.outline(panel)
        assert region.normalize().equals_exact(outline.normalize(), 0)
        assert region.area == pytest.approx(pattern.areas[pattern.panel == panel].sum(), rel=1e-13)
    assert all(r.is_empty for r in printed_regions(pattern, 0 * ones[0], 0 * ones[1], 0.5))
    assert all(r.is_empty for r in printed_regions(pattern, *ones, 1.0)), "above, not at"


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_values_at_the_threshold(seed: int) -> None:
    """Values exactly at or next to the threshold leave valid polygons of the right area."""
    pattern = square(n=20)
    rng = np.random.default_rng(seed)
    values = [0.0, 0.5, 0.5 + 1e-16, 0.5 - 1e-12, 0.5 + 1e-8, 1.0]
    points, centroids = rng.choice(values, 441), rng.choice(values, 800)
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    assert region.is_valid
    (below,) = printed_regions(pattern, 1 - points, 1 - centroids, 0.5)
    assert below.is_valid
    assert region.intersection(below).area < 1e-9 * region.area
    # A triangle is three around its centroid, each with a linear field.
    points, centroids = (np.where(np.abs(v - 0.5) < 1e-9, 0, v - 0.5) for v in (points, centroids))
    corners = points[pattern.flat_triangles]
    sides = [np.stack([corners[:, k], corners[:, k - 1], centroids], 1) for k in range(3)]
    low, middle, high = np.sort(np.concatenate(sides), axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        one = high**2 / ((high - low) * (high - middle))  # only the highest corner is above
        two = 1 - low**2 / ((high - low) * (middle - low))
    part = np.where(low >= 0, high > 0, np.where(middle > 0, two, np.where(high > 0, one, 0)))
    expected = np.tile(pattern.areas / 3, 3) @ part
    assert region.area == pytest.approx(expected, rel=1e-9)


def wave(period: float, height: float) -> Polygon:
    """A band across the panel, in mm, whose upper border is a wave."""
    x = np.linspace(-20, 20, 801)
    return Polygon([*np.column_stack([x, 3 + height * np.sin(2 * np.pi * x / period)]),
                    (20, -3), (-20, -3)])  # fmt: skip


def roughness(shape: shapely.Geometry) -> float:
    """Standard deviation of the upper border's height in mm, away from the ends."""
    x, y = 1e3 * shapely.get_coordinates(shape).T
    return float(np.std(y[(y > 0) & (np.abs(x) < 12)]))


@pytest.mark.parametrize(("period", "kept"), [(1.0, 0.0), (16.0, 1.0)])
def test_short_waves_vanish_and_long_ones_stay(period: float, kept: float) -> None:
    before = metres(wave(period, 0.1))
    after = smoothed(before, SQUARE, LENGTH)
    assert roughness(after) == pytest.approx(kept * roughness(before), abs=5e-3)
    assert after.area == pytest.approx(before.area, rel=1e-3)
    assert after.is_valid


def test_ends_at_the_cut_stay() -> None:
    before = metres(wave(1.0, 0.3))
    after = smoothed(before, SQUARE, LENGTH)
    for side in (-0.02, 0.02):
        edge = shapely.LineString([(side, -0.02), (side, 0.02)])
        ends = [shape.intersection(edge).bounds for shape in (before, after)]
        assert ends[1] == pytest.approx(ends[0], abs=1e-9)


def test_discs_keep_their_radius_and_holes_stay_holes() -> None:
    ring = metres(Point(0, 0).buffer(6, 16) - Point(0, 0).buffer(2.5, 8))
    after = smoothed(ring, SQUARE, LENGTH)
    assert len(after.interiors) == 1
    assert after.area == pytest.approx(ring.area, rel=0.01)
    corners = metres(box(-3, -3, 3, 3))
    rounder = smoothed(corners, SQUARE, LENGTH)
    assert rounder.hausdorff_distance(corners) < LENGTH
    assert rounder.area == pytest.approx(corners.area, rel=0.01)


def test_small_pieces_and_the_panel_stay() -> None:
    dot = metres(Point(3, 2).buffer(0.5, 8))
    assert smoothed(dot, SQUARE, LENGTH).equals(dot)
    assert smoothed(SQUARE, SQUARE, LENGTH).equals(SQUARE)


def measured(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> tuple[Widths, Widths]:
    """Widths and gaps of a shape in mm under limits of 0.6 mm."""
    return measure_widths(metres(shape), metres(panel), 0, 0.6 * MM, 0.6 * MM, RESOLUTION * MM)


def width_of(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> float | None:
    place = measured(shape, panel)[0].smallest
    return place.width / MM if place else None


def gap_of(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> float | None:
    place = measured(shape, panel)[1].smallest
    return place.width / MM if place else None


def bar(width: float, length: float = 24) -> Polygon:
    return box(-length / 2, -width / 2, length / 2, width / 2)


def wedge(angle: float, length: float = 10) -> Polygon:
    half = length * math.tan(math.radians(angle / 2))
    return Polygon([(0, 0), (length, half), (length, -half)])


@pytest.mark.parametrize("angle", [0.0, 73.3])
@pytest.mark.parametrize("width", [0.05, 0.6, 2.5])
def test_bars(width: float, angle: float) -> None:
    widths, gaps = measured(rotate(bar(width), angle))
    assert widths.smallest.width / MM == pytest.approx(width, abs=1e-6)
    assert np.linalg.norm(np.subtract(*widths.smallest.ends)) / MM == pytest.approx(width, abs=1e-6)
    assert len(widths.narrow) == (width < 0.6), "one stretch is one place"
    assert gaps.smallest is None


@pytest.mark.parametrize("width", [0.05, 0.1, 0.3, 0.77, 2.0])
def test_bars_whose_samples_do_not_face(width: float) -> None:
    """Slanted ends: the error is that of a disc between staggered samples."""
    for fraction in (0.1, 0.37, 0.9):
        skew = fraction * width
        line = Polygon([(0, 0), (12, 0), (12 + skew, width), (-skew / 3, width)])
        bound = min(RESOLUTION**2 / (4 * width), RESOLUTION)
        found = width_of(rotate(line, 21))
        assert found is not None
        assert -1e-9 < found - width < bound


def test_necks() -> None:
    for reach, half in ((4.0, 4.0), (3.02, 0.3)):
        disc = Point(0, 0).buffer(3, 64)
        neck = bar(0.25, 2 * half)
        shape = translate(disc, -reach) | translate(disc, reach) | neck
        widths, _ = measured(rotate(shape, 33))
        assert widths.smallest.width / MM == pytest.approx(0.25, abs=1e-3)
        assert np.linalg.norm(widths.smallest.centre) / MM < half
        assert len(widths.narrow) == 1
    round_disc = Point(0, 0).buffer(3, 512)
    overlap = translate(round_disc, -2.99) | translate(round_disc, 2.99)
    assert width_of(overlap) == pytest.approx(2 * math.sqrt(9 - 2.99**2), abs=2e-3)
    double_taper = Polygon([(0, -1), (0, 1), (8, 0.25), (16, 1), (16, -1), (8, -0.25)])
    assert width_of(double_taper) == pytest.approx(0.5, abs=1e-3)


def test_rings_and_gaps() -> None:
    ring = Point(0, 0).buffer(5, 64) - Point(0, 0).buffer(4.2, 64)
    assert width_of(ring) == pytest.approx(0.8, abs=2e-3)
    assert gap_of(ring) == pytest.approx(8.4, abs=3e-3), "a hole is as wide as its largest disc"
    discs = Point(-3.15, 0).buffer(3, 64) | Point(3.15, 0).buffer(3, 64)
    widths, gaps = measured(discs)
    assert gaps.smallest.width / MM == pytest.approx(0.3, abs=1e-3)
    assert gaps.smallest.centre == pytest.approx((0, 0), abs=0.2 * MM)
    assert len(gaps.narrow) == 1
    assert not widths.narrow
    plate = box(-5, -5, 5, 5)
    assert gap_of(plate - Point(1, 1).buffer(0.15, 64)) == pytest.approx(0.3, abs=1e-3)
    assert gap_of(plate - rotate(bar(0.2, 6), 30)) == pytest.approx(0.2, abs=1e-3)


def test_junctions_and_ends_are_no_narrow_places() -> None:
    beam = bar(0.8, 20)
    tee = beam | box(-0.5, 0, 0.5, 12)
    assert width_of(tee) == pytest.approx(0.8, abs=1e-3)
    for angle in (40, 60, 90):
        cross = rotate(beam, 12) | rotate(beam, 12 + angle)
        widths, gaps = measured(cross)
        assert widths.smallest.width / MM == pytest.approx(0.8, abs=1e-3)
        assert not gaps.narrow, "nor are the corners between the arms"
    tip = LineString([(0, 0), (8, 3)]).buffer(0.35, 32)
    assert width_of(tip) == pytest.approx(0.7, abs=1e-3)


def test_shapes_without_facing_sides() -> None:
    assert width_of(rotate(box(0, 0, 3, 3), 11)) == pytest.approx(3, abs=0.02)
    assert width_of(box(0, 0, 0.3, 0.3)) == pytest.approx(0.3, abs=0.02)
    assert width_of(Point(1, 2).buffer(0.25, 64)) == pytest.approx(0.5, abs=0.02)
    assert width_of(Polygon()) is None


def test_tapers() -> None:
    """Sharper than 28° a wedge is narrow up to where its end begins, else it is a corner."""
    sharp, blunt = width_of(wedge(20)), width_of(wedge(32))
    assert sharp is not None
    assert blunt is not None
    assert 0.3 < sharp < 0.6
    assert blunt > 4
    blunt_end = Polygon([(0, -1), (0, 1), (10, 0.25), (10, -0.25)])
    assert width_of(blunt_end) == pytest.approx(0.66, abs=0.02)


def test_the_cut_is_no_side() -> None:
    panel = box(-10, -10, 10, 10)
    for angle in (0, 30, 60, 80, 87):
        line = rotate(bar(0.7, 60), angle) & panel
        assert width_of(line, panel) == pytest.approx(0.7, abs=1e-3), angle
    for shape in (box(9, -5, 10, 5), panel, Point(10, 0).buffer(2) & panel):
        widths, gaps = measured(shape, panel)
        assert widths == gaps == (None, ())
    y = np.linspace(-8, 8, 200)
    wave = Polygon([*np.column_stack([9.7 + 0.35 * np.sin(3 * y), y]), (7, 8), (7, -8)]) & panel
    assert (width_of(wave, panel) or 0) > 2, "line that brushes the border"
    touching = Polygon([(0, -2), (0, 2), (10.3, 0)]) & panel
    assert (width_of(touching, panel) or 0) > 0.4, "tip that pokes at the border"
    beside = box(8, -5, 9, 5)
    assert width_of(beside, panel) == pytest.approx(1, abs=1e-3)
    assert gap_of(beside, panel) is None, "the cloth beside it ends at the cut"


def test_slivers_along_the_cut() -> None:
    panel = box(-10, -10, 10, 10)
    sliver = box(9.95, -5, 10, 5)
    assert width_of(sliver, panel) == pytest.approx(0.05, abs=1e-3)
    assert gap_of(sliver, panel) is None
    beside = box(8, -5, 9.8, 5)
    assert gap_of(beside, panel) == pytest.approx(0.2, abs=1e-3)
    assert width_of(beside, panel) == pytest.approx(1.8, abs=1e-3)
    corner = Polygon([(9.6, -10), (10, -10), (10, -9.6)])
    widths, _ = measured(corner, panel)
    assert len(widths.narrow) == 1, "a crumb in a corner"


def test_only_a_part_is_measured() -> None:
    """Lines, gaps and dots elsewhere do not count, and those inside keep their widths."""
    lines = [translate(bar(width), 0, y) for width, y in ((1.0, 0), (0.4, 5), (1.5, 6))]
    shape = lines[0].union(lines[1]).union(lines[2]).union(Point(0, 10).buffer(0.2))
    part = metres(box(-8, -1, 8, 1))
    limits = 0.6 * MM, 0.6 * MM, RESOLUTION * MM
    widths, gaps = measure_widths(metres(shape), metres(PANEL), 0, *limits, part)
    assert widths.smallest.width / MM == pytest.approx(1.0, abs=1e-6)
    assert widths.narrow == gaps.narrow == ()
    whole, apart = measured(shape)
    assert (len(whole.narrow), len(apart.narrow)) == (2, 1)


def test_samples_are_bounded_before_they_are_made() -> None:
    """A printer whose lines are 1e-9 m thin is none: it took all memory."""
    shape = metres(bar(1.0))
    with pytest.raises(ParameterError, match=r"at .* places of the border, .* at least [\d.e-]+ m"):
        measure_widths(shape, metres(PANEL), 0, 1e-9, 1e-9, 1e-10)
