"""Prints that are made wide enough survive wear: nothing parts, and nothing vanishes."""

import math

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres, worn_alike
from scipy.ndimage import gaussian_filter
from shapely.affinity import rotate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.cleaning import thickened
from toros_fem.making.print.widths import measure_widths

LIMIT, HOLE = 0.6, 0.5
PANEL = box(-15, -10, 15, 10)


def made(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> BaseGeometry:
    """The print of a shape, in mm; checked to keep all limits and to survive wear."""
    region = thickened(metres(shape & panel), metres(panel), LIMIT * MM, LIMIT * MM, HOLE * MM**2)
    widths, gaps = measure_widths(region, metres(panel), 0, LIMIT * MM, LIMIT * MM, 0.02 * MM)
    assert not widths.narrow
    assert not gaps.narrow
    assert worn_alike(region, metres(panel), 0.45 * LIMIT * MM)
    assert region.is_valid
    return shapely.transform(region, lambda points: points / MM)


def bar(width: float, length: float = 40) -> Polygon:
    return box(-length / 2, -width / 2, length / 2, width / 2)


def test_lines_and_gaps_get_the_least_width() -> None:
    angle = 23.0
    line = rotate(bar(0.4), angle)
    length = (rotate(LineString([(-40, 0), (40, 0)]), angle) & PANEL).length
    assert made(line).area == pytest.approx(0.609 * length, rel=0.01)
    slit = rotate(bar(3), angle) - rotate(bar(0.4), angle)
    assert made(slit).area == pytest.approx((3 - 0.609) * length, rel=0.01)


def test_what_is_wide_enough_stays() -> None:
    ring = Point(1, 1).buffer(5, 64) - Point(1, 1).buffer(4.3, 64)
    cross = rotate(bar(0.8), 20) | rotate(bar(0.8), 75)
    for shape in (ring, cross, PANEL):
        found = made(shape)
        assert found.symmetric_difference(shape & PANEL).area < 0.01 * shape.area


def test_hairlines_go_and_slits_close() -> None:
    plates = box(-10, -5, -2, 5) | box(2, -5, 10, 5)
    joined = plates | box(-3, -0.1, 3, 0.1)
    assert made(joined).symmetric_difference(plates).area < 1
    parted = box(-10, -5, 10, 5) - box(-20, -0.1, 20, 0.1)
    assert made(parted).area == pytest.approx(200, rel=0.01)


def test_necks_and_bottlenecks() -> None:
    discs = Point(-3.98, 0).buffer(4, 64) | Point(3.98, 0).buffer(4, 64)  # a neck of 0.8 mm
    assert len(shapely.get_parts(made(discs))) == 1
    thin = Point(-3.99, 0).buffer(4, 64) | Point(3.99, 0).buffer(4, 64)  # of 0.57 mm
    assert len(shapely.get_parts(made(thin))) == 1
    apart = Point(-4.2, 0).buffer(4, 64) | Point(4.2, 0).buffer(4, 64)  # a gap of 0.4 mm
    assert len(shapely.get_parts(made(apart))) == 2


def test_holes_and_specks() -> None:
    plate = box(-8, -8, 8, 8)
    holes = plate - Point(0, 0).buffer(0.35) - Point(4, 4).buffer(1.5)
    (found,) = shapely.get_parts(made(holes))
    assert len(found.interiors) == 1
    specks = plate | Point(11, 0).buffer(0.1) | Point(11, 5).buffer(0.25) | Point(-12, 0).buffer(1)
    areas = np.sort(shapely.area(shapely.get_parts(made(specks))))
    assert areas == pytest.approx([0.29, 0.29, math.pi, 256], rel=0.02), "specks as wide as lines"


def test_slivers_along_the_cut_go_or_fill() -> None:
    slivers = box(-15, -10, 15, -9.9) | box(-15, 5, 15, 9.8)
    found = made(slivers)
    assert found.symmetric_difference(box(-15, 5, 15, 10)).area < 0.2
    rail = box(-15, -10, 15, -9.6)
    assert made(rail).bounds[3] == pytest.approx(-10 + 0.609, abs=0.01)


def test_lines_run_out_at_the_cut_as_they_come() -> None:
    """No round corners where a line is cut, but round ones elsewhere."""
    for angle in (30, 60, 90):
        line = rotate(bar(1.0, 60), angle) & PANEL
        assert made(line).symmetric_difference(line).area < 0.02
    plate = box(-5, -5, 5, 5)
    missing = plate - made(plate)
    radius = 0.95 * LIMIT / 2
    assert missing.area == pytest.approx((4 - math.pi) * radius**2, rel=0.05)


def test_random_patterns() -> None:
    """Patterns with features of all sizes, around the limit and far below, on a slanted panel."""
    noise = np.random.default_rng(1).normal(size=(30, 40))
    values = gaussian_filter(noise, 1.8)
    y, x = np.nonzero(values > np.quantile(values, 0.45))
    size = 0.33
    cells = shapely.box(*(np.stack([x, y, x + 1.02, y + 1.02]) * size))
    panel = rotate(Polygon([(0, 0), (12, 0), (13, 4), (10, 9.5), (1, 9)]), 11)
    made(shapely.union_all(cells).buffer(0.01), panel)
