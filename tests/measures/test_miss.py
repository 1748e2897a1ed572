"""How far a shape is from its target: by sections, at its tip, and along axes that count."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.runs import bent, tube

from toros_fem.measures.figures import State, Tolerances
from toros_fem.measures.miss import is_of_shape, miss_of, shape_figures
from toros_fem.meshes import Pattern, bend, compose, contract, twist

LENGTH = 0.15


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
    cap = np.abs(pattern.points[:, 2] - LENGTH) < 1e-9
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
    target = bend(np.pi / 2, LENGTH)(pattern.points)
    found = miss_of(pattern, target @ turned(axis, angle).T, target).values()
    assert found["tip_direction_deg"] == pytest.approx(angle)
    assert found["tip_direction_in_plane_deg"] == pytest.approx(in_plane, abs=1e-6)
    assert found["tip_direction_out_of_plane_deg"] == pytest.approx(lean, abs=1e-6)


def test_a_tip_that_bends_less_is_short(pattern: Pattern) -> None:
    target, less = (bend(np.radians(a), LENGTH)(pattern.points) for a in (90.0, 80.0))
    found = miss_of(pattern, less, target).values()
    assert found["tip_direction_in_plane_deg"] == pytest.approx(-10.0, abs=1e-6)
    assert found["tip_distance_mm"] == pytest.approx(
        1e3 * np.linalg.norm(tip_of(80.0) - tip_of(90.0)), rel=1e-6
    )


def tip_of(angle: float) -> np.ndarray:
    """The tip of the middle line, which keeps its length."""
    radius, turn = LENGTH / np.radians(angle), np.radians(angle)
    return np.array([radius * (1 - np.cos(turn)), 0.0, radius * np.sin(turn)])


def test_a_straight_target_has_no_plane(pattern: Pattern) -> None:
    target = twist(1.0, LENGTH)(pattern.points)
    leaning = target @ turned(1, 6.0).T
    found = miss_of(pattern, leaning, target).values()
    assert found["tip_direction_deg"] == pytest.approx(6.0)
    assert "tip_direction_out_of_plane_deg" not in found


def test_a_length_counts_only_where_it_is_asked_for(pattern: Pattern) -> None:
    """The outline of a twist follows the tube's length, and its direction counts still."""
    target = twist(1.0, LENGTH)(pattern.points)
    longer = compose(twist(1.0, LENGTH), contract(1.16))(pattern.points)
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
