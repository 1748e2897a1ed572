from typing import Any

import numpy as np
import pytest
import shapely
from helpers.lines import even_field, largest_jump, positions, seam_difference, turned_halves
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import CentreLine, LinesOfFamily
from toros_fem.design.lines.field import LineField, LineOptions, make_line_mesh
from toros_fem.design.lines.laid_lines import LaidLines, with_regions
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.making.contours import measure_widths
from toros_fem.meshes import cylinder, walker
from toros_fem.meshes.sheets import one_panel, rectangle


@pytest.mark.parametrize("direction", [90.0, -90.0], ids=["same", "reversed"])
def test_lines_like_earlier_ones_keep_their_number(direction: float) -> None:
    """Shares fall by a fifth: the eight lines stay where they are, a fifth thinner."""
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.04, 2e-3, "unstructured")
    options = LineOptions(widths=(1e-3,))
    before = lay_lines(even_field(sheet, [0.2], [90.0]), options)
    field = even_field(sheet, [0.16], [direction])
    assert len(lay_lines(field, options).families[0].lines) < 8
    laid = lay_lines(field, options, like=before)
    there, here = (
        sorted(line.points[..., 0].mean() for line in each.families[0].lines)
        for each in (before, laid)
    )
    assert len(here) == 8
    assert np.allclose(here, there, atol=0.4e-3)
    assert laid.area == pytest.approx(0.8 * before.area, rel=0.03)


def test_lines_at_a_given_spacing_are_as_wide_as_their_share_asks() -> None:
    """Three along a tube, of a twelfth of its wall; the other family keeps its width."""
    tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 2e-3)
    caps = tube.panel != tube.panel_index("wall")
    around = np.pi * 0.02
    options = LineOptions(widths=(1e-3,), spacings=(around / 3, None))
    laid = lay_lines(even_field(tube, [1 / 12, 0.2], [90.0, 0.0]), options, printed=caps)
    along, across = laid.families
    assert len(along.lines) == 3
    assert along.width == pytest.approx(around / 36)
    assert along.laid == pytest.approx(1 / 12, rel=0.02)
    assert across.width == 1e-3
    thin = lay_lines(even_field(tube, [0.02, 0.2], [90.0, 0.0]), options, printed=caps)
    assert thin.families[0].width == options.print_width


def test_where_all_is_asked_for_gaps_are_left() -> None:
    """Lines of 2 mm keep their width, and lie apart by it and the least width of a gap."""
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.04, 2e-3, "unstructured")
    options = LineOptions(widths=(2e-3,))
    laid = lay_lines(even_field(sheet, [0.97], [90.0]), options)
    places = np.sort([line.points[..., 0].mean() for line in laid.families[0].lines])
    assert np.diff(places).min() == pytest.approx(2e-3 + options.print_width, rel=0.02)
    assert laid.families[0].laid == pytest.approx(len(places) * 2e-3 / 0.04, rel=1e-4)


def test_gaps_of_the_least_width_stay_open() -> None:
    """Lines of 0.9 mm with gaps of 0.6 mm: cleaning would close gaps that are no wider."""
    # It holds 28 whole lines, and its mesh is that of no version of gmsh.
    sheet = rectangle(MPI.COMM_SELF, 0.042, 0.042, 2e-3, "crossed")
    laid = lay_lines(even_field(sheet, [0.6], [90.0]))
    assert laid.area == pytest.approx(0.6 * sheet.areas.sum(), rel=0.02)


def test_cover_is_the_area_of_the_polygons() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 2e-3)
    caps = tube.panel != tube.panel_index("wall")
    field = even_field(tube, [0.2, 0.15], [30.0, 80.0])
    laid = lay_lines(field, printed=caps)
    cover = laid.cover(tube)
    assert np.all((cover >= 0) & (cover <= 1))
    assert np.allclose(cover[caps], 1.0, atol=1e-12)
    assert cover @ tube.areas == pytest.approx(laid.area, rel=1e-9)


@pytest.mark.parametrize("degrees", [37.0, -110.0])
def test_lines_run_on_across_a_seam_between_turned_charts(degrees: float) -> None:
    pattern = turned_halves(degrees)
    angle = np.radians(25.0 + degrees * pattern.panel)[:, None]
    laid = lay_lines(LineField(pattern, np.full((len(angle), 1), 0.2), angle))
    assert largest_jump(laid) < 1e-9
    sheet = [positions(laid.mesh, line) for line in laid.families[0].lines]
    across = np.array([-np.sin(np.radians(25)), np.cos(np.radians(25)), 0])
    assert max(np.ptp(at @ across) for at in sheet) < 1e-9
    panels = laid.pattern.panel[laid.mesh.cells]
    both = [len(np.unique(panels[line.cell])) for line in laid.families[0].lines]
    assert both.count(2) > 3
    apart, whole = seam_difference(laid)
    assert whole > 3e-3
    assert apart < 1e-3 * whole


def test_lines_run_on_across_curved_seams_of_mirrored_panels() -> None:
    """Charts of front and back turn by another angle at each edge."""
    skin = walker(MPI.COMM_SELF, 4e-3, planes=(0, 1))
    angle = np.where(skin.panel == 0, 1.0, -1.0)[:, None] * np.radians([33.0, -33.0])
    laid = lay_lines(LineField(skin, np.full(angle.shape, 0.2), angle), planes=(0, 1))
    assert largest_jump(laid) < 1e-9
    apart, whole = seam_difference(laid)
    assert whole > 0.03
    assert apart < 5e-3 * whole
    assert all(set(family.ends) <= {"plane", "line"} for family in laid.families)


FIELDS: dict[str, tuple[list[float], list[float], dict[str, Any]]] = {
    "wide and thin": ([0.25, 0.15], [85.0, 33.0], {"widths": (3e-3, 0.9e-3)}),
    "shallow": ([0.2, 0.2], [10.0, -8.0], {"widths": (0.8e-3,)}),
    "noisy": ([0.2, 0.2], [50.0, -50.0], {"even": 4e-3}),
}


@pytest.mark.parametrize("name", FIELDS)
def test_no_line_and_no_gap_is_thinner_than_can_be_printed(name: str) -> None:
    tube = cylinder(MPI.COMM_SELF, 0.04, 0.012, 2.5e-3)
    wall = tube.panel == tube.panel_index("wall")
    shares, degrees, settings = FIELDS[name]
    field = even_field(tube, shares, degrees)
    if name == "noisy":
        noise = np.random.default_rng(1).standard_normal(field.angles.shape)
        field = LineField(tube, field.shares * np.exp(0.3 * noise), field.angles + 0.6 * noise)
    options = LineOptions(**settings)
    laid = lay_lines(field, options, printed=~wall)
    panel = tube.panel_index("wall")
    limit = options.print_width
    outline = laid.pattern.outline(panel)
    # Slivers that the cut leaves of them are cleaned with the print.
    off_cut = outline.buffer(-limit)
    lines, gaps = measure_widths(
        laid.regions[panel], outline, panel, limit, limit, limit / 20, off_cut
    )
    assert lines.smallest is not None
    assert not lines.narrow
    assert not gaps.narrow
    for family, share in zip(laid.families, field.shares[wall].mean(axis=0), strict=True):
        assert family.laid == pytest.approx(share, rel=0.05)
    apart, whole = seam_difference_of_wall(laid)
    assert apart < 2e-3 * whole


def seam_difference_of_wall(laid: LaidLines) -> tuple[float, float]:
    """As `seam_difference`, without the rims of the printed caps."""
    return seam_difference(laid, laid.pattern.panel_index("wall"))


def test_few_wide_lines_go_around_evenly() -> None:
    """One and a half lines would fit around: two thinner ones, none of which ends."""
    tube = cylinder(MPI.COMM_SELF, 0.15, 0.02, 3e-3)
    wall = tube.panel == tube.panel_index("wall")
    height = tube.centroids[:, 1:] / 0.15
    shares = 0.095 + 0.02 * np.sin(7 * height)
    laid = lay_lines(
        LineField(tube, shares, np.radians(96.0 + 2 * height)),
        LineOptions(widths=(4e-3,)),
        printed=~wall,
    )
    assert laid.families[0].ends == {"printed": 2 * len(laid.families[0].lines)}
    assert laid.families[0].laid == pytest.approx(shares[wall].mean(), rel=0.03)


def test_a_wide_line_tapers_where_it_ends_on_a_thin_one() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.06, 0.05, 2.5e-3, "unstructured")
    x = sheet.centroids[:, 0]
    shares = np.stack([np.clip(0.5 - 10 * x, 0, 1), np.full(len(x), 0.15)], axis=1)
    angles = np.tile(np.radians([6.0, 80.0]), (len(x), 1))
    laid = lay_lines(LineField(sheet, shares, angles), LineOptions(widths=(3e-3, 0.8e-3)))
    ends = [
        line.points[0 if side == 0 else -1, side]
        for line in laid.families[0].lines
        for side, kind in enumerate(line.ends)
        if kind == "line"
    ]
    assert len(ends) > 1
    for x, y in ends:
        behind = shapely.box(x + 0.75e-3, y - 1e-3, x + 3e-3, y + 1e-3)
        assert laid.regions[0].intersection(behind).area < 0.05e-6, "a round end has 1 mm²"


def test_a_line_that_ends_on_itself_does_not_taper_to_another() -> None:
    """A thin line in the same triangle, far away, does not matter."""
    triangle = one_panel(np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.2]]), np.array([[0, 1, 2]]))
    mesh = make_line_mesh(triangle, np.ones(1, dtype=bool))
    end, along = 0.03 + 0.02j, np.exp(1j * np.radians(70))  # it comes back at 20°
    nodes = {
        1e-3: np.array([0.03, 0.03 + 0.06j, 0.04 + 0.06j, end + 0.03 * along, end]),
        0.4e-3: np.array([0.06, 0.06 + 0.04j]),
    }
    ones, families = np.ones(mesh.size), []
    for radius, places in nodes.items():
        segments = np.stack([places[:-1], places[1:]], axis=1)
        line = CentreLine(np.zeros(len(segments), dtype=int), segments, ("border", "line"))
        angles, bounds = np.zeros((1, 3)), (radius, radius * ones)
        families.append(LinesOfFamily(2 * radius, [line], angles, ones, radius * ones, bounds))
    lines = LaidLines(mesh, tuple(families), {}, (), LineOptions(), np.zeros(mesh.size, complex))
    beside = end + (0.4e-3 - 0.95e-3j) * along
    assert beside.real > 0.031, "not under the rest of the line"
    assert shapely.contains_xy(with_regions(lines).regions[0], beside.real, beside.imag)


def test_cover_of_another_mesh_is_that_of_the_same_panels() -> None:
    sheet, fine = (rectangle(MPI.COMM_SELF, 0.04, 0.03, edge) for edge in (2.5e-3, 0.9e-3))
    laid = lay_lines(even_field(sheet, [0.2], [33.0]))
    assert laid.cover(fine) @ fine.areas == pytest.approx(laid.area, rel=1e-9)
    inside = shapely.contains_xy(laid.regions[0], fine.centroids)
    assert np.corrcoef(inside, laid.cover(fine))[0, 1] > 0.85


def test_without_shares_nothing_is_laid() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.03, 2.5e-3)
    laid = lay_lines(even_field(sheet, [0.0], [33.0]))
    assert laid.area == 0
    assert len(laid.families[0].lines) == 0
    assert np.all(laid.cover(sheet) == 0)
    everything = lay_lines(even_field(sheet, [0.2], [0.0]), printed=np.ones(len(sheet.panel), bool))
    assert everything.area == pytest.approx(0.04 * 0.03, rel=1e-12)
    (family,) = everything.families
    assert (len(family.lines), family.laid, family.under[0].area) == (0, 0, 0)
