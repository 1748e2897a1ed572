"""Deformation gradient and stretches of a triangle."""

import numpy as np
import pytest
from helpers.expressions import matrix, number, numbers, vector

from toros_fem.forms.kinematics import (
    deformation_gradient,
    flat_area,
    right_cauchy_green,
    stretch_invariants,
)

FLAT = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 1.5]])
JACOBIAN = np.column_stack([FLAT[1] - FLAT[0], FLAT[2] - FLAT[0]])
F = np.array([[1.2, 0.1], [-0.2, 0.9], [0.3, 0.4]])


def test_kinematics_of_an_affine_map() -> None:
    """F from corners, and its stretches by a singular value decomposition."""
    jacobian = matrix(JACOBIAN)
    found = deformation_gradient([vector(F @ p) for p in FLAT], jacobian)
    assert numbers(found) == pytest.approx(F, rel=1e-14)
    assert number(flat_area(jacobian)) == pytest.approx(1.5)
    one, two = np.linalg.svd(F, compute_uv=False)
    s, p = stretch_invariants(right_cauchy_green(found))
    assert number(s) == pytest.approx(one + two, rel=1e-14)
    assert number(p) == pytest.approx(one * two, rel=1e-14)
