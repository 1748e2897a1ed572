import numpy as np
import pytest
from helpers.lines import even_field, largest_jump
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import Stripes, Waves, trace
from toros_fem.design.lines.field import LineMesh, make_line_mesh
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.meshes import cylinder
from toros_fem.meshes.makers.sheets import rectangle


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
