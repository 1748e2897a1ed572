"""The demo of a gripper: the object beside the finger, the target, and what is to touch."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.gripper import gripper as demo
from toros_fem.products.gripper.lift import solid

SMALL = demo.GripperConfig(edge_length=4e-3)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_target_goes_around_the_object(comm: MPI.Comm, shape: str) -> None:
    """Up to the distance of the flat panels and the curvature of the sphere across the strip."""
    config = SMALL.updated(shape=shape, inflated_depth=0.0)
    case = demo.case(comm, config)
    gap, angle = case.metrics
    assert gap.key == "gap_mm"
    assert gap.target == 0.0
    # Nowhere where it is to touch is the target farther from the box than at its ends.
    begin, end = config.touching
    touching = demo.touching_vertices(case.pattern, config)
    assert touching.any()
    bound = 0.2 if shape == "sphere" else 1.1 * farthest(config, (end - begin) / 2) + 0.2
    assert gap.measure(case.pattern, case.target) < bound
    assert gap.measure(case.pattern, case.pattern.points) > 2
    # The outer quarter of the finger has turned by a part of the whole angle.
    assert angle.target is not None
    assert 0 < angle.target <= np.degrees(config.bend_angle) + 1e-6
    inner = case.target[case.pattern.vertices_of("top")]
    inside, _ = config.body.distance(inner)
    assert inside.min() > -0.5e-3, "the target does not enter the object"


def farthest(config: demo.GripperConfig, half: float) -> float:
    """Return in mm how far the target leaves a box's edge at a distance along the finger."""
    return float(1e3 * half**2 / 2 * (1 / config.body.radius - 1 / config.bend_radius))


def test_finger_starts_to_bend_where_its_tip_comes_to_end() -> None:
    config = demo.GripperConfig(finger_length=0.09, size=0.04, wrap_angle=90.0)
    assert config.bend_start == pytest.approx(0.09 - np.pi / 2 * 0.02)
    box = config.updated(shape="box", tail_length=0.012, edge_bend_radius=0.03)
    assert box.bend_start == pytest.approx(0.09 - 0.012 - np.pi / 2 * 0.03)


@pytest.mark.parametrize("angle", [45.0, 70.0])
def test_edge_of_the_box_is_where_the_finger_has_turned(angle: float) -> None:
    """The edge's surface and the bend have one point and one tangent in common."""
    config = demo.GripperConfig(shape="box", edge_angle=angle, inflated_depth=0.0)
    turn, bend = np.radians(angle), config.bend_radius
    out = np.array([np.sin(turn), 0.0, -np.cos(turn)])
    centre = np.array([config.bend_start, 0.0, bend])
    distance, gradient = config.body.distance((centre + bend * out)[None])
    assert distance == pytest.approx([0.0], abs=1e-12)
    assert gradient[0] == pytest.approx(out, abs=1e-9)


def test_touching_strip_and_backbone(comm: MPI.Comm) -> None:
    case = demo.case(comm, SMALL)
    assert case.touching is not None
    assert case.passive is not None
    assert case.contact is not None
    x, y, _ = case.pattern.points[case.touching.weights > 0].T
    assert np.all(x > SMALL.bend_start)
    assert np.all(np.abs(y) < SMALL.finger_width / 6)
    top = case.pattern.cells_of("top")
    assert np.all(np.isnan(np.delete(case.passive, top)))
    assert np.nanmin(case.passive[top]) == 1.0


def test_mount_carries_the_inner_panel_on_its_stem(comm: MPI.Comm) -> None:
    case = demo.case(comm, SMALL)
    held = np.asarray(case.supports.fixed.all(axis=1))
    x, inner = case.pattern.points[:, 0], np.zeros(len(held), dtype=bool)
    inner[case.pattern.vertices_of("top")] = True
    assert x[held & inner].max() == pytest.approx(SMALL.stem_length, abs=SMALL.edge_length)
    assert x[held & ~inner].max() == pytest.approx(SMALL.root_length)
    with pytest.raises(errors.ParameterError, match="stem_length = 0.01 m must be at least root"):
        SMALL.updated(stem_length=0.01)


def test_another_angle_leaves_the_object_in_place(comm: MPI.Comm) -> None:
    config = SMALL.updated(shape="box")
    _, angle = demo.case(comm, config).metrics
    assert angle.target is not None
    asked = config.asked({"angle_deg": angle.target + 8})
    case = demo.case(comm, asked)
    _, further = case.metrics
    assert further.target == angle.target + 8
    assert further.measure(case.pattern, case.target) == pytest.approx(further.target, abs=0.5)
    assert asked.body == config.body


def test_bad_values() -> None:
    with pytest.raises(errors.ParameterError, match="shape = 'egg' must be one of"):
        SMALL.updated(shape="egg")
    with pytest.raises(errors.ParameterError, match="unknown parameter 'wrap_angel'; did you mean"):
        SMALL.updated(wrap_angel=80.0)
    with pytest.raises(errors.ParameterError, match=r"bend at 0.00\d+ m, inside its mount"):
        SMALL.updated(shape="box", finger_length=0.05)


@pytest.mark.slow
def test_a_lift_tells_what_is_held(comm: MPI.Comm) -> None:
    pytest.importorskip("ipctk")
    config = demo.GripperConfig(
        edge_length=3e-3,
        filter_radius=4.6e-3,
        stem_length=0.045,
        slip_limit=5e-4,
        lift_distance=5e-4,
        mass=0.02,
    )
    case = demo.case(comm, config)
    problem = actuator_problem(comm, case, config)
    density = (case.pattern.panel == case.pattern.panel_index("top")).astype(np.float64)
    grip = demo._grip(comm, problem, config)
    assert (grip.copies, grip.parts) == (3, 6)
    made = demo._lifted(grip, density, [15e3], config)
    figures = demo._figures(made, grip, config)
    assert figures["failure"] is None
    assert figures["smallest_distance_mm"] > 0
    assert figures["held_mass_kg"] > config.mass
    slip = figures["slip_mm"]
    assert 0 <= slip <= 0.5
    pressure = figures["finger_force_n"] / figures["contact_area_mm2"] * 1e3
    assert figures["contact_pressure_kpa"] == pytest.approx(pressure)
    closed, _, lifted = demo._shapes("x", made, grip, config)
    assert (closed.sunk, closed.raised, lifted.raised) == (0, 0, 5e-4)
    assert lifted.sunk == pytest.approx(1e-3 * slip)
    heavy = config.updated(mass=2 * figures["held_mass_kg"])
    assert demo._figures(made, grip, heavy)["slip_mm"] is None
    assert demo._shapes("x", made, grip, heavy)[-1].sunk == 5e-4, "it stays on its post"


def test_all_fingers_around_a_mesh(comm: MPI.Comm, tmp_path: Path) -> None:
    pytest.importorskip("ipctk")
    path = comm.bcast(tmp_path, root=0) / "egg.stl"
    ball = solid(SMALL.body)
    upright = 1e3 * (ball.points - ball.centre) * [1.0, 1.0, 1.25]
    if comm.rank == 0:
        meshio.write(path, meshio.Mesh(upright, [("triangle", ball.triangles)]))
    comm.barrier()
    config = SMALL.updated(object_mesh=str(path), filter_radius=6e-3)
    problem = actuator_problem(comm, demo.case(comm, config), config)
    grip = demo._grip(comm, problem, config)
    assert (grip.copies, grip.parts) == (1, 1)
    assert grip.body.centre == pytest.approx(SMALL.body.centre, abs=1e-6)
    assert np.ptp(grip.body.points, axis=0) == pytest.approx([0.05, 0.04, 0.04], rel=0.01)
    x, y, z = grip.shown_pattern.points.T
    away = np.hypot(y, z - SMALL.body.centre[2])
    one = grip.mirror.pattern.points
    assert away.reshape(3, -1) == pytest.approx(
        np.tile(np.hypot(one[:, 1], one[:, 2] - SMALL.body.centre[2]), (3, 1))
    )
    assert x.reshape(3, -1) == pytest.approx(np.tile(one[:, 0], (3, 1)))
    assert y.sum() == pytest.approx(0.0, abs=1e-9)
    density = np.zeros(len(problem.skin.pattern.triangles))
    assert grip.shown_density(density).shape == (len(grip.shown_pattern.triangles),)
