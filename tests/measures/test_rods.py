"""Cross-sections as a rod: strains of known shapes, and shapes of given strains."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.measures.cross_sections import label_cross_sections, rod_of
from toros_fem.meshes import bend, compose, cylinder, twist

LENGTH, COUNT = 0.06, 6
TUBE = cylinder(MPI.COMM_SELF, LENGTH, 0.02, 2e-3)
LABELS = label_cross_sections(TUBE, TUBE.vertices_of("wall"), (0, 0, 1), COUNT)


def test_a_bend_has_one_curvature_and_a_twist_one_rate() -> None:
    bent = rod_of(TUBE, LABELS, bend(1.2, LENGTH)(TUBE.points)).strains
    assert bent[1:-1, 1] == pytest.approx(1.2 / LENGTH, rel=0.02)
    assert bent[:, [0, 2]] == pytest.approx(0, abs=0.4)
    # The chord of an arc is shorter, and a slab's mean lies inside of its arc.
    assert bent[1:-1, 5] == pytest.approx(1, abs=0.03)
    twisted = rod_of(TUBE, LABELS, twist(2.0, LENGTH)(TUBE.points)).strains
    assert twisted[1:-1, 2] == pytest.approx(2.0 / LENGTH, rel=0.02)


def test_strains_make_the_shape_that_has_them() -> None:
    shape = compose(twist(1.0, LENGTH), bend(1.5, LENGTH, neutral=0.01))(TUBE.points)
    rod = rod_of(TUBE, LABELS, shape)
    again = rod.strained(rod.strains)
    assert again.centres == pytest.approx(rod.centres, abs=1e-12)
    assert again.frames == pytest.approx(rod.frames, abs=1e-12)
    more = rod.strains + np.array([3.0, -2.0, 5.0, 0.01, 0.0, 0.03])
    assert rod.strained(more).strains == pytest.approx(more, abs=1e-9)


def test_vertices_are_carried_with_their_cross_sections() -> None:
    rod = rod_of(TUBE, LABELS, TUBE.points)
    other = rod.strained(rod.strains + np.array([0.0, 10.0, 4.0, 0.0, 0.0, 0.05]))
    moved = rod.carried(LABELS, TUBE.points, other)
    found = rod_of(TUBE, LABELS, moved)
    assert found.centres == pytest.approx(other.centres, abs=1e-12)
    assert found.frames == pytest.approx(other.frames, abs=1e-9)
    outside = LABELS < 0
    assert outside.any()
    assert np.array_equal(moved[outside], TUBE.points[outside])
