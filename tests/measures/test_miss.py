"""How far a shape is from its target; objectives behind a motion, and of a whole by its part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.objectives import LENGTH, TARGET
from helpers.runs import bent, tube
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
)
from toros_fem.measures.figures import State, Tolerances
from toros_fem.measures.miss import (
    AlignedObjective,
    MirroredObjective,
    is_of_shape,
    miss_of,
    shape_figures,
)
from toros_fem.measures.regions import Body, GapObjective
from toros_fem.measures.shape import Nodes, Objective, ShapeObjective, SumObjective
from toros_fem.meshes import Pattern, Skin, bend, compose, contract, cylinder, mirrored, sew, twist

BODY_LENGTH = 0.15
BENT = bend(0.7, LENGTH)


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    return tube()


def turned(axis: int, angle: float) -> np.ndarray:
    """Rotation about an axis by an angle in degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    one, two = [k for k in range(3) if k != axis]
    found = np.eye(3)
    found[one, one], found[one, two], found[two, one], found[two, two] = c, -s, s, c
    return found


def test_a_body_may_swell(pattern: Pattern) -> None:
    """A whole shift counts, and what is not compared does not."""
    target = pattern.points
    swollen = target * [1.5, 1.5, 1.0]
    assert miss_of(pattern, swollen, target).rms < 2e-4
    shifted = target + [0.003, 0.0, 0.004]
    found = miss_of(pattern, shifted, target)
    assert (found.rms, found.largest) == pytest.approx((5e-3, 5e-3))
    assert found.each == pytest.approx(5e-3)
    assert found.tip.distance == pytest.approx(5e-3)
    flat = miss_of(pattern, shifted, target, (True, True, False))
    assert flat.rms == pytest.approx(3e-3)
    assert flat.asked == pytest.approx(target + [0.0, 0.0, 0.004])


def test_end_plates_may_bulge(pattern: Pattern) -> None:
    cap = np.abs(pattern.points[:, 2] - BODY_LENGTH) < 1e-9
    radius = np.linalg.norm(pattern.points[:, :2], axis=1)
    dome = pattern.points + np.outer(cap * (0.01**2 - radius**2) / 0.01, [0.0, 0.0, 1.0])
    found = miss_of(pattern, dome, pattern.points)
    assert found.each.max() > 5e-3
    assert found.largest < 1e-12


def test_a_body_as_wide_as_long_is_compared_by_points(pattern: Pattern) -> None:
    wide = replace(pattern, points=pattern.points * [7.0, 7.0, 1.0])
    found = miss_of(wide, wide.points * [1.1, 1.1, 1.0], wide.points)
    assert not found.by_sections
    assert found.rms > 1e-3
    assert set(found.values()) == {
        "shape_distance_percent",
        "shape_distance_mm",
        "largest_distance_mm",
    }


def test_a_mesh_too_coarse_for_sections_is_compared_by_points() -> None:
    """A strip of two triangles has no cross-section of three vertices."""
    corners = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.01], [0.0, 0.01]])
    strip = Pattern(
        flat_points=corners,
        flat_triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        panel=np.zeros(2, dtype=int),
        sewn=np.arange(4),
        points=np.column_stack([corners, np.zeros(4)]),
        panel_names=("strip",),
    )
    shifted = strip.points + [0.0, 0.0, 1e-3]
    found = miss_of(strip, shifted, strip.points)
    assert not found.by_sections
    assert found.rms == pytest.approx(1e-3)
    assert miss_of(strip, shifted, strip.points, (True, True, False)).rms == 0


@pytest.mark.parametrize(
    ("axis", "angle", "in_plane", "lean"), [(1, 8.0, -8.0, 0.0), (2, 8.0, 0.0, 8.0)]
)
def test_the_tip_tells_bend_from_lean(
    pattern: Pattern, axis: int, angle: float, in_plane: float, lean: float
) -> None:
    """Of a bend by 90° in x-z; about y it bends less, about z it leans."""
    target = bend(np.pi / 2, BODY_LENGTH)(pattern.points)
    found = miss_of(pattern, target @ turned(axis, angle).T, target).values()
    assert found["tip_direction_deg"] == pytest.approx(angle)
    assert found["tip_direction_in_plane_deg"] == pytest.approx(in_plane, abs=1e-6)
    assert found["tip_direction_out_of_plane_deg"] == pytest.approx(lean, abs=1e-6)


def test_a_tip_that_bends_less_is_short(pattern: Pattern) -> None:
    target, less = (bend(np.radians(a), BODY_LENGTH)(pattern.points) for a in (90.0, 80.0))
    found = miss_of(pattern, less, target).values()
    assert found["tip_direction_in_plane_deg"] == pytest.approx(-10.0, abs=1e-6)
    assert found["tip_distance_mm"] == pytest.approx(
        1e3 * np.linalg.norm(tip_of(80.0) - tip_of(90.0)), rel=1e-6
    )


def tip_of(angle: float) -> np.ndarray:
    """The tip of the middle line, which keeps its length."""
    radius, turn = BODY_LENGTH / np.radians(angle), np.radians(angle)
    return np.array([radius * (1 - np.cos(turn)), 0.0, radius * np.sin(turn)])


def test_a_straight_target_has_no_plane(pattern: Pattern) -> None:
    target = twist(1.0, BODY_LENGTH)(pattern.points)
    leaning = target @ turned(1, 6.0).T
    found = miss_of(pattern, leaning, target).values()
    assert found["tip_direction_deg"] == pytest.approx(6.0)
    assert "tip_direction_out_of_plane_deg" not in found


def test_a_length_counts_only_where_it_is_asked_for(pattern: Pattern) -> None:
    """The outline of a twist follows the tube's length, and its direction counts still."""
    target = twist(1.0, BODY_LENGTH)(pattern.points)
    longer = compose(twist(1.0, BODY_LENGTH), contract(1.16))(pattern.points)
    free = miss_of(pattern, longer, target, (True, True, False))
    assert free.rms < 1e-12
    assert free.asked == pytest.approx(longer)
    asked = miss_of(pattern, longer, target)
    assert asked.tip.distance == pytest.approx(0.024)
    assert asked.asked == pytest.approx(target)
    leaning = longer @ turned(1, 6.0).T
    found = miss_of(pattern, leaning, target, (True, True, False))
    assert np.degrees(found.tip.direction) == pytest.approx(6.0, abs=0.1)


def test_two_figures_of_a_shape_decide(pattern: Pattern) -> None:
    """By the scene's tolerances; the others tell more."""
    target = bent(pattern, np.pi / 2)
    values = miss_of(pattern, bent(pattern, 1.5), target).values()
    widths = dict.fromkeys(values, 0.1)
    figures = shape_figures(values, widths)
    assert [f.key for f in figures if f.state] == ["shape_distance_percent", "tip_direction_deg"]
    assert {f.target for f in figures} == {0.0}
    assert {f.interval for f in figures} == {0.1}
    assert all(map(is_of_shape, figures))
    assert [f.state for f in figures[:2]] == [State.REACHED, State.REACHED]
    strict = shape_figures(values, widths, Tolerances(shape=0.01, direction=1.0))
    assert [f.state for f in strict[:2]] == [State.MISSED, State.MISSED]
    assert shape_figures({}) == ()


def test_alignment_removes_rigid_motions(short_tube: Skin) -> None:
    points = short_tube.pattern.points
    target = TARGET(points)
    aligned = AlignedObjective(short_tube, target, ShapeObjective(short_tube, target))
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    moved = (target @ turn.T + [0.1, 0.2, -0.3])[short_tube.owned_vertices]
    assert aligned.forward(moved) == pytest.approx(0.0, abs=1e-15)
    assert aligned.aligned(moved) == pytest.approx(target[short_tube.owned_vertices], abs=1e-12)
    plain = points[short_tube.owned_vertices]
    value = aligned.forward(plain)
    assert aligned.forward(plain @ turn.T + [1.0, 0, 0]) == pytest.approx(value, rel=1e-9)
    assert value <= ShapeObjective(short_tube, target).forward(plain) * (1 + 1e-12)
    gradient = short_tube.gather_vertices(aligned.backward(plain))
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    torque = np.cross(points, gradient).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(np.cross(points, gradient)).sum()


@pytest.fixture(scope="module")
def half(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, LENGTH, 0.02, 4.5e-3, planes=(1,)))


def all_terms(nodes: Nodes) -> Objective:
    """Every kind of objective at once, with weights that vary along the tube."""
    pattern = nodes.pattern
    target = BENT(pattern.points)
    rising = 1.0 + pattern.points[:, 2] / LENGTH
    labels = label_cross_sections(pattern, pattern.vertices_of("wall"), (0, 0, 1), 4)
    orientation: np.ndarray = np.arange(1.0, 6.0)
    sections = CrossSections(labels, np.tile([1.0, 2.0, 3.0], (5, 1)), orientation)
    return SumObjective(
        ShapeObjective(nodes, target, rising, rising),
        CrossSectionObjective(nodes, target, sections),
        GapObjective(nodes, Body("sphere", 0.02, (0.05, 0.0, 0.03)), rising, 0.1),
        AlignedObjective(nodes, target, ShapeObjective(nodes, target)),
    )


def shapes(half: Skin) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a bent and disturbed half, its cut in the plane; and those of the whole."""
    points = half.pattern.points
    moved = BENT(points) + 1e-3 * np.random.default_rng(3).standard_normal(points.shape)
    moved[points[:, 1] == 0, 1] = 0
    return moved, mirrored(half.pattern, (1,)).at_vertices(moved)


def test_value_and_gradient_are_those_of_the_whole(half: Skin, alone: MPI.Comm) -> None:
    images = mirrored(half.pattern, (1,))
    skin = sew(alone, images.pattern)
    here, there = shapes(half)
    one, other = MirroredObjective(half, images, all_terms), all_terms(skin)
    value = one.forward(here[half.owned_vertices])
    assert value == pytest.approx(other.forward(there[skin.owned_vertices]), rel=1e-13)
    gradient = half.gather_vertices(one.backward(here[half.owned_vertices]))
    whole = images.signs * skin.gather_vertices(other.backward(there[skin.owned_vertices]))
    pulled = [np.bincount(images.vertex, column) for column in whole.T]
    scale = np.abs(gradient).max()
    assert gradient == pytest.approx(np.stack(pulled, axis=1), abs=1e-12 * scale)
