"""Cross-sections of a slender skin, and their rod."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.objectives import LENGTH, TARGET, tube_sections
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
    rod_of,
    section_vertices,
)
from toros_fem.meshes import Skin, bend, compose, cylinder, rectangle, sew, twist

ROD_LENGTH, COUNT = 0.06, 6
TUBE = cylinder(MPI.COMM_SELF, ROD_LENGTH, 0.02, 2e-3)
LABELS = label_cross_sections(TUBE, TUBE.vertices_of("wall"), (0, 0, 1), COUNT)


def test_sections_do_not_see_swelling(short_tube: Skin) -> None:
    """A section scaled about its centre line keeps its mean position and its orientation."""
    pattern = short_tube.pattern
    objective = CrossSectionObjective(short_tube, TARGET(pattern.points), tube_sections(short_tube))
    swollen = TARGET(pattern.points * [1.3, 1.3, 1.0])
    none = objective.forward(TARGET(pattern.points)[short_tube.owned_vertices])
    assert none == pytest.approx(0.0, abs=1e-15)
    small = objective.forward(swollen[short_tube.owned_vertices])
    plain = objective.forward(pattern.points[short_tube.owned_vertices])
    assert small < 1e-3 * plain


def test_a_whole_turn_is_not_zero(short_tube: Skin) -> None:
    """The tip of a tube twisted by 360° is where it was; the sections see the twist."""
    points = short_tube.pattern.points
    goal = tube_sections(short_tube)
    only = CrossSections(goal.labels, np.zeros((6, 3)), np.ones(6))
    objective = CrossSectionObjective(short_tube, twist(2 * np.pi, LENGTH)(points), only)
    values = [
        objective.forward(twist(fraction * 2 * np.pi, LENGTH)(points)[short_tube.owned_vertices])
        for fraction in (-0.2, 0.0, 0.2, 0.6, 1.0)
    ]
    assert all(np.diff(values) < 0)
    assert values[-1] < 1e-6 * values[0]


def test_small_turn_costs_as_documented(short_tube: Skin) -> None:
    points, angle = short_tube.pattern.points, 1e-3
    goal = tube_sections(short_tube)
    turn = np.zeros(6)
    turn[0] = 3.0  # the first section against how it is assembled: the whole tube is turned
    objective = CrossSectionObjective(
        short_tube, points, CrossSections(goal.labels, np.zeros((6, 3)), turn)
    )
    turned = points @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T
    found = objective.forward(turned[short_tube.owned_vertices])
    assert found == pytest.approx(0.5 * 3.0 * angle**2, rel=1e-5)


def test_sections_on_a_line_have_no_orientation(alone: MPI.Comm) -> None:
    """Slabs of a flat sheet with one row of vertices each; only positions may have weights."""
    pattern = rectangle(alone, 0.06, 0.02, 5e-3)
    skin = sew(alone, pattern)
    label = label_cross_sections(
        pattern, np.arange(len(pattern.points)), (1, 0, 0), 12, border=False
    )
    places, turns = np.ones((12, 3)), np.ones(12)
    with pytest.raises(errors.ParameterError, match=r"section 0 .* lies on a line.* Use fewer"):
        CrossSectionObjective(skin, pattern.points, CrossSections(label, places, turns))
    objective = CrossSectionObjective(skin, pattern.points, CrossSections(label, places, 0 * turns))
    moved = (pattern.points + [1e-3, 2e-3, 0])[skin.owned_vertices]
    assert objective.forward(moved) == pytest.approx(0.5 * 12 * 5e-6 / pattern.size**2)
    total = skin.gather_vertices(objective.backward(moved)).sum(axis=0)
    assert total == pytest.approx(12 * np.array([1e-3, 2e-3, 0]) / pattern.size**2)
    body = label_cross_sections(pattern, np.arange(len(pattern.points)), (1, 0, 0), 3, border=False)
    whole = CrossSectionObjective(skin, pattern.points, CrossSections(body, places[:3], turns[:3]))
    crushed = (pattern.points * [1, 0, 0])[skin.owned_vertices]
    for act in (whole.forward, whole.backward):
        with pytest.raises(errors.ParameterError, match="section 0 .* lies on a line"):
            act(crushed)


def test_labels(short_tube: Skin) -> None:
    """Slabs of equal length; the ring at the tip is one section more, unless there is none."""
    pattern = short_tube.pattern
    wall = pattern.vertices_of("wall")
    labels = label_cross_sections(pattern, wall, (0, 0, 1), 3)
    assert set(np.delete(labels, wall)) == {-1}
    height = pattern.points[wall, 2] / LENGTH
    expected = np.where(height > 1 - 1e-9, 3, np.minimum((height * 3).astype(int), 2))
    assert np.array_equal(labels[wall], expected)
    sizes = np.bincount(expected)
    assert [len(group) for group in section_vertices(labels)] == sizes.tolist()
    assert [len(group) for group in section_vertices(labels, sizes.max())] == [sizes.max()]
    plain = label_cross_sections(pattern, wall, (0, 0, 1), 3, border=False)
    assert plain.max() == 2


def test_a_bend_has_one_curvature_and_a_twist_one_rate() -> None:
    bent = rod_of(TUBE, LABELS, bend(1.2, ROD_LENGTH)(TUBE.points)).strains
    assert bent[1:-1, 1] == pytest.approx(1.2 / ROD_LENGTH, rel=0.02)
    assert bent[:, [0, 2]] == pytest.approx(0, abs=0.4)
    # The chord of an arc is shorter, and a slab's mean lies inside of its arc.
    assert bent[1:-1, 5] == pytest.approx(1, abs=0.03)
    twisted = rod_of(TUBE, LABELS, twist(2.0, ROD_LENGTH)(TUBE.points)).strains
    assert twisted[1:-1, 2] == pytest.approx(2.0 / ROD_LENGTH, rel=0.02)


def test_strains_make_the_shape_that_has_them() -> None:
    shape = compose(twist(1.0, ROD_LENGTH), bend(1.5, ROD_LENGTH, neutral=0.01))(TUBE.points)
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
