"""Deformers do what their documentation says."""

import numpy as np
import pytest
from toros_fem.meshes import bend, compose, contract, cylinder, twist

from toros_fem.errors import ParameterError
from toros_fem.measure import bend_angle

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
def test_measured_bend_angle(comm: object, degrees: float) -> None:
    pattern = cylinder(comm, 0.15, 0.02, 4e-3)  # type: ignore[arg-type]
    bent = bend(np.radians(degrees), 0.15, neutral=0.01)(pattern.points)
    assert np.degrees(bend_angle(pattern, bent)) == pytest.approx(degrees, abs=1e-9)


def test_bad_input() -> None:
    with pytest.raises(ParameterError, match="angle = nan"):
        bend(float("nan"), 0.15)
    with pytest.raises(ParameterError, match="axial = -1"):
        contract(-1)
