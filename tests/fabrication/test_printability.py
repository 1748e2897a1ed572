"""Contours are exact; widths, gaps, islands and holes are those of shapes that are known."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.scenes import square
from mpi4py import MPI
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.errors import DensityError, ParameterError
from toros_fem.fabrication.contours import panel_outline, printed_regions, reinforcement
from toros_fem.fabrication.islands import clean, find_holes, find_pieces
from toros_fem.fabrication.printability import PrintLimits, printability, printed_cells
from toros_fem.fabrication.widths import Thin, measure_widths
from toros_fem.meshes import Pattern, cylinder
from toros_fem.output.plots import plot_printability

MM = 1e-3
RESOLUTION = 0.03
PANEL = box(-20, -20, 20, 20)
Density = Callable[[np.ndarray], np.ndarray]


def metres(shape: BaseGeometry) -> BaseGeometry:
    return shapely.transform(shape, lambda points: points * MM)


def measured(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> tuple[Thin, Thin]:
    """Widths and gaps of a shape in mm under limits of 0.6 mm."""
    return measure_widths(metres(shape), metres(panel), 0, 0.6 * MM, 0.6 * MM, RESOLUTION * MM)


def width_of(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> float | None:
    place = measured(shape, panel)[0].smallest
    return place.width / MM if place else None


def gap_of(shape: BaseGeometry, panel: BaseGeometry = PANEL) -> float | None:
    place = measured(shape, panel)[1].smallest
    return place.width / MM if place else None


def regions_of(pattern: Pattern, density: Density) -> list[BaseGeometry]:
    values = density(pattern.flat_points), density(pattern.centroids)
    return printed_regions(pattern, *values, 0.5)


def bar(width: float, length: float = 24) -> Polygon:
    return box(-length / 2, -width / 2, length / 2, width / 2)


def wedge(angle: float, length: float = 10) -> Polygon:
    half = length * math.tan(math.radians(angle / 2))
    return Polygon([(0, 0), (length, half), (length, -half)])


# Contours


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8), (1.0, -1.0)])
@pytest.mark.parametrize("share", [0.3, 0.5, 1 / 3, 0.83])
def test_half_planes_are_exact(direction: tuple[float, float], share: float) -> None:
    pattern = square()
    normal = np.array(direction) / math.hypot(*direction)
    heights = pattern.flat_points @ normal
    level = heights.min() + share * np.ptp(heights)
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
    region = reinforcement(pattern, points, centroids, 0, 0.5)
    assert region.area == pytest.approx(pattern.areas[9] / 4)
    points, centroids = np.zeros(25), np.zeros(32)
    points[12] = 1.0
    region = reinforcement(pattern, points, centroids, 0, 0.5)
    # Half as far along all edges of the six triangles' thirds around it.
    assert region.area == pytest.approx(6 * pattern.areas[0] * 2 / 3 / 4)
    assert region.contains(Point(pattern.flat_points[12]))


def test_whole_and_empty_panels(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 4e-3)
    ones = np.ones(len(pattern.flat_points)), np.ones(len(pattern.panel))
    for panel, region in enumerate(printed_regions(pattern, *ones, 0.5)):
        outline = panel_outline(pattern, panel)
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
    region = reinforcement(pattern, points, centroids, 0, 0.5)
    assert region.is_valid
    below = reinforcement(pattern, 1 - points, 1 - centroids, 0, 0.5)
    assert below.is_valid
    assert region.intersection(below).area < 1e-9 * region.area


def test_values_must_fit() -> None:
    pattern = square()
    with pytest.raises(DensityError, match="at_points must hold 25"):
        reinforcement(pattern, np.zeros(32), np.zeros(25), 0, 0.5)
    with pytest.raises(DensityError, match="at_centroids must hold 32 finite"):
        reinforcement(pattern, np.zeros(25), np.full(32, np.nan), 0, 0.5)


# Widths and gaps


def test_noise_about_the_limit_is_one_place() -> None:
    x = np.linspace(-10, 10, 100)
    above = 0.3 + 0.02 * (-1.0) ** np.arange(100)
    strip = Polygon([*np.column_stack([x, above]), (10, -0.3), (-10, -0.3)])
    assert len(measured(strip)[0].under) == 1


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0, 73.3])
@pytest.mark.parametrize("width", [0.05, 0.3, 0.6, 1.0, 2.5])
def test_strips(width: float, angle: float) -> None:
    widths, gaps = measured(rotate(bar(width), angle))
    assert widths.smallest is not None
    assert widths.smallest.width / MM == pytest.approx(width, abs=1e-6)
    assert np.linalg.norm(np.subtract(*widths.smallest.ends)) / MM == pytest.approx(width, abs=1e-6)
    assert len(widths.under) == (width < 0.6), "one stretch is one place"
    assert gaps.smallest is None


@pytest.mark.parametrize("width", [0.05, 0.1, 0.3, 0.77, 2.0])
def test_strips_whose_samples_do_not_face(width: float) -> None:
    """Slanted ends: the error is that of a disc between staggered samples."""
    for share in (0.1, 0.37, 0.9):
        skew = share * width
        strip = Polygon([(0, 0), (12, 0), (12 + skew, width), (-skew / 3, width)])
        bound = min(RESOLUTION**2 / (4 * width), RESOLUTION)
        found = width_of(rotate(strip, 21))
        assert found is not None
        assert -1e-9 < found - width < bound


def test_necks() -> None:
    for reach, half in ((4.0, 4.0), (3.02, 0.3)):
        disc = Point(0, 0).buffer(3, 64)
        neck = bar(0.25, 2 * half)
        shape = translate(disc, -reach) | translate(disc, reach) | neck
        widths, _ = measured(rotate(shape, 33))
        assert widths.smallest is not None
        assert widths.smallest.width / MM == pytest.approx(0.25, abs=1e-3)
        assert np.linalg.norm(widths.smallest.middle) / MM < half
        assert len(widths.under) == 1
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
    assert gaps.smallest is not None
    assert gaps.smallest.width / MM == pytest.approx(0.3, abs=1e-3)
    assert gaps.smallest.middle == pytest.approx((0, 0), abs=0.2 * MM)
    assert len(gaps.under) == 1
    assert not widths.under
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
        assert widths.smallest is not None
        assert widths.smallest.width / MM == pytest.approx(0.8, abs=1e-3)
        assert not gaps.under, "nor are the corners between the arms"
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


@pytest.mark.parametrize("seed", range(3))
def test_jagged_borders(seed: int) -> None:
    noise = np.random.default_rng(seed).uniform(-0.02, 0.02, (2, 400))
    x = np.linspace(-10, 10, 400)
    above, below = np.column_stack([x, 0.4 + noise[0]]), np.column_stack([x, -0.4 + noise[1]])
    assert 0.75 < (width_of(rotate(Polygon([*above, *below[::-1]]), 30)) or 0) < 0.8


def test_the_cut_is_no_side() -> None:
    panel = box(-10, -10, 10, 10)
    for angle in (0, 30, 60, 80, 87):
        line = rotate(bar(0.7, 60), angle) & panel
        assert width_of(line, panel) == pytest.approx(0.7, abs=1e-3), angle
    for shape in (box(9.95, -5, 10, 5), panel, Point(10, 0).buffer(2) & panel):
        widths, gaps = measured(shape, panel)
        assert widths == gaps == (None, ())
    y = np.linspace(-8, 8, 200)
    wave = Polygon([*np.column_stack([9.7 + 0.35 * np.sin(3 * y), y]), (7, 8), (7, -8)]) & panel
    assert (width_of(wave, panel) or 0) > 2, "line that brushes the border"
    touching = Polygon([(0, -2), (0, 2), (10.3, 0)]) & panel
    assert (width_of(touching, panel) or 0) > 0.4, "tip that pokes at the border"
    beside = box(9, -5, 9.98, 5)
    assert width_of(beside, panel) == pytest.approx(0.98, abs=1e-3)
    assert gap_of(beside, panel) is None, "the cloth beside it ends at the cut"


# Pieces


def test_islands_and_holes() -> None:
    pattern = square(n=80)
    spots = np.array([[0.004, 0.004], [0.016, 0.004], [0.016, 0.016]])
    radii = np.array([2e-3, 1e-3, 3e-3])

    def density(points: np.ndarray) -> np.ndarray:
        away = np.linalg.norm(points[:, None] - spots, axis=2) - radii
        away[:, 2] = np.abs(away[:, 2] + 1e-3) - 1e-3  # a ring of 2 mm
        return 0.5 - 50 * away.min(axis=1)

    regions = regions_of(pattern, density)
    found = printability(pattern, regions, PrintLimits(hole_area=4e-6))
    assert found.pieces == 3
    assert [len(found.islands), len(found.free_islands), len(found.holes)] == [2, 2, 1]
    assert [i.area for i in found.islands] == pytest.approx(np.pi * radii[:2] ** 2, rel=0.03)
    assert found.holes[0].area == pytest.approx(np.pi * 1e-3**2, rel=0.03)
    assert found.smallest_width is not None
    assert found.smallest_width.width == pytest.approx(2e-3, rel=0.05)
    summary = found.summary()
    assert summary["islands"] == 2
    assert summary["pieces"] == 3
    assert summary["holes"] == 1
    assert summary["island_areas_mm2"] == pytest.approx([4 * np.pi, np.pi], rel=0.03)
    assert summary["smallest_width_mm"] == pytest.approx(2, rel=0.05)
    assert summary["smallest_gap_mm"] == pytest.approx(2, rel=0.05)

    cleaned = clean(pattern, regions, island_area=5e-6, hole_area=4e-6)
    assert [piece.area for piece in cleaned.dropped] == [found.islands[1].area]
    assert len(cleaned.filled) == 1
    after = find_pieces(pattern, cleaned.regions)
    assert len(after) == 2
    assert not find_holes(pattern, cleaned.regions)
    kept = regions[0].area - found.islands[1].area + found.holes[0].area
    assert cleaned.regions[0].area == pytest.approx(kept, rel=1e-12)
    untouched = clean(pattern, regions, island_area=0, hole_area=0)
    assert not untouched.dropped
    assert not untouched.filled
    assert untouched.regions[0].equals(regions[0])
    assert len(find_pieces(pattern, clean(pattern, regions, math.inf, 0).regions)) == 1


def test_border_without_the_cut() -> None:
    """Half of a sheet printed: its border is the line across, not the panel's own."""
    pattern = square(size=0.02)
    half = shapely.box(0, 0, 0.012, 0.02)
    assert printability(pattern, [half]).summary()["border_mm"] == pytest.approx(20)
    assert printability(pattern, [shapely.box(0, 0, 0.02, 0.02)]).border == 0


def test_nothing_printed() -> None:
    pattern = square()
    found = printability(pattern, regions_of(pattern, lambda points: 0 * points[:, 0]))
    summary = found.summary()
    assert summary["pieces"] == summary["islands"] == summary["holes"] == 0
    assert summary["smallest_width_mm"] is None
    assert summary["smallest_gap_mm"] is None
    assert summary["border_mm"] == 0
    assert not printed_cells(pattern, regions_of(pattern, lambda p: 0 * p[:, 0])).any()


def test_pieces_across_seams(comm: MPI.Comm) -> None:
    """A body that runs out at the tube's seam, its other half, and a spot that meets nothing."""
    pattern = cylinder(comm, 0.04, 0.02, 2e-3, caps=False)
    width = np.ptp(pattern.flat_points[:, 0])
    shapes = {
        "body": box(0.02, 0.02, width, 0.03),
        "other half": box(0, 0.029, 0.01, 0.035),
        "spot at the seam": box(width - 5e-3, 5e-3, width, 10e-3),
        "spot across": box(0, 11e-3, 5e-3, 16e-3),
        "spot": box(0.02, 5e-3, 0.025, 10e-3),
    }
    (outline,) = (panel_outline(pattern, 0),)
    region = shapely.MultiPolygon(list(shapes.values())) & outline
    pieces = find_pieces(pattern, [region])
    assert [piece.main for piece in pieces] == [True] + 4 * [False]
    met = {name: piece.attached for name, shape in shapes.items()
           for piece in pieces if piece.polygon.intersects(shape.buffer(-1e-3))}  # fmt: skip
    assert met == {"body": True, "other half": True, "spot at the seam": False,
                   "spot across": False, "spot": False}  # fmt: skip
    summary = printability(pattern, [region]).summary()
    assert (summary["pieces"], summary["islands"], summary["islands_attached_by_seam"]) == (5, 3, 1)
    assert len(find_pieces(pattern, clean(pattern, [region], math.inf, 0).regions)) == 2


def test_caps_hold_what_touches_them(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 2e-3)
    wall, tip = pattern.panel_index("wall"), pattern.panel_index("tip")
    shapes = [box(0.02, 0.01, 0.04, 0.02), box(0.02, 0.03, 0.03, 0.05)]
    regions: list[BaseGeometry] = [Polygon()] * 3
    regions[wall] = shapely.MultiPolygon(shapes) & panel_outline(pattern, wall)
    assert [p.attached for p in find_pieces(pattern, regions)] == [True, False]
    regions[tip] = panel_outline(pattern, tip)
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
    region = panel_outline(pattern, 0)
    assert len(region.interiors) == 1
    assert not find_holes(pattern, [region])
    assert clean(pattern, [region], 1.0, 1.0).regions[0].equals(region)


def test_printed_cells(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 3e-3)
    values = np.random.default_rng(4).uniform(0, 1, len(pattern.panel))
    at_points = np.random.default_rng(5).uniform(0, 1, len(pattern.flat_points))
    regions = printed_regions(pattern, at_points, values, 0.5)
    assert np.array_equal(printed_cells(pattern, regions), values > 0.5)


def test_limits_must_be_positive() -> None:
    assert PrintLimits(width=0.8e-3, gap=0.4e-3).resolution == pytest.approx(0.02e-3)
    with pytest.raises(ParameterError, match="gap = 0"):
        PrintLimits(gap=0)


# The whole


def scene(pattern: Pattern, length: float) -> list[BaseGeometry]:
    """Ribs of 3 mm on a spine, with one flaw of each kind; the caps printed all over.

    A neck of 0.4 mm, a bar that leaves 0.45 mm to the next rib, a hole, an island between ribs.
    """
    ribs = [box(8, y, 55, y + 3) for y in np.arange(8, length - 8, 10)]
    body = shapely.union_all([box(29, 4, 33, length - 4), *ribs])
    bites = [Point(18, 9.5 + sign * 3.2).buffer(3, 64) for sign in (-1, 1)]
    body = body.difference(shapely.union_all([*bites, Point(45, 19.5).buffer(0.35, 64)]))
    bar = box(48, 11, 51, 17.55)
    island = Point(16, 14.5).buffer(1.2, 64)
    caps = np.ones(len(pattern.flat_points)), np.ones(len(pattern.panel))
    regions = printed_regions(pattern, *caps, 0.5)
    regions[pattern.panel_index("wall")] = metres(shapely.union_all([body, bar, island]))
    return regions


def test_tube(comm: MPI.Comm, tmp_path: Path) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 2.85e-3)
    regions, limits = scene(pattern, 40), PrintLimits()
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
    picture = tmp_path / "manufacture.png"
    plot_printability(picture, pattern, regions, found, limits)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_lines_of_a_field(comm: MPI.Comm) -> None:
    """A field linear across slanted lines keeps their widths and gaps, cut by the seam or not."""
    pattern = cylinder(comm, 0.08, 0.02, 1.5e-3, caps=False)
    along = np.array([np.sin(0.3), np.cos(0.3)])

    def density(points: np.ndarray) -> np.ndarray:
        return 0.5 + 40 * (0.002 - np.abs((points @ along) % 0.01 - 0.005))

    found = printability(pattern, regions_of(pattern, density))
    assert found.smallest_width is not None
    assert found.smallest_gap is not None
    # At the ridges of the field the mesh rounds; the contours lie in its linear parts.
    assert found.smallest_width.width == pytest.approx(4e-3, rel=1e-3)
    assert found.smallest_gap.width == pytest.approx(6e-3, rel=1e-3)


def test_large_patterns(comm: MPI.Comm) -> None:
    """Every triangle is handled by arrays: 48 000 of them take no longer than a moment."""
    pattern = square(n=155, size=0.05)
    wave = 2 * np.pi / 0.01
    regions = regions_of(pattern, lambda p: 0.3 + np.sin(wave * p[:, 0]) * np.sin(wave * p[:, 1]))
    found = printability(pattern, regions)
    assert found.pieces == 50
    assert found.smallest_gap is not None
    # Along the diagonal through a saddle: sin² = 0.2 on either side.
    saddle = 2 * np.sqrt(2) * np.arcsin(np.sqrt(0.2)) / wave
    assert found.smallest_gap.width == pytest.approx(saddle, rel=0.02)
    assert printed_cells(pattern, regions).mean() == pytest.approx(
        sum(region.area for region in regions) / 0.05**2, rel=1e-2
    )
