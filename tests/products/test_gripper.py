"""The gripper, and the load that it lifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import case_of
from mpi4py import MPI

from toros_fem.measures.regions import Body
from toros_fem.meshes.surface import volume
from toros_fem.products import gripper as demo
from toros_fem.products.gripper_load import LiftFigures, LiftResult, in_room, solid

SMALL = demo.GripperScene.of(edge_length=4e-3)
BALL = Body("sphere", 0.04, (0.03, 0.0, 0.02))


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_target_goes_around_the_object(alone: MPI.Comm, shape: str) -> None:
    """Up to the distance of the flat panels and the curvature of the sphere across the strip."""
    config = SMALL.updated(shape=shape, inflated_depth=0.0)
    case = case_of(alone, config)
    gap, angle = case.metrics
    assert gap.key == "gap_mm"
    assert gap.target == 0.0
    # Nowhere where it is to touch is the target farther from the box than at its ends.
    begin, end = config.touching(config.skin.edge_length)
    touching = config.touching_vertices(case.pattern, config.skin.edge_length)
    assert touching.any()
    bound = 0.2 if shape == "sphere" else 1.1 * farthest(config, (end - begin) / 2) + 0.2
    assert gap.measure(case.pattern, case.goal) < bound
    assert gap.measure(case.pattern, case.pattern.points) > 2
    # The outer quarter of the finger has turned by a part of the whole angle.
    assert 0 < angle.target <= np.degrees(config.bend_angle) + 1e-6
    inner = case.goal[case.pattern.vertices_of("top")]
    inside, _ = config.body.distance(inner)
    assert inside.min() > -0.5e-3, "the target does not enter the object"


def farthest(config: demo.GripperScene, half: float) -> float:
    """Return in mm how far the target leaves a box's edge at a distance along the finger."""
    return float(1e3 * half**2 / 2 * (1 / config.body.radius - 1 / config.bend_radius))


def test_finger_starts_to_bend_where_its_tip_comes_to_end() -> None:
    config = demo.GripperScene.of(finger_length=0.09, size=0.04, wrap_angle=90.0)
    assert config.bend_start == pytest.approx(0.09 - np.pi / 2 * 0.02)
    box = config.updated(shape="box", tail_length=0.012, edge_bend_radius=0.03)
    assert box.bend_start == pytest.approx(0.09 - 0.012 - np.pi / 2 * 0.03)


@pytest.mark.parametrize("angle", [45.0, 70.0])
def test_edge_of_the_box_is_where_the_finger_has_turned(angle: float) -> None:
    """The edge's surface and the bend have one point and one tangent in common."""
    config = demo.GripperScene.of(shape="box", edge_angle=angle, inflated_depth=0.0)
    turn, bend = np.radians(angle), config.bend_radius
    out = np.array([np.sin(turn), 0.0, -np.cos(turn)])
    centre = np.array([config.bend_start, 0.0, bend])
    distance, gradient = config.body.distance((centre + bend * out)[None])
    assert distance == pytest.approx([0.0], abs=1e-12)
    assert gradient[0] == pytest.approx(out, abs=1e-9)


def test_touching_strip_and_backbone(alone: MPI.Comm) -> None:
    case = case_of(alone, SMALL)
    assert case.contact is not None
    touching = SMALL.touching_vertices(case.pattern, SMALL.skin.edge_length)
    x, y, _ = case.pattern.points[touching].T
    assert np.all(x > SMALL.bend_start)
    assert np.all(np.abs(y) < SMALL.skin.finger_width / 6)
    top = case.pattern.cells_of("top")
    assert np.all(np.isnan(np.delete(case.passive, top)))
    assert np.nanmin(case.passive[top]) == 1.0


def test_mount_carries_the_inner_panel_on_its_stem(alone: MPI.Comm) -> None:
    case = case_of(alone, SMALL)
    held = np.asarray(case.supports.fixed.all(axis=1))
    x, inner = case.pattern.points[:, 0], np.zeros(len(held), dtype=bool)
    inner[case.pattern.vertices_of("top")] = True
    assert x[held & inner].max() == pytest.approx(
        SMALL.skin.stem_length, abs=SMALL.skin.edge_length
    )
    assert x[held & ~inner].max() == pytest.approx(SMALL.skin.root_length)


def test_another_angle_leaves_the_object_in_place(alone: MPI.Comm) -> None:
    config = SMALL.updated(shape="box")
    _, angle = case_of(alone, config).metrics
    asked = config.asked({"angle_deg": angle.target + 8})
    case = case_of(alone, asked)
    _, further = case.metrics
    assert further.target == angle.target + 8
    assert further.measure(case.pattern, case.goal) == pytest.approx(further.target, abs=0.5)
    assert asked.body == config.body


def test_a_lift_without_equilibrium_is_told() -> None:
    failed, none = LiftFigures(failure="no equilibrium"), LiftFigures()
    load = LiftResult(0.1, 0.3, 3, failed, none)
    assert load.words == "An object of 100 g is not lifted: no equilibrium"
    dropped = replace(load, printed=LiftFigures(held_mass_kg=0.05))
    assert (
        dropped.words
        == "An object of 100 g falls; the print holds at most 50 g (0.5 times as much)"
    )
    early = replace(load, printed=LiftFigures(held_mass_kg=0.05, failure="no equilibrium."))
    held = "the print holds at least 50 g (0.5 times as much)"
    assert early.words == f"An object of 100 g is not lifted: no equilibrium; {held}"
    known = replace(dropped, intervals={"held_mass_kg": 0.011})
    held = "the print holds at most 50 ± 11 g (0.5 times as much)"
    assert known.words == f"An object of 100 g falls; {held}"
    assert "intervals" not in known.entries()


def test_solids_have_the_surface_of_their_body() -> None:
    ball, box = solid(BALL), solid(Body("box", 0.04, (0.03, 0.0, 0.02)))
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 0.02**3, rel=1e-6)
    distance, _ = Body("box", 0.04, (0.03, 0.0, 0.02)).distance(box.points)
    assert np.abs(distance).max() < 1e-9
    r, a = 5e-3, 0.03  # radius of the edges, and the core that they go around
    exact = a**3 + 6 * a**2 * r + 3 * np.pi * a * r**2 + 4 / 3 * np.pi * r**3
    assert box.volume == pytest.approx(exact, rel=0.01)
    for body in (ball, box):
        assert body.centre == pytest.approx([0.03, 0.0, 0.02], abs=1e-5)


def test_fingers_are_shown_from_outside() -> None:
    """Turning a finger into the room must not turn it inside out."""
    ball = solid(BALL)
    for angle in (0.0, 1.0):
        turned = in_room(ball.points, 0.02, angle)
        assert volume(turned, ball.triangles) == pytest.approx(ball.volume)


def test_three_fingers_stand_around_the_object() -> None:
    """A point of the finger at the object's height is as far from its axis at every angle."""
    point = np.array([[0.03, 0.002, 0.001]])
    places = np.concatenate([in_room(point, 0.02, angle) for angle in 2 * np.pi * np.arange(3) / 3])
    assert places.sum(axis=0)[:2] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(places[:, :2], axis=1) == pytest.approx(np.hypot(0.019, 0.002))
    assert places[:, 2] == pytest.approx(-0.03), "the finger hangs down along its own x"
