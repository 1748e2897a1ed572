"""Stiffness between fabric and reinforcement."""

from toros_fem.forms.kinematics import interpolate


def test_stiffness_is_mixed_linearly() -> None:
    assert [interpolate(rho, 2.0, 10.0) for rho in (0.0, 0.25, 1.0)] == [2.0, 4.0, 10.0]
