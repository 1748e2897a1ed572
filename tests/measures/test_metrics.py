"""Metrics of shapes that are known."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.measures.metrics import (
    Measurement,
    Metric,
    bend_angle,
    distance,
    length_ratio,
    shortening,
    swelling,
    twist_angle,
)
from toros_fem.meshes import bend, contract, cylinder, twist


@pytest.mark.parametrize("degrees", [-400.0, -90.0, 0.0, 200.0, 540.0])
def test_measured_twist(alone: MPI.Comm, degrees: float) -> None:
    pattern = cylinder(alone, 0.15, 0.02, 4e-3)
    straight = twist(np.radians(degrees), 0.15)(pattern.points)
    assert np.degrees(twist_angle(pattern, straight)) == pytest.approx(degrees, abs=0.1)
    bent = bend(np.radians(120.0), 0.15)(straight)
    assert np.degrees(twist_angle(pattern, bent)) == pytest.approx(degrees, abs=1.0)
    assert np.degrees(bend_angle(pattern, bent)) == pytest.approx(120.0, abs=0.5)


@pytest.mark.parametrize("degrees", [0.0, 40.0, 120.0])
def test_a_lean_out_of_the_plane_is_no_bend(alone: MPI.Comm, degrees: float) -> None:
    """By hand: the tip's direction (sin a, cos a) leans to y by 35°, so that its z is shortened."""
    pattern, bend_by, lean = cylinder(alone, 0.15, 0.02, 4e-3), np.radians(degrees), np.radians(35)
    leaning = Rotation.from_rotvec([lean, 0, 0]).apply(bend(bend_by, 0.15)(pattern.points))
    expected = np.arctan2(np.sin(bend_by), np.cos(bend_by) * np.cos(lean))
    assert bend_angle(pattern, leaning) == pytest.approx(expected, abs=np.radians(1e-6))


def test_measured_shortening_and_swelling(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.15, 0.02, 4e-3)
    short = contract(0.92, 1.4)(pattern.points)
    assert shortening(pattern, short) == pytest.approx(0.08)
    assert length_ratio(pattern, short) == pytest.approx(0.92)
    chord = bend(np.radians(120.0), 0.15)(pattern.points)
    assert length_ratio(pattern, chord) == pytest.approx(np.sin(np.pi / 3) / (np.pi / 3))
    assert swelling(pattern, short) == pytest.approx(1.4)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    assert shortening(pattern, short @ turn.T + 1.0) == pytest.approx(0.08)
    assert swelling(pattern, short @ turn.T + 1.0) == pytest.approx(1.4)
    for edge in (4e-3, 1e-2):  # the middle third of few rows, too
        pattern = cylinder(alone, 0.05, 0.02, edge, mesh="structured")
        cone = pattern.points * np.outer(1 + pattern.points[:, 2] / 0.05, [1, 1, 0])
        cone[:, 2] = pattern.points[:, 2]
        assert swelling(pattern, cone) == pytest.approx(1.5, rel=0.03)  # slabs are half open


def test_distance_from_a_target(alone: MPI.Comm) -> None:
    """Root mean square over the flat area; a rigid motion counts unless it is removed."""
    pattern = cylinder(alone, 0.15, 0.02, 4e-3)
    target = bend(1.0, 0.15)(pattern.points)
    assert distance(pattern, target + [3e-3, 0, 4e-3], target) == pytest.approx(5e-3)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5])
    moved = turn.apply(target) + 1.0
    assert distance(pattern, moved, target) > 1
    assert distance(pattern, moved, target, aligned=True) < 1e-12
    areas = pattern.vertex_areas
    one = target.copy()
    one[0] += [0, 2e-3, 0]
    assert distance(pattern, one, target) == pytest.approx(2e-3 * np.sqrt(areas[0] / areas.sum()))


def test_values_have_their_units() -> None:
    metric = Metric("twist", "deg", 300.0, twist_angle)
    assert (metric.key, metric.label) == ("twist_deg", "twist in degrees")
    assert metric.formatted(298.7) == "299°"
    length = Metric("length", "ratio", None, length_ratio)
    assert (length.key, length.label) == ("length_ratio", "length over its rest value")


def test_measurements_belong_to_metrics_of_the_same_target() -> None:
    metric = Metric("angle", "deg", 180.0, lambda _, __: 0.0)
    measured = Measurement("angle_deg", 180.0, 13e3, 150.0, "a bench")
    assert measured.belongs_to(metric)
    assert not measured.belongs_to(replace(metric, target=90.0))
    assert not measured.belongs_to(replace(metric, target=None))
    assert not measured.belongs_to(replace(metric, name="twist"))
