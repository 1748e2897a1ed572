"""Ribbons along lines, and smooth changes of lines that were laid."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely
from helpers.lines import even_field, positions, seam_difference, turned_halves
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.design.lines.field import LineField, LineMesh, LineOptions, coordinates
from toros_fem.design.lines.laid_lines import (
    Joint,
    LaidLines,
    LineChange,
    SmoothChanges,
    _warped,
    change_between,
    changed,
    cleaned,
    print_borders,
    ribbons,
    smooth_fields,
    smooth_functions,
)
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.meshes import cylinder
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.panels import border_motion
from toros_fem.meshes.sheets import rectangle

WIDTH = 0.6e-3
SIDE = 0.04


def ribbon(
    nodes: np.ndarray, radii: float | np.ndarray, joints: Sequence[Joint] = ()
) -> list[BaseGeometry]:
    """Regions of two panels; the line is on the first."""
    points = np.stack([nodes[:-1], nodes[1:]], axis=1)
    radius = np.broadcast_to(radii, len(nodes))
    both, margin = np.stack([radius[:-1], radius[1:]], axis=1), 3 * WIDTH + 1e-3
    return ribbons(np.zeros(len(points), int), points, both, list(joints), margin, 2)


def region_of(nodes: np.ndarray, radii: float | np.ndarray) -> BaseGeometry:
    return ribbon(nodes, radii)[0]


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0])
def test_a_straight_ribbon_is_exactly_as_wide_as_asked(angle: float) -> None:
    """Whatever its direction; its ends are half circles."""
    nodes = np.stack([np.linspace(0, 0.03, 7), np.full(7, 0.002)], axis=1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    region = shapely.transform(region_of(nodes @ turn.T, 1e-3), lambda points: points @ turn)
    assert region.bounds == pytest.approx((-1e-3, 1e-3, 0.031, 3e-3), abs=1e-12)


def test_a_ribbon_widens_evenly() -> None:
    nodes = np.stack([np.linspace(0, 0.03, 31), np.zeros(31)], axis=1)
    slope = 1 / 30
    region = region_of(nodes, 0.5e-3 + slope * nodes[:, 0])
    for x, radius in ((0.01, 5 / 6 * 1e-3), (0.02, 7 / 6 * 1e-3)):
        cut = region.intersection(shapely.LineString([(x, -1), (x, 1)]))
        assert 2 * radius < cut.length + 1e-12
        assert cut.length < 2 * radius / np.sqrt(1 - slope**2) + 1e-12, "that of round ends"


@pytest.mark.parametrize("beyond", [0.0, 2.9e-3, 10e-3])
def test_a_ribbon_runs_on_across_a_joint(beyond: float) -> None:
    """Its part near the joint comes with the joint's motion, a quarter turn; no other does."""
    turn, shift = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([0.1, 0.2])
    edge = np.array([[[0.03, -0.01], [0.03, 0.01]]])
    joint = Joint(1, 0, edge, turn[None], shift[None])
    x = 0.03 + beyond + np.linspace(0, 0.02, 3)
    nodes = np.stack([x, np.full(3, 0.002)], axis=1)
    found = ribbon(nodes, 1e-3, [joint])[1]
    if beyond > 3 * WIDTH + 1e-3:
        assert found.is_empty
        return
    expected = region_of(nodes[:2] @ turn.T + shift, 1e-3)
    assert found.symmetric_difference(expected).area < 1e-12
    assert ribbon(nodes, 1e-3, [Joint(0, 0, edge, turn[None], shift[None])])[1].is_empty


def test_a_sharp_turn_is_round() -> None:
    nodes = np.array([[0, 0], [0.02, 0], [0.02, 0.001], [0, 0.001]])
    region = region_of(nodes, 1e-3)
    line = shapely.LineString(nodes).buffer(1e-3, quad_segs=32)
    assert region.symmetric_difference(line).area < 0.004 * line.area  # 0.0036 seen


def test_no_line_and_no_gap_is_left_that_is_too_thin() -> None:
    def bar(x: float, width: float) -> shapely.Polygon:
        return shapely.box(x, 0, x + width, 0.02)

    thin, near = bar(0.0, 0.9 * WIDTH), bar(0.01 + 1.9 * WIDTH, 2 * WIDTH)
    wide = bar(0.01, 1.1 * WIDTH)
    region = cleaned(shapely.union_all([thin, wide, near]), WIDTH, 0.5e-6)
    assert len(shapely.get_parts(region)) == 1, "the thin one is gone, the others are one"
    assert region.area == pytest.approx(0.02 * 3.9 * WIDTH, rel=1e-2)
    assert cleaned(bar(0.0, 1.01 * WIDTH), WIDTH, 0.5e-6).is_empty
    assert not cleaned(bar(0.0, 1.02 * WIDTH), WIDTH, 0.5e-6).is_empty
    ring = shapely.Point(0, 0).buffer(3e-3).difference(shapely.Point(0, 0).buffer(0.39e-3))
    assert len(cleaned(ring, WIDTH, 0.5e-6).interiors) == 0
    assert len(cleaned(ring, WIDTH, 0.4e-6).interiors) == 1
    assert cleaned(shapely.Point(0, 0).buffer(0.35e-3), WIDTH, 0.5e-6).is_empty


@pytest.fixture(scope="module")
def lines() -> LaidLines:
    """Lines along y, 1 mm wide, and 5 mm apart."""
    sheet = rectangle(MPI.COMM_SELF, SIDE, SIDE, 2e-3, "unstructured")
    return lay_lines(even_field(sheet, [0.2], [90.0]), LineOptions(widths=(1e-3,)))


def of_widths(lines: LaidLines, logarithm: float) -> LineChange:
    """A change of all widths by the same factor."""
    size = lines.mesh.size
    return LineChange(np.full((len(lines.families), size), logarithm), np.zeros(size, complex))


def places(mesh: LineMesh) -> np.ndarray:
    """Vertices of a mesh of one panel, as x + iy, (n,)."""
    found = np.zeros(mesh.size, dtype=complex)
    found[mesh.vertex] = mesh.corners @ [1, 1j]
    return found


def warped(lines: LaidLines, way: Callable[[np.ndarray], np.ndarray]) -> LineChange:
    """A change that moves lines by a function of x + iy."""
    return LineChange(np.zeros((1, lines.mesh.size)), way(places(lines.mesh)))


def largest_jump(lines: LaidLines) -> float:
    """Largest distance on the skin from the end of a moved segment to the start of the next."""
    jumps = [0.0]
    for line in lines.families[0].lines:
        moved = replace(line, places=_warped(lines, line) @ np.array([1, 1j]))
        at = positions(lines.mesh, moved)
        jumps += np.linalg.norm(at[1:, 0] - at[:-1, 1], axis=1).tolist()
    return max(jumps)


def test_smooth_functions_are_those_of_a_square(lines: LaidLines) -> None:
    """Eigenvalues (π/a)² (i² + j²); the functions are orthonormal."""
    mesh = lines.mesh
    found = smooth_functions(mesh, 6)
    weight = mesh.vertex_areas / mesh.vertex_areas.sum()
    assert np.allclose(found.T @ (weight[:, None] * found), np.eye(6), atol=1e-8)
    energy = found.T @ (mesh.laplacian(mesh.weights) @ found)
    values = energy.diagonal() / mesh.vertex_areas.sum()
    expected = (np.pi / SIDE) ** 2 * np.array([0, 1, 1, 2, 4, 4])
    assert values == pytest.approx(expected, rel=0.03, abs=1e-6)


def test_smooth_fields_are_those_of_a_square_that_is_held(lines: LaidLines) -> None:
    """Eigenvalues (π/a)² (i² + j²), i, j ≥ 1, of either component; 0 at the border."""
    mesh = lines.mesh
    found = smooth_fields(mesh, 6, ())
    energy = (found.conj().T @ (mesh.laplacian(mesh.weights) @ found)).real
    weight = mesh.vertex_areas / mesh.vertex_areas.sum()
    values = energy.diagonal() / (weight @ np.abs(found) ** 2) / mesh.vertex_areas.sum()
    assert values == pytest.approx((np.pi / SIDE) ** 2 * np.array([2, 2, 5, 5, 5, 5]), rel=0.05)
    assert weight @ np.abs(found) ** 2 == pytest.approx(1.0, rel=1e-6)
    border = mesh.edges.ends[mesh.edges.border]
    assert np.all(found[border] == 0)


def test_smooth_fields_slide_in_symmetry_planes() -> None:
    """On half a tube whose border lies in the plane y = 0 they are along z there, and not 0."""
    half = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3, planes=(1,))
    wall = half.panel == half.panel_index("wall")
    mesh = lay_lines(
        even_field(half, [0.3], [90.0]), LineOptions(widths=(1e-3,)), printed=~wall, planes=(1,)
    ).mesh
    found = smooth_fields(mesh, 8, (1,))
    points = np.zeros((mesh.size, 3))
    pattern = mesh.pattern
    points[mesh.vertex] = pattern.points[pattern.triangles[mesh.cells]]
    inner = (points[:, 2] > 1e-6) & (points[:, 2] < 0.06 - 1e-6)
    plane = (np.abs(points[:, 1]) < 1e-9) & inner
    # The wall's chart has its second axis along the tube.
    assert np.abs(found[plane].real).max() < 1e-9
    assert np.abs(found[plane].imag).max() > 0.5
    assert np.all(found[~inner] == 0)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_widths_change_and_lines_stay(lines: LaidLines, factor: float) -> None:
    other = changed(lines, of_widths(lines, np.log(factor)))
    assert other.area == pytest.approx(factor * lines.area, rel=5e-3)  # the ends of lines are round
    assert other.families[0].length == lines.families[0].length
    wide = changed(lines, of_widths(lines, 2.0))
    assert wide.area == pytest.approx(1.5 * lines.area, rel=0.02), "the largest width"
    least = np.log(1.5**2)  # from the largest to the least
    for asked, expected in ((0.1, 0.0), (-0.1, -0.1), (-3.0, -least)):
        after = changed(wide, of_widths(wide, asked), draw=False)
        assert np.allclose(change_between(wide, after).widths, expected, atol=1e-6)


def test_a_warp_moves_lines_and_keeps_their_widths(lines: LaidLines) -> None:
    moved = changed(lines, warped(lines, lambda z: np.full(len(z), 0.7e-3 + 0j)))
    inside = shapely.box(5e-3, 5e-3, SIDE - 5e-3, SIDE - 5e-3)
    expected = shapely.affinity.translate(lines.regions[0], 0.7e-3, 0.0)
    off = shapely.symmetric_difference(expected, moved.regions[0]).intersection(inside)
    assert off.area < 2e-3 * lines.area
    back = changed(moved, warped(moved, lambda z: np.full(len(z), -0.7e-3 + 0j)))
    off = shapely.symmetric_difference(lines.regions[0], back.regions[0])
    assert off.area < 1e-3 * lines.area


def test_lines_that_come_nearer_get_thinner_for_their_gap(lines: LaidLines) -> None:
    """Lines of 0.9 mm with gaps of 0.65 mm are squeezed by 0.15: they give way, and gaps stay."""
    options = LineOptions(widths=(0.9e-3,), spread=1.5)
    dense = lay_lines(even_field(lines.pattern, [0.58], [90.0]), options)
    close = changed(dense, warped(dense, lambda z: -0.15 * (z.real - SIDE / 2) + 0j))
    inside = shapely.box(8e-3, 8e-3, SIDE - 8e-3, SIDE - 8e-3)
    bare, least = inside.difference(close.regions[0]), options.print_width
    spacing = 0.9 / 0.58 * 0.85
    assert bare.area == pytest.approx(1.03 * 0.6 / spacing * inside.area, rel=0.06)
    wide = bare.buffer(-least / 2).buffer(least / 2 * 1.01)
    assert bare.difference(wide).area < 0.03 * bare.area  # corners; a gap has a twentieth
    middle = np.abs(places(close.mesh) - SIDE / 2 * (1 + 1j)) < 8e-3
    expected = (spacing - 1.03 * 0.6) * 1e-3 / 2
    assert close.families[0].radius[middle] == pytest.approx(expected, rel=0.02)


def test_warped_lines_go_on_across_seams() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3)
    wall = tube.panel == tube.panel_index("wall")
    laid = lay_lines(even_field(tube, [0.25], [20.0]), LineOptions(widths=(1e-3,)), printed=~wall)
    fields = smooth_fields(laid.mesh, 6, ())
    way = np.asarray(fields @ np.array([0.5, -0.3, 0.2, 0.4, 0.1, 0.3]))
    way *= 1.2e-3 / np.abs(way).max()
    moved = changed(laid, LineChange(np.zeros((1, laid.mesh.size)), way))
    assert moved.area == pytest.approx(laid.area, rel=0.02)
    apart, whole = seam_difference(moved, tube.panel_index("wall"))
    assert apart < 0.05 * whole
    off = shapely.symmetric_difference(moved.regions[0], laid.regions[0]).area
    off += shapely.symmetric_difference(moved.regions[1], laid.regions[1]).area
    assert off > 0.1 * laid.area


def test_a_warp_turns_with_the_charts() -> None:
    """Lines across the seam of two panels are still in one piece; the second chart is turned."""
    sheet = turned_halves(60.0)
    turn = np.where(sheet.panel == 1, np.radians(60.0), 0.0)[:, None]
    field = LineField(sheet, np.full((len(turn), 1), 0.2), turn + np.radians(30.0))
    laid = lay_lines(field, LineOptions(widths=(1e-3,)))
    way = smooth_fields(laid.mesh, 4, ()) @ np.array([1.0, 0.5, -0.4, 0.3])
    way = np.asarray(1.2e-3 / np.abs(way).max() * way)
    moved = changed(laid, LineChange(np.zeros((1, laid.mesh.size)), way))
    whole = np.sum(shapely.area(laid.regions))
    assert np.sum(shapely.area(moved.regions)) == pytest.approx(whole, rel=0.02)
    assert largest_jump(moved) < 1e-6
    off = shapely.symmetric_difference(moved.regions[0], laid.regions[0]).area
    assert off > 0.2 * laid.regions[0].area


def test_borders_of_the_print_follow_changes(lines: LaidLines) -> None:
    """Flat points at borders move by what widths and warp say, as those of the changed lines do."""
    fine = rectangle(MPI.COMM_SELF, SIDE, SIDE, 0.4e-3, "unstructured")
    finer, printed = bordered(MPI.COMM_SELF, fine, lines.regions)
    fine = finer.pattern
    normals = border_motion(fine, printed, 1e-6)
    borders = print_borders(lines, fine, [lines.families[0].under], printed, normals)

    def way(z: np.ndarray) -> np.ndarray:
        return 0.1e-3 * np.sin(np.pi * z.real / SIDE) * np.sin(np.pi * z.imag / SIDE) + 0j

    both = LineChange(of_widths(lines, 0.05).widths, warped(lines, way).warp)
    moves = borders.moves(both)
    after = changed(lines, both).regions[0]
    points, moving = fine.flat_points, np.any(moves != 0, axis=1)
    inside = np.all((points > 3e-3) & (points < SIDE - 3e-3), axis=1) & moving
    assert np.count_nonzero(inside) > 200
    before, now = (
        shapely.distance(region.boundary, shapely.points(at[inside]))
        for region, at in (
            (lines.regions[0], points),
            (after, points + moves),
        )
    )
    near = before < 0.02e-3
    assert np.count_nonzero(near) > 0.9 * len(near)
    assert np.quantile(now[near], 0.95) < 0.02e-3
    assert np.abs(coordinates(both.warp)).max() > 0.09e-3


def test_changes_are_combined_by_their_amounts(lines: LaidLines) -> None:
    mesh = lines.mesh
    changes = SmoothChanges(1, smooth_functions(mesh, 3), smooth_fields(mesh, 4, ()), (0.3, 1e-3))
    assert changes.size == 7
    amounts = np.linspace(0.0, 6.0, 7)
    whole, each = changes.change(np.asarray(amounts, dtype=np.float64)), list(changes.each())
    summed = sum(a * one.widths for a, one in zip(amounts, each, strict=True))
    assert np.allclose(whole.widths, summed)
    assert np.allclose(whole.warp, sum(a * one.warp for a, one in zip(amounts, each, strict=True)))
    half = whole.scaled(0.5)
    assert np.allclose(2 * half.widths, whole.widths)
    assert np.allclose(2 * half.warp, whole.warp)
