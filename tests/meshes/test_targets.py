"""Deformers do what their documentation says."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.measures.metrics import bend_angle
from toros_fem.meshes import WALKER, bend, compose, contract, curl, cylinder, stand, twist, walker

Z = np.linspace(0, 0.15, 31)
AXIS = np.column_stack([0 * Z, 0 * Z, Z])


def test_bend_is_a_circle_that_keeps_the_neutral_line() -> None:
    line = AXIS + [0.01, 0, 0]
    bent = bend(np.pi, 0.15, neutral=0.01)(line)
    radius = 0.15 / np.pi
    centre = np.array([0.01 + radius, 0, 0])
    assert np.linalg.norm(bent - centre, axis=1) == pytest.approx(radius, rel=1e-12)
    assert bent[0] == pytest.approx(line[0], abs=1e-15)
    assert bent[-1] == pytest.approx([0.01 + 2 * radius, 0, 0], abs=1e-12)
    chord = np.linalg.norm(np.diff(bent, axis=0), axis=1)
    assert chord == pytest.approx(2 * radius * np.sin(np.pi / 60), rel=1e-9)
    # Material outside the neutral line is stretched by its distance times the curvature.
    outer = bend(np.pi, 0.15, neutral=0.01)(AXIS - [0.01, 0, 0])
    assert np.linalg.norm(outer - centre, axis=1) == pytest.approx(radius + 0.02, rel=1e-12)


def test_bend_of_no_angle_is_identity() -> None:
    assert bend(0.0, 0.15, neutral=0.01)(AXIS) == pytest.approx(AXIS, abs=1e-16)
    small = bend(1e-9, 0.15)(AXIS)
    assert small[:, 0] == pytest.approx(1e-9 * Z**2 / 0.3, rel=1e-6)


def test_twist_and_contract_compose() -> None:
    points = np.array([[0.01, 0, 0.15], [0.0, 0.01, 0.075]])
    both = compose(contract(0.92, 1.1), twist(np.pi / 2, 0.138))(points)
    assert both[0] == pytest.approx([0, 0.011, 0.138], abs=1e-15)
    half = np.sqrt(0.5) * 0.011
    assert both[1] == pytest.approx([-half, half, 0.069], abs=1e-15)


@pytest.mark.parametrize("degrees", [-120.0, 0.0, 90.0, 180.0, 250.0])
def test_measured_bend_angle(alone: object, degrees: float) -> None:
    pattern = cylinder(alone, 0.15, 0.02, 4e-3)  # type: ignore[arg-type]
    bent = bend(np.radians(degrees), 0.15, neutral=0.01)(pattern.points)
    assert np.degrees(bend_angle(pattern, bent)) == pytest.approx(degrees, abs=1e-9)


def test_bend_goes_on_straight() -> None:
    deform = bend(np.pi / 2, 0.1)
    radius = 0.2 / np.pi
    beyond = deform(np.array([[0, 0, 0.13], [0.01, 0, 0.13], [0.01, 0.02, -0.03]]))
    assert beyond[0] == pytest.approx([radius + 0.03, 0, radius], abs=1e-15)
    assert beyond[1] == pytest.approx([radius + 0.03, 0, radius - 0.01], abs=1e-15)
    assert beyond[2] == pytest.approx([0.01, 0.02, -0.03], abs=1e-15)


def test_curl_is_bend_in_another_frame() -> None:
    rng = np.random.default_rng(1)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    across, _, along = frame
    origin = rng.normal(size=3)
    points = rng.uniform(-0.1, 0.2, (50, 3))
    deform = curl(2.0, 0.1, origin=origin, along=3 * along, toward=0.1 * across)
    bent = bend(2.0, 0.1)(points)
    assert deform(points @ frame + origin) == pytest.approx(bent @ frame + origin, abs=1e-14)
    back = curl(-2.0, 0.1, origin=origin, along=along, toward=-across)
    assert back(points) == pytest.approx(deform(points), abs=1e-14)


@pytest.mark.parametrize("angle", [np.pi / 2, -0.4])
def test_stand_turns_the_legs_down_and_keeps_the_neutral_surface(
    alone: MPI.Comm, angle: float
) -> None:
    pattern = walker(alone, 5e-3)
    flat = pattern.points * [1, 1, 0]
    deform = stand(angle, 0.02, directions=WALKER.directions, root=WALKER.root)
    down = deform(flat)
    body = np.linalg.norm(flat, axis=1) <= WALKER.root
    assert down[body] == pytest.approx(flat[body], abs=1e-15)
    # Straight on from the end of the bend: the last centimetre of each leg.
    for x, y in WALKER.directions:
        out = np.array([x, y, 0])
        begin, end = deform(np.array([(WALKER.reach - 0.01) * out, WALKER.reach * out]))
        way = np.cos(angle) * out - np.sin(angle) * np.array([0, 0, 1])
        assert end - begin == pytest.approx(0.01 * way, abs=1e-15)
    # All edges keep their length but for what a chord is shorter than its arc.
    edge = pattern.triangles[:, [0, 1]]
    before, after = (np.linalg.norm(p[edge[:, 1]] - p[edge[:, 0]], axis=1) for p in (flat, down))
    assert (after <= before * (1 + 1e-12)).all()
    assert after == pytest.approx(before, rel=(np.abs(angle) * 5e-3 / 0.02) ** 2 / 12)
    # No jump anywhere, and lengths kept: the derivative is that of an isometry.
    step = 1e-7
    slopes = [
        (deform(flat + step * e) - deform(flat - step * e)) / (2 * step) for e in np.eye(2, 3)
    ]
    gram = np.array([[(a * b).sum(axis=1) for a in slopes] for b in slopes])
    assert gram == pytest.approx(np.broadcast_to(np.eye(2)[:, :, None], gram.shape), abs=1e-6)
