import numpy as np
import pytest
from helpers.lines import even_field, positions
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import CentreLine, LinesOfFamily
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.lay_lines import lay_lines, make_symmetry
from toros_fem.meshes import cylinder, mirrored
from toros_fem.meshes.pattern import Pattern

HALF = cylinder(MPI.COMM_SELF, 0.08, 0.02, 2.5e-3, planes=(1,))
QUARTER = cylinder(MPI.COMM_SELF, 0.08, 0.02, 2.5e-3, planes=(0, 1))
WIDTHS = (0.9e-3, 0.9e-3)


def wall_of(part: Pattern) -> np.ndarray:
    return part.panel == part.panel_index("wall")


def at_plane(laid: LaidLines, family: int, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights at which lines of a family meet a plane, sorted, and their slopes there."""
    height, slope = [], []
    for line in laid.families[family].lines:
        at = positions(laid.mesh, line)
        for side, kind in enumerate(line.ends):
            end = at[0 if side == 0 else -1]
            if kind == "plane" and abs(end[side, axis]) < 1e-9:
                way = end[1 - side] - end[side]
                height.append(end[side])
                slope.append(way[2] / np.linalg.norm(way))
    order = np.lexsort(np.round(np.transpose(height), 6))
    return np.array(height)[order], np.array(slope)[order]


def test_families_that_cross_a_plane_are_paired() -> None:
    active = wall_of(HALF)
    net = make_symmetry(even_field(HALF, [0.2, 0.2], [30, -30]), active, (1,), WIDTHS)
    assert net.partner.tolist() == [[0, 1], [1, 0]]
    assert net.first(1) == (0, 1)
    grid = make_symmetry(even_field(HALF, [0.2, 0.2], [0, 90]), active, (1,), WIDTHS)
    assert grid.partner.tolist() == [[0, 1], [0, 1]]
    alike = make_symmetry(even_field(HALF, [0.2, 0.2], [20, 20]), active, (1,), WIDTHS)
    assert alike.partner.tolist() == [[0, 1], [0, 1]], "none is changed for one that fits as well"
    apart = make_symmetry(even_field(HALF, [0.2, 0.2], [30, -30]), active, (1,), (1e-3, 2e-3))
    assert apart.partner.tolist() == [[0, 1], [0, 1]], "a line keeps its width"
    many = make_symmetry(even_field(HALF, [0.05] * 10, [20] * 10), active, (1,), [1e-3] * 10)
    assert many.partner[1].tolist() == list(range(10)), "soon, too"
    active = wall_of(QUARTER)
    degrees = [30, 90, -30]
    three = make_symmetry(even_field(QUARTER, [0.2] * 3, degrees), active, (0, 1), [1e-3] * 3)
    assert three.partner.tolist() == [[0, 1, 2], [2, 1, 0], [2, 1, 0], [0, 1, 2]]


def test_all_images_of_an_octant_return_to_it() -> None:
    """Points of lines and values at vertices, from the eight faces of an octahedron."""
    flat = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(3) / 2]])
    corners = np.arange(3)
    points = np.eye(3) / np.sqrt(2)
    octant = Pattern(flat, corners[None], np.zeros(1, int), corners, points, ("face",))
    found = make_symmetry(even_field(octant, [0.2], [0]), np.ones(1, bool), (0, 1, 2), [0.1])
    whole = mirrored(octant, (0, 1, 2)).pattern
    places = np.abs(whole.points[whole.triangles[found.whole.cells]])
    values = np.empty(found.whole.size)
    values[found.whole.vertex] = places @ [1.0, 2.0, 3.0]
    own = octant.points[octant.triangles[found.part.cells]] @ [1.0, 2.0, 3.0]
    for image in range(8):
        cell = np.array([image])
        line = CentreLine(cell, found.whole.flat[cell, :2])
        # Along the part's first side, which runs backwards in mirror images.
        a, b, c = found.whole.flat.T
        odd = [number.bit_count() % 2 for number in range(8)]
        angles = np.tile(np.angle(np.where(odd, b - c, b - a))[:, None], 3)
        family = LinesOfFamily(0.1, [line], angles, values, 2 * values, (0.01, 3 * values))
        moved = found.to_part(family, image)
        for factor, there in enumerate((moved.spacing, moved.radius, moved.bounds[1]), 1):
            assert there[found.part.vertex] == pytest.approx(factor * own)
        assert np.abs(np.sin(moved.angles)).max() < 1e-12
        (back,) = moved.lines
        assert positions(found.part, back)[0] == pytest.approx(places[image, :2], abs=1e-12)


@pytest.mark.parametrize(("part", "planes"), [(HALF, (1,)), (QUARTER, (0, 1))])
def test_a_net_runs_on_straight_across_planes(part: Pattern, planes: tuple[int, ...]) -> None:
    """A line of one family that meets the plane is the mirror image of one of the other."""
    wall = wall_of(part)
    laid = lay_lines(even_field(part, [0.2, 0.2], [30, -30]), printed=~wall, planes=planes)
    for axis in planes:
        one, two = at_plane(laid, 0, axis), at_plane(laid, 1, axis)
        assert len(one[0]) > 5
        assert np.allclose(one[0], two[0], rtol=0, atol=1e-9)
        assert np.allclose(one[1], -two[1], rtol=0, atol=1e-6)
    for family in laid.families:
        assert set(family.ends) <= {"plane", "printed"}
        assert family.laid == pytest.approx(0.2, abs=5e-3)


def test_planes_are_in_the_middle_of_lines_or_of_gaps() -> None:
    """Axial lines are symmetric either way; a strip in a plane is printed up to the plane."""
    wall = wall_of(HALF)
    found = set()
    for share in (0.12, 0.15, 0.16, 0.2):
        laid = lay_lines(even_field(HALF, [share], [90]), printed=~wall, planes=(1,))
        across = laid.pattern.corners[laid.pattern.panel == 0][..., 0]
        places = np.sort([line.points[:, :, 0].mean() for line in laid.families[0].lines])
        step = np.diff(places).mean()
        assert np.ptp(np.diff(places)) < 1e-7
        for off in (places[0] - across.min(), across.max() - places[-1]):
            assert min(abs(off), abs(off - step / 2)) < 1e-7
            found.add(bool(abs(off) < 1e-7))
        assert laid.families[0].laid == pytest.approx(share, abs=1e-3)
    assert found == {True, False}


def test_hoops_meet_their_own_image() -> None:
    wall = wall_of(HALF)
    field = even_field(HALF, [0.15], [20])
    laid = lay_lines(field, printed=~wall, planes=(1,))
    assert laid.families[0].ends["plane"] >= 2 * (len(laid.families[0].lines) - 4)
    _, slope = at_plane(laid, 0, 1)
    assert np.abs(slope).max() < np.sin(np.radians(10)), "bent round towards the plane"
