"""A print that can be made."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres, regions_of, worn_alike
from helpers.scenes import square
from mpi4py import MPI
from scipy.ndimage import gaussian_filter
from shapely.affinity import rotate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.cleaning import CleanedRegions, MirroredPanels, Panels, clean, thickened
from toros_fem.making.contours import measure_widths
from toros_fem.making.printability import (
    DEFAULT_LIMITS,
    PrintLimits,
    beyond_seams,
    find_pieces,
    part_regions,
    printability,
)
from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.pattern import mirrored

LIMIT, HOLE = 0.6, 0.5
PANEL = box(-15, -10, 15, 10)


def checked(pattern: Pattern, cleaned: CleanedRegions) -> list[BaseGeometry]:
    """The print, which keeps all limits, has no islands and survives wear."""
    found = printability(pattern, cleaned.regions)
    assert not found.lines.narrow
    assert not found.gaps.narrow
    assert not found.free_islands
    assert all(hole.area >= DEFAULT_LIMITS.hole_area for hole in found.holes)
    # Lines go on across straight seams.
    for region, longer, own in zip(
        *beyond_seams(pattern, cleaned.regions, 8 * MM), pattern.outlines, strict=True
    ):
        assert worn_alike(region, longer, 0.27 * MM, own.buffer(2 * MM))
    return cleaned.regions


def test_large_islands_are_bridged() -> None:
    pattern = square(n=8)
    body, island = box(1, 1, 19, 6), box(4, 9, 12, 12)
    crumb = Point(16, 14).buffer(1)
    regions = [metres(shapely.MultiPolygon([body, island, crumb]))]
    cleaned = clean(Panels(pattern), regions, island_area=5e-6)
    assert [len(cleaned.dropped), len(cleaned.bridged)] == [1, 1]
    (piece,) = shapely.get_parts(checked(pattern, cleaned)[0])
    added = piece.area - metres(body | island).area
    assert added == pytest.approx(1.2 * 3 * MM**2, rel=0.2)
    assert len(clean(Panels(pattern), regions, island_area=0.0).bridged) == 2
    assert len(clean(Panels(pattern), regions, island_area=math.inf).dropped) == 2


def test_an_island_is_bridged_to_a_small_piece_at_the_rim() -> None:
    """The bridge is wider than the piece is high, and ends at the panel's border."""
    pattern = cylinder(MPI.COMM_SELF, 0.04, 0.02, 2e-3)
    wall, whole = pattern.panel_index("wall"), pattern.outlines
    body, island, rim = box(20, 0, 40, 10), box(25, 24, 35, 34), box(27, 39.7, 33, 40)
    regions = [*whole]
    regions[wall] = metres(shapely.MultiPolygon([body, island, rim])) & whole[wall]
    cleaned = clean(Panels(pattern), regions, island_area=20e-6)
    assert [len(cleaned.dropped), len(cleaned.bridged)] == [0, 1]
    assert cleaned.regions[wall].contains(metres(island).buffer(-0.1 * MM))
    checked(pattern, cleaned)


def test_a_mesh_sees_the_bridge_that_it_smooths() -> None:
    """It is three smoothing lengths wide, where that is more than twice the least width."""
    pattern = square(n=8)
    regions = [metres(shapely.MultiPolygon([box(1, 1, 19, 6), box(4, 9, 12, 12)]))]
    for smoothing, width in ((0.1, 1.2), (0.6, 1.8)):
        (made,) = clean(Panels(pattern), regions, smoothing=smoothing * MM).regions
        across = made & metres(box(0, 7.4, 20, 7.6))
        assert across.area == pytest.approx(0.2 * width * MM**2, rel=0.02)


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, PrintLimits(0.2e-3, 0.3e-3)])
def test_no_corner_is_left_that_moves_a_border_by_less_than_2_micrometres(
    limits: PrintLimits, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files are as small as they can be; the border stays, and corners on that of the panel."""
    pattern = square(n=20, size=0.01)
    regions = regions_of(pattern, lambda p: 0.5 + 0.3 * np.sin(900 * p).prod(axis=1) - p[:, 0])
    with monkeypatch.context() as patch:
        patch.setattr("toros_fem.making.cleaning.simplified", lambda region, *_: region)
        (fine,) = clean(Panels(pattern), regions, limits, math.inf, smoothing=0.3e-3).regions
    (region,) = clean(Panels(pattern), regions, limits, math.inf, smoothing=0.3e-3).regions
    most = min(2e-6, 0.005 * limits.width)
    assert region.is_valid
    assert region.hausdorff_distance(fine) <= 1.001 * most
    counts = [shapely.get_num_coordinates(shape) for shape in (fine, region, region.simplify(most))]
    assert counts[1] < 0.4 * counts[0]
    assert counts[1] < 1.2 * counts[2], "corners on the cut stay"
    border = pattern.outline(0).boundary
    on_cut, kept = (
        {tuple(p) for p in shapely.get_coordinates(shape) if border.distance(Point(p)) < 1e-12}
        for shape in (fine, region)
    )
    assert kept == on_cut
    found = printability(pattern, [region], limits)
    assert not found.lines.narrow
    assert not found.gaps.narrow


def test_an_island_round_a_corner_of_its_panel_is_removed() -> None:
    """A straight bridge would leave the panel."""
    whole = square(n=8)
    kept = ~np.all(whole.centroids > 0.01, axis=1)  # the shape of an L
    used, corners = np.unique(whole.flat_triangles[kept], return_inverse=True)
    pattern = Pattern(
        flat_points=whole.flat_points[used],
        flat_triangles=corners.reshape(-1, 3),
        panel=whole.panel[kept],
        sewn=np.arange(len(used)),
        points=whole.points[used],
        panel_names=whole.panel_names,
    )
    regions = [metres(shapely.MultiPolygon([box(4, 14, 9, 19), box(14, 5, 17, 9)]))]
    cleaned = clean(Panels(pattern), regions, island_area=0.0)
    assert [len(cleaned.dropped), len(cleaned.bridged)] == [1, 0]
    checked(pattern, cleaned)


def test_pieces_that_only_touch_a_seam_are_islands(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 2e-3)
    wall = pattern.panel_index("wall")
    regions = [pattern.outline(k) for k in range(3)]
    tip = Polygon([(30, 40), (33, 37), (27, 37)])
    foot = box(10, 35, 13, 40)
    regions[wall] = metres(shapely.MultiPolygon([box(20, 0, 40, 20), tip, foot]))
    attached = [p.attached for p in find_pieces(pattern, regions, DEFAULT_LIMITS.contact)]
    assert sorted(attached) == [False] + 4 * [True]
    cleaned = clean(Panels(pattern), regions, island_area=20e-6)
    checked(pattern, cleaned)


def test_symmetric_prints_stay_symmetric(alone: MPI.Comm) -> None:
    """Lines of 0.5 mm on the plane and on the seam, of 0.4 mm across, and slanted ones."""
    part = cylinder(alone, 0.04, 0.02, 3e-3, planes=(1,))
    whole = mirrored(part, (1,))
    wall = part.panel_index("wall")
    left, _, right, top = part.outline(wall).bounds
    lines = [
        box(left, 0, left + 0.25e-3, top),
        box(right - 0.25e-3, 0, right, top),
        shapely.LineString([(left, 0.01), (right, 0.03)]).buffer(0.2e-3),
        box(left, 0.004, right, 0.0044),
    ]
    regions = [part.outline(k) for k in range(len(part.panel_names))]
    regions[wall] = shapely.union_all(lines) & part.outline(wall)
    onto = MirroredPanels(part, whole).whole(regions)
    after = checked(whole.pattern, clean(MirroredPanels(part, whole), onto))
    again = MirroredPanels(part, whole).whole(part_regions(part, after))
    for one, two in zip(after, again, strict=True):
        assert one.symmetric_difference(two).area < 1e-6 * one.area


@pytest.mark.parametrize("degrees", [20, 40])
def test_lines_meet_across_a_seam(alone: MPI.Comm, degrees: float) -> None:
    """However flat they cross it: each side is cleaned with what goes on beyond."""
    pattern = cylinder(alone, 0.06, 0.02, 2e-3)
    wall = pattern.panel_index("wall")
    left, low, right, high = pattern.outline(wall).bounds
    width, slope, spacing = right - left, 1 / np.tan(np.radians(degrees)), 0.02
    rise = spacing * max(1, round(width * slope / spacing))  # from seam to seam
    starts = np.arange(-4 * rise, high + 4 * rise, spacing)
    lines = [
        shapely.LineString([(left - width, z - rise), (left + 2 * width, z + 2 * rise)])
        for z in starts
    ]
    regions = list(pattern.outlines)
    regions[wall] = shapely.union_all(lines).buffer(0.6e-3) & pattern.outline(wall)
    cleaned = clean(Panels(pattern), regions, island_area=20e-6)
    print_ = cleaned.regions[wall].buffer(1e-9)

    def at_seam(x: float) -> np.ndarray:
        met = print_.intersection(shapely.LineString([(x, low + 2e-3), (x, high - 2e-3)]))
        parts = shapely.get_parts(met)
        return shapely.bounds(parts[shapely.length(parts) > 1e-6])[:, [1, 3]]

    one, two = at_seam(left + 1e-6), at_seam(right - 1e-6)
    assert len(one) >= 2
    assert one == pytest.approx(two, abs=0.03e-3)
    checked(pattern, cleaned)


def test_bridges_get_mirror_images(alone: MPI.Comm) -> None:
    """The shortest way from an island on the plane lies on one side only."""
    part = cylinder(alone, 0.04, 0.02, 3e-3, planes=(1,))
    whole = mirrored(part, (1,))
    wall = part.panel_index("wall")
    left, low, right, top = whole.pattern.outline(wall).bounds
    middle = (left + right) / 2
    regions = [whole.pattern.outline(k) for k in range(len(part.panel_names))]
    body = box(left, low, right, low + 10e-3)
    at = [middle - 8e-3, middle + 8e-3]
    arms = [box(x - 1e-3, low, x + 1e-3, top - 15e-3) for x in at]
    island = box(middle - 10e-3, top - 13e-3, middle + 10e-3, top - 9e-3)
    regions[wall] = shapely.union_all([body, *arms, island])
    cleaned = clean(MirroredPanels(part, whole), regions)
    assert len(cleaned.bridged) == 1
    after = checked(whole.pattern, cleaned)[wall]
    assert len(after.interiors) == 1, "two bridges enclose fabric"


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
