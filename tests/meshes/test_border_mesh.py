"""Triangles lie inside or outside of regions, whose borders are edges; panels and seams stay."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import PanelError, PatternError
from toros_fem.making.printability import part_regions, read_print_polygons, regions_on
from toros_fem.mechanics.skin.supports import clamp, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, mirrored, two_panels
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.outlines import Star, walker
from toros_fem.meshes.triangles import edge_keys, least_angles, lengths

RADIUS = 0.01
PRINTS = Path(__file__).parents[2] / "benchmarks" / "prints"
NOTHING = shapely.Polygon()


def helices(pattern: Pattern) -> list[BaseGeometry]:
    """Eight lines of 1.6 mm on a tube's wall, at 40° to the axis; the caps are printed all over."""
    wall = pattern.panel_index("wall")
    low = pattern.outline(wall).bounds[0]
    around = np.ptp(pattern.corners[pattern.cells_of("wall"), :, 0])
    around *= 2 if low > 0 else 1
    rise = np.array([np.tan(np.radians(40)) * 0.06, 0.06])
    starts = [np.array([k * around / 8, 0.0]) for k in range(-8, 16)]
    lines = [shapely.LineString([s - rise, s + 2 * rise]).buffer(0.8 * MM) for s in starts]
    found = list(pattern.outlines)
    found[wall] = shapely.union_all(lines) & pattern.outline(wall)
    return found


def ring_on_star(pattern: Pattern) -> list[BaseGeometry]:
    """A ring round the middle of the top, which meets the outline, and a disc below."""
    ring = Point(0, 0).buffer(0.03).difference(Point(0, 0).buffer(0.016))
    return [ring & pattern.outline(0), Point(0.004, 0).buffer(0.006)]


def checked(
    pattern: Pattern, regions: list[BaseGeometry], size: float | None = None
) -> tuple[Pattern, np.ndarray]:
    """The mesh, whose panels, seams and regions are those that were given."""
    found, inside = bordered(MPI.COMM_SELF, pattern, regions, size)
    made = found.pattern
    for panel, (region, outline) in enumerate(zip(regions, pattern.outlines, strict=True)):
        here = made.panel == panel
        assert outline.symmetric_difference(made.outline(panel)).area < 1e-9 * outline.area
        printed = shapely.union_all(shapely.polygons(made.corners[here & inside]))
        assert printed.area == pytest.approx(region.area, rel=2e-3, abs=1e-12)
        off = printed.symmetric_difference(region)
        assert off.area < 0.02 * region.area + 1e-12
    assert made.panel_names == pattern.panel_names
    if len(pattern.seams):
        joined = [lengths(p.flat_points, p.seams[:, 0]).sum() for p in (pattern, made)]
        assert joined[1] == pytest.approx(joined[0])
        assert made.seam_gaps.max() < 1e-6
    free = [lengths(p.points, p.free_edges).sum() for p in (pattern, made)]
    assert free[1] == pytest.approx(free[0], rel=1e-9)
    assert np.degrees(least_angles(made.corners).min()) > 3
    assert found.weights.sum(axis=1) == pytest.approx(1.0)
    flat = found.at_vertices(pattern.points)
    assert (
        np.abs(flat - made.points).max() < 0.06 * lengths(pattern.points, pattern.edges.ends).max()
    )
    middles = shapely.points(made.centroids)
    assert shapely.covers(shapely.polygons(pattern.corners[found.cell]), middles).all()
    again, _ = bordered(MPI.COMM_SELF, pattern, regions, size)
    assert np.array_equal(again.pattern.points, made.points)
    return made, inside


@pytest.mark.parametrize("planes", [(), (1,)])
def test_lines_on_a_tube(planes: tuple[int, ...]) -> None:
    pattern = cylinder(MPI.COMM_SELF, 0.04, 2 * RADIUS, 2.8e-3, planes=planes)
    made, inside = checked(pattern, helices(pattern))
    wall = made.cells_of("wall")
    off = np.hypot(*made.points[made.triangles[wall]][..., :2].reshape(-1, 2).T) - RADIUS
    assert np.abs(off).max() < 0.012 * RADIUS, "it stays a tube"
    assert made.points[:, 2].min() == 0.0
    assert inside[made.cells_of("base")].all()
    if planes:
        whole = mirrored(made, planes)
        assert whole.pattern.areas.sum() == pytest.approx(2 * made.areas.sum())
        for make in (lambda p: symmetry_plane(p, 1), lambda p: clamp(p, ["base"])):
            carried = make(pattern).refined(bordered(MPI.COMM_SELF, pattern, helices(pattern))[0])
            own, count = make(made), len(made.points)
            assert np.array_equal(carried.fixed, own.fixed)
            one, two = (np.sort(edge_keys(each.guided, count)) for each in (carried, own))
            assert np.array_equal(one, two)
            assert carried.planes == own.planes


@pytest.mark.parametrize("edge", [2.8e-3, 1.3e-3])
def test_rings_on_two_panels(edge: float) -> None:
    """A hole, a border that crosses the seam, and arcs of the outline."""
    star = Star(4, 0.03, 0.02, 0.02, 6e-3, np.pi / 4)
    pattern = walker(MPI.COMM_SELF, 2.8e-3, star)
    checked(pattern, ring_on_star(pattern), edge)


def test_own_width_decides_on_edges() -> None:
    """Lines of half the width have edges of half the length; the fabric keeps its own."""
    pattern = square(n=10)
    found = []
    for width in (1.0, 0.5):
        region = metres(shapely.union_all([box(4, 0, 4 + width, 20), box(14, 0, 14 + width, 20)]))
        made, inside = checked(pattern, [region])
        border = made.edges.ends[made.edges.inner]
        one, two = made.edges.sides[made.edges.inner].T
        found.append(
            float(np.median(lengths(made.flat_points, border[inside[one] != inside[two]])))
        )
        fabric = np.sqrt(4 / np.sqrt(3) * np.quantile(made.areas[~inside], 0.9))
        assert 1.2e-3 < fabric < 2.6e-3
    assert found[0] == pytest.approx(1e-3, rel=0.15)
    assert found[1] == pytest.approx(0.5e-3, rel=0.15)


def test_pieces_that_are_too_thin_are_left_out() -> None:
    """A gap of 10 µm to the outline, and a line of 10 µm, are no triangles."""
    pattern = square(n=10)
    region = metres(shapely.union_all([box(0.01, 2, 12, 10), box(15, 2, 15.01, 18)]))
    found, inside = bordered(MPI.COMM_SELF, pattern, [region])
    made = found.pattern
    printed = shapely.union_all(shapely.polygons(made.corners[inside]))
    assert printed.area == pytest.approx(metres(box(0, 2, 12, 10)).area, rel=1e-6)
    assert lengths(made.flat_points, made.edges.ends).min() > 0.2e-3


def test_a_border_along_the_outline_is_left_out() -> None:
    """A print of another mesh has another polygon for the same half of a disc."""
    stored = read_print_polygons(MPI.COMM_SELF, PRINTS / "bend.npz")
    pattern = cylinder(MPI.COMM_SELF, 0.15, 2 * RADIUS, 1.96e-3, planes=[1])
    whole = mirrored(pattern, [1]).pattern
    regions = part_regions(pattern, regions_on(stored.pattern, stored.regions, whole))
    made = bordered(MPI.COMM_SELF, pattern, regions, coarser=0.7)[0].pattern
    areas = np.bincount(made.panel, made.areas)
    assert areas == pytest.approx(np.bincount(pattern.panel, pattern.areas))


def test_nothing_printed_is_a_plain_mesh() -> None:
    pattern = cylinder(MPI.COMM_SELF, 0.04, 2 * RADIUS, 2.8e-3)
    empty = [NOTHING, shapely.GeometryCollection(), shapely.MultiPolygon()]
    _, inside = bordered(MPI.COMM_SELF, pattern, empty)
    assert not inside.any()
    assert len(inside) == pytest.approx(len(pattern.panel), rel=0.15)


def test_an_edge_between_two_seams_is_halved() -> None:
    """Both panels of a slender finger would have it between the same vertices."""
    outline = [(0, -0.002), (0.04, -0.002), (0.04, 0.002), (0, 0.002)]
    pattern = two_panels(MPI.COMM_SELF, outline, 1.3e-3)
    regions = [metres(box(5, -3, 9, 3)) & pattern.outline(0), NOTHING]
    checked(pattern, regions, 8e-3)


def test_borders_that_meet_are_told_with_their_place() -> None:
    pattern = square(n=10)
    corner = metres(shapely.MultiPolygon([box(4, 4, 10, 10), box(10, 10, 15, 15)]))
    with pytest.raises(PatternError, match=r"panel 'sheet' near \(\d+\.\d+, \d+\.\d+\) mm"):
        bordered(MPI.COMM_SELF, pattern, [corner])
    apart = metres(shapely.MultiPolygon([box(4, 4, 9.6, 9.6), box(10, 10, 15, 15)]))
    checked(pattern, [apart])
    with pytest.raises(PanelError, match="2 regions for 1 panels"):
        bordered(MPI.COMM_SELF, pattern, [corner, corner])
