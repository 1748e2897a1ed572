"""The cycle of a walker: its pressures, and what is measured of the robot on the ground."""

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes import WALKER, walker
from toros_fem.meshes.pattern import mirrored
from toros_fem.products.gait import Gait, Walk, walk_of


def walk_in(pressures: Any, volumes: Any, feet: Any = None, touching: Any = None) -> Walk:
    states: Any = [Mock(pressures=p, volumes=v) for p, v in zip(pressures, volumes, strict=True)]
    points = [TracePoint(0.0, feet, {}, state) for state in states]
    return Walk(Mock(), points, Mock(parts=1), feet, touching)


def test_pressures_of_a_cycle() -> None:
    """From the end of the last phase through all phases, in equal steps."""
    gait = Gait(("front", "rear"), np.array([[1.0, 0.0], [0.5, 1.0]]), 2)
    fractions = np.array([[0.5, 1.0], [0.75, 0.5], [1.0, 0.0], [0.75, 0.5], [0.5, 1.0]])
    assert gait.pressure_fractions == pytest.approx(fractions)


def test_stride_and_slip() -> None:
    """The rear foot draws up and slides back by 1 mm; the front foot reaches out in the air."""
    rear, front = np.array([0.0, 6.0, 5.0]), np.array([50.0, 50.0, 55.0])
    feet = np.zeros((3, 2, 3))
    feet[:, 0, 0], feet[:, 1, 0] = 1e-3 * rear, 1e-3 * front
    touching = np.array([[True, True], [True, True], [True, False]])
    walk = walk_in(np.zeros((3, 1)), np.zeros((3, 1)), feet, touching)
    assert walk.stride == pytest.approx(5e-3)
    assert walk.slip == pytest.approx(0.5e-3)
    assert walk.supplied_energy == walk.lost_energy == 0


def test_energy_of_a_cycle() -> None:
    """A chamber that is filled at 2 kPa and emptied at 1 kPa loses the area of its loop."""
    pressures = np.array([[1e3], [2e3], [2e3], [1e3], [1e3]])
    volumes = np.array([[1e-6], [1e-6], [4e-6], [4e-6], [1e-6]])
    walk = walk_in(pressures, volumes)
    assert walk.supplied_energy == pytest.approx(6e-3)
    assert walk.lost_energy == pytest.approx(3e-3)


def test_feet_of_a_path(alone: MPI.Comm) -> None:
    """Tips of all four legs from half of the robot; raised legs do not touch."""
    half = walker(alone, 8e-3, planes=(1,))
    whole = mirrored(half, (1,))
    raised = half.points.copy()
    front = half.points[:, 0] > 0.02
    raised[front, 2] += 2e-3
    points = []
    for k, positions in enumerate((half.points, raised + [3e-3, 0, 0])):
        result: Any = Mock(pressures=(1e3,), volumes=(2e-6 * k,))
        points.append(TracePoint(1e3, positions, {}, result))
    found = walk_of(Mock(), points, whole, WALKER.directions, -3e-4, 5e-4)
    ahead = WALKER.directions[:, 0] > 0
    assert found.stride == pytest.approx(3e-3)
    assert found.touching[0].all()
    assert (found.touching[1] == ~ahead).all()
    assert found.feet[1, ahead, 2] == pytest.approx(2.3e-3)
    assert found.supplied_energy == pytest.approx(4e-3), "both halves"
