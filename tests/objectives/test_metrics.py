"""Metrics of shapes that are known."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem.meshes import bend, contract, cylinder, twist
from toros_fem.objectives.metrics import Metric, bend_angle, shortening, swelling, twist_angle


@pytest.mark.parametrize("degrees", [-400.0, -90.0, 0.0, 200.0, 540.0])
def test_measured_twist(comm: MPI.Comm, degrees: float) -> None:
    pattern = cylinder(comm, 0.15, 0.02, 4e-3)
    straight = twist(np.radians(degrees), 0.15)(pattern.points)
    assert np.degrees(twist_angle(pattern, straight)) == pytest.approx(degrees, abs=0.1)
    bent = bend(np.radians(120.0), 0.15)(straight)
    assert np.degrees(twist_angle(pattern, bent)) == pytest.approx(degrees, abs=1.0)
    assert np.degrees(bend_angle(pattern, bent)) == pytest.approx(120.0, abs=0.5)


def test_measured_shortening_and_swelling(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.15, 0.02, 4e-3)
    short = contract(0.92, 1.4)(pattern.points)
    assert shortening(pattern, short) == pytest.approx(0.08)
    assert swelling(pattern, short) == pytest.approx(1.4)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    assert shortening(pattern, short @ turn.T + 1.0) == pytest.approx(0.08)
    assert swelling(pattern, short @ turn.T + 1.0) == pytest.approx(1.4)


def test_values_have_their_units() -> None:
    metric = Metric("twist", "deg", 300.0, twist_angle)
    assert (metric.key, metric.label) == ("twist_deg", "twist in degrees")
    assert metric.formatted(298.7) == "299°"
    with pytest.raises(errors.ParameterError, match="must be identifiers"):
        Metric("two words", "deg", 1.0, twist_angle)
