"""Centre lines: phases whose stripes follow directions, and their level lines."""

import numpy as np
import pytest
from helpers.lines import even_field, largest_jump
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import Stripes, Waves, find_stripes, trace
from toros_fem.design.lines.field import LineMesh, make_line_mesh
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.meshes import cylinder
from toros_fem.meshes.sheets import disc, rectangle
from toros_fem.meshes.triangles import following

SPACING = 5e-3


def waves_of(mesh: LineMesh, angle: np.ndarray) -> Waves:
    """Even spacing along directions in triangles."""
    double = mesh.double_angles(angle, np.ones(len(angle)))
    return Waves(mesh, np.angle(double) / 2, np.full(mesh.size, 2 * np.pi / SPACING))


def around_triangles(mesh: LineMesh, stripes: Stripes) -> np.ndarray:
    """Change of the phase around each triangle in turns, in the orientation of its first corner."""
    edges = mesh.edges
    start = mesh.vertex
    total, sign = np.zeros(len(start)), np.ones(len(start))
    for side in range(3):
        edge = edges.of_triangle[:, side]
        forward = edges.ends[edge, 0] == start[:, side]
        flip = np.where(stripes.same[edge], 1.0, -1.0)
        total += sign * np.where(forward, 1.0, -flip) * stripes.change[edge]
        sign *= flip
    return total / (2 * np.pi)


def test_parallel_stripes_fit_exactly() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.03, 2e-3, "unstructured")
    mesh = make_line_mesh(sheet, np.ones(len(sheet.panel), dtype=bool))
    waves = waves_of(mesh, np.full(len(sheet.panel), 0.5))
    stripes = find_stripes(waves, np.ones(mesh.size))
    assert np.abs(stripes.change - stripes.wanted).max() < 1e-9
    across = sheet.points[:, :2] @ [-np.sin(0.5), np.cos(0.5)]
    i, j = mesh.edges.ends.T
    found = np.abs(stripes.change) * SPACING / (2 * np.pi)
    vertex = np.empty(mesh.size, dtype=int)
    vertex[mesh.vertex] = sheet.triangles
    assert np.allclose(found, np.abs(across[vertex[j]] - across[vertex[i]]), atol=1e-12)


@pytest.mark.parametrize("degrees", [20.0, 33.0, 90.0])
def test_helices_close_with_whole_turns(degrees: float) -> None:
    """Whatever the angle, no line ends; the misfit is spread evenly."""
    tube = cylinder(MPI.COMM_SELF, 0.1, 0.02, 2e-3)
    mesh = make_line_mesh(tube, tube.panel == tube.panel_index("wall"))
    waves = waves_of(mesh, np.full(len(mesh.cells), np.radians(degrees)))
    stripes = find_stripes(waves, np.ones(mesh.size))
    assert np.abs(around_triangles(mesh, stripes)).max() < 1e-9
    half = mesh.edges.twins[:, 0]
    flat = mesh.corners.reshape(-1, 2)
    along = flat[following(half)] - flat[half]
    along[mesh.vertex.ravel()[half] != mesh.edges.ends[:, 0]] *= -1
    assert stripes.same.all()
    slope, rest, *_ = np.linalg.lstsq(along, stripes.change, rcond=None)
    assert np.sqrt(rest[0] / len(along)) < 1e-3
    perimeter = np.ptp(tube.corners[mesh.cells][..., 0])
    turns = perimeter * slope[0] / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-3)
    assert turns == pytest.approx(-perimeter * np.sin(np.radians(degrees)) / SPACING, abs=0.5)
    along_axis = 2 * np.pi / SPACING * np.cos(np.radians(degrees))
    assert slope[1] == pytest.approx(along_axis, rel=1e-2, abs=0.1)


def test_directions_around_a_point_end_lines_in_few_triangles() -> None:
    """Rays need more lines outside than inside: each end is one whole turn around a triangle."""
    sheet = disc(MPI.COMM_SELF, 0.02, 1.5e-3)
    mesh = make_line_mesh(sheet, np.ones(len(sheet.panel), dtype=bool))
    angle = np.arctan2(sheet.centroids[:, 1], sheet.centroids[:, 0])
    stripes = find_stripes(waves_of(mesh, angle), np.ones(mesh.size))
    regular = stripes.same[mesh.edges.of_triangle].sum(axis=1) % 2 == 1
    turns = around_triangles(mesh, stripes)[regular]
    assert np.abs(turns - np.round(turns)).max() < 1e-9
    assert 5 < np.abs(np.round(turns)).sum() < 40


def stripes_of(mesh: LineMesh, phase: np.ndarray) -> Stripes:
    i, j = mesh.edges.ends.T
    change = phase[j] - phase[i]
    even = np.ones(mesh.size)
    waves = Waves(mesh, even, even)
    return Stripes(waves, phase, change, np.ones(len(change), dtype=bool), change)


def test_level_lines_of_a_linear_phase_are_straight() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.03, 2e-3, "unstructured")
    mesh = make_line_mesh(sheet, np.ones(len(sheet.panel), dtype=bool))
    vertex = np.empty(mesh.size, dtype=int)
    vertex[mesh.vertex] = sheet.triangles
    way = 2 * np.pi / 0.7e-3 * np.array([0.6, 0.8])  # several lines on each edge
    phase = sheet.points[vertex, :2] @ way + 0.1
    lines = trace(stripes_of(mesh, phase), np.ones(len(mesh.edges.ends), dtype=bool))
    levels = []
    for line in lines:
        level = (line.points @ way + 0.1) / (2 * np.pi)
        assert np.abs(level - np.round(level[0, 0])).max() < 1e-9
        assert np.allclose(line.points[1:, 0], line.points[:-1, 1], rtol=0, atol=1e-15)
        assert not line.closed
        levels.append(round(level[0, 0]))
    low, high = np.floor(phase.min() / (2 * np.pi)), np.floor(phase.max() / (2 * np.pi))
    assert sorted(levels) == list(range(int(low) + 1, int(high) + 1))
    none = trace(stripes_of(mesh, phase), np.zeros(len(mesh.edges.ends), dtype=bool))
    assert none == []


def test_hoops_around_a_tube_are_closed() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.04, 0.02, 2e-3)
    wall = tube.panel == tube.panel_index("wall")
    laid = lay_lines(even_field(tube, [0.2], [0.0]), printed=~wall)
    perimeter = np.ptp(tube.corners[wall][..., 0])
    assert all(line.closed for line in laid.families[0].lines)
    lengths = [line.length for line in laid.families[0].lines]
    assert lengths == pytest.approx([perimeter] * 9, abs=1e-8)
    assert largest_jump(laid) < 1e-9
