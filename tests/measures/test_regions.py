"""Regions of a skin, a slender body's axis, the gap to a body."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.measures.regions import (
    Body,
    GapObjective,
    bend_between,
    body_axis,
    length_between,
    tip_frame,
    twist_between,
)
from toros_fem.meshes import Skin, bend, compose, contract, cylinder, twist
from toros_fem.meshes.pattern import Pattern

X = (1.0, 0.0, 0.0)
# Swing about an axis across z, then what a twist about z came before.
SWING, TWIST = Rotation.from_rotvec([0.0, 0.9, 0.0]), Rotation.from_rotvec([0.0, 0.0, -2.5])
LENGTH = 0.12
# Where a tube along z lies after its axes are permuted, and shifted.
PLACES = [("z", "x"), ("x", "y"), ("-y", "z")]
SHIFT = np.array([0.3, -0.2, 0.5])


@pytest.fixture(scope="module")
def tube(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.1, 0.02, 5e-3)


@pytest.mark.parametrize("whole", [Rotation.identity(), Rotation.from_rotvec([1.0, -2.0, 0.5])])
def test_known_motion(tube: Pattern, whole: Rotation) -> None:
    """The tip turns and moves; seen from the root it is the same if all is turned once more."""
    root, tip = tube.points[:, 2] < 0.02, tube.points[:, 2] > 0.07
    way, positions = np.array([4e-3, -7e-3, 2e-3]), tube.points.copy()
    centre = np.average(tube.points[tip], axis=0, weights=tube.vertex_areas[tip])
    turn = SWING * TWIST
    positions[tip] = turn.apply(tube.points[tip] - centre) + centre + way
    positions = whole.apply(positions) + [0.1, 0.2, 0.3]
    seen = (tube, positions, tip, root)
    assert bend_between(*seen, toward=X) == pytest.approx(0.9, abs=1e-9)
    assert bend_between(*seen) == pytest.approx(turn.magnitude(), abs=1e-9)
    assert twist_between(*seen) == pytest.approx(-2.5, abs=1e-9)
    frame = tip_frame(*seen)
    np.testing.assert_allclose(frame.displacement, way, atol=1e-12)
    np.testing.assert_allclose(frame.direction, [np.sin(0.9), 0, np.cos(0.9)], atol=1e-9)
    assert frame.lean == pytest.approx(0.9, abs=1e-9)
    below = np.average(tube.points[root], axis=0, weights=tube.vertex_areas[root])
    ratio = np.linalg.norm(centre + way - below) / np.linalg.norm(centre - below)
    assert length_between(*seen) == pytest.approx(ratio, abs=1e-12)
    far = tip_frame(tube, positions, tip)
    np.testing.assert_allclose(far.direction, (whole * turn).apply([0, 0, 1]), atol=1e-9)


@pytest.fixture(scope="module")
def slender(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, LENGTH, 0.02, 4e-3)


def placed(slender: Pattern, along: str, toward: str) -> tuple[Pattern, np.ndarray]:
    """The tube with its axis along another direction, and the rows of its frame."""
    unit = {w: (-1.0 if "-" in w else 1.0) * np.eye(3)["xyz".index(w[-1])] for w in (along, toward)}
    frame = np.stack([unit[toward], np.cross(unit[along], unit[toward]), unit[along]])
    moved = Pattern(
        slender.flat_points, slender.flat_triangles, slender.panel, slender.sewn,
        slender.points @ frame + SHIFT, slender.panel_names,
    )  # fmt: skip
    return moved, frame


@pytest.mark.parametrize(("along", "toward"), PLACES)
def test_targets_are_those_of_the_tube(slender: Pattern, along: str, toward: str) -> None:
    """At another place, targets are those of the tube along z, and metrics measure them."""
    moved, frame = placed(slender, along, toward)
    axis = body_axis(moved, along, toward, 0.0, None)
    assert axis.length == pytest.approx(LENGTH)
    assert axis.flat_tip
    bent, turned = bend(1.2, LENGTH, neutral=0.01), twist(2.5, LENGTH)
    all_three = compose(turned, contract(0.92), bend(1.2, 0.92 * LENGTH, neutral=0.01))
    for asked, expected, metric in (
        ((1.2, None, None), bent, axis.metric("angle", np.degrees(1.2))),
        ((None, 2.5, None), turned, axis.metric("twist", np.degrees(2.5))),
        ((None, None, 0.08), contract(0.92), axis.metric("shortening", 8.0)),
        ((1.2, 2.5, 0.08), all_three, None),
    ):
        x = axis.deformer(*asked, 0.01)(moved.points)
        np.testing.assert_allclose((x - SHIFT) @ frame.T, expected(slender.points), atol=1e-5)
        if metric is not None:
            assert metric.measure(moved, x) == pytest.approx(metric.target, abs=0.01)
    x = axis.deformer(-7.0, None, None, 0.01)(moved.points)  # by more than a turn
    assert axis.metric("angle", None).measure(moved, x) == pytest.approx(np.degrees(-7), abs=0.01)
    x = axis.deformer(1.2, None, None, 0.01)(moved.points)
    assert axis.metric("twist", None).measure(moved, x) == pytest.approx(0, abs=0.01)


def test_part_of_the_body_is_deformed(slender: Pattern) -> None:
    """Before `begin` it stays, beyond `end` it goes on straight."""
    axis = body_axis(slender, "z", "x", 0.03, 0.09)
    x = axis.deformer(np.radians(60), np.radians(40), 0.1, 0.0)(slender.points)
    low, high = slender.points[:, 2] < 0.03, slender.points[:, 2] > 0.09
    np.testing.assert_allclose(x[low], slender.points[low], atol=1e-15)
    # A rigid motion: distances stay.
    before, after = slender.points[high], x[high]
    np.testing.assert_allclose(
        np.linalg.norm(after - after[0], axis=1), np.linalg.norm(before - before[0], axis=1)
    )
    assert axis.metric("angle", 60.0).measure(slender, x) == pytest.approx(60, abs=1e-6)
    assert axis.metric("twist", 40.0).measure(slender, x) == pytest.approx(40, abs=0.01)


def test_round_tip(alone: MPI.Comm) -> None:
    """Without a flat end, the target ends where the tip begins, and is measured there."""
    slender = cylinder(alone, LENGTH, 0.02, 4e-3)
    points = slender.points.copy()
    cap = points[:, 2] > LENGTH - 1e-9
    points[cap, 2] += 0.01 * np.sqrt(1 - np.minimum(1, np.hypot(*points[cap, :2].T) / 0.0101) ** 2)
    rounded = Pattern(
        slender.flat_points,
        slender.flat_triangles,
        slender.panel,
        slender.sewn,
        points,
        slender.panel_names,
    )
    axis = body_axis(rounded, "z", "x", 0.0, None)
    assert not axis.flat_tip
    assert axis.end == pytest.approx(axis.length * 11 / 12)
    x = axis.deformer(1.0, None, None, 0.0)(points)
    assert axis.metric("angle", None).measure(rounded, x) == pytest.approx(np.degrees(1), abs=1e-6)


def test_distance_from_bodies() -> None:
    ball = Body("sphere", 0.04, (0.0, 0.0, 0.1))
    points = np.array([[0.0, 0.0, 0.13], [0.01, 0.0, 0.1], [0.03, 0.04, 0.1]])
    distance, gradient = ball.distance(points)
    assert distance == pytest.approx([0.01, -0.01, 0.03])
    assert gradient == pytest.approx(np.array([[0, 0, 1], [1, 0, 0], [0.6, 0.8, 0]]))
    box = Body("box", 0.04, (0.0, 0.0, 0.0))
    points = np.array([[0.03, 0.0, 0.0], [0.0, -0.01, 0.0], [0.015 + 0.03, 0.015 + 0.04, 0.0]])
    distance, gradient = box.distance(points)
    assert distance == pytest.approx([0.01, -0.01, 0.05 - 0.005])
    assert gradient == pytest.approx(np.array([[1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]]))


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_integers_and_lists_are_numbers(short_tube: Skin, shape: str) -> None:
    weights = np.random.default_rng(4).uniform(0, 1, len(short_tube.pattern.points))
    x = short_tube.pattern.points[short_tube.owned_vertices] * 1.5
    whole = Body(shape, 1, (0, 0, 0), 1)
    plain = Body(shape, 1.0, (0.0, 0.0, 0.0), 1.0)
    ones = np.ones(len(weights))
    listed = GapObjective(short_tube, whole, [1] * len(weights), 2)  # type: ignore[arg-type]
    assert listed.forward(x) == GapObjective(short_tube, plain, ones, 2.0).forward(x) > 0
