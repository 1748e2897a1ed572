"""Regions become a print that can be made: nothing thin, no small holes, no free islands."""

import math

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres, regions_of, worn_alike
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.cleaning import CleanedRegions, MirroredPanels, Panels, clean
from toros_fem.making.print.printability import (
    DEFAULT_LIMITS,
    PrintLimits,
    find_pieces,
    printability,
)
from toros_fem.making.print.regions import beyond_seams, part_regions
from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.pattern import mirrored


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
        patch.setattr("toros_fem.making.print.cleaning.simplified", lambda region, *_: region)
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
