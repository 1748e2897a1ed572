"""Dihedral angle on numbers, and flaps in a mirror."""

import numpy as np
import pytest
import ufl

from toros_fem.forms.blocks import Vector
from toros_fem.forms.hinge import Mirror, hinge, reflected

FLAT = np.array([[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0], [0.6, -0.7, 0]], dtype=float)


BENT = FLAT + 0.2 * np.random.default_rng(4).standard_normal((4, 3))


def tuples(points: np.ndarray) -> list[Vector]:
    """Points as the forms take them."""
    return [(float(x), float(y), float(z)) for x, y, z in points]


@pytest.mark.parametrize("angle", [-2.0, -0.3, 0.0, 1e-9, 1.0, 3.0])
def test_angle_of_a_fold(angle: float) -> None:
    """The flap is turned about the edge by a known angle, away from the normal if positive."""
    points = FLAT.copy()
    height = -points[3, 1]
    points[3] = [0.6, -height * np.cos(angle), -height * np.sin(angle)]
    found, _ = hinge(*[ufl.as_vector(p.tolist()) for p in points])
    assert float(found(())) == pytest.approx(angle, rel=1e-12, abs=1e-15)


def test_mirrored_flap() -> None:
    normal = np.array([0.0, 0.6, 0.8])
    at, through = BENT[3], BENT[0]
    expected = at - 2 * normal * (normal @ (at - through))
    by_ufl = reflected(*[ufl.as_vector(p.tolist()) for p in (at, through, normal)])
    assert [float(by_ufl[k](())) for k in range(3)] == pytest.approx(expected)
    m, d, a = tuples(np.array([normal, at, through]))
    mirror = Mirror(m)
    assert np.array(mirror.place(d, a), dtype=float) == pytest.approx(expected)
    # A linear function g·d of the mirrored flap d, by the flap itself and by the plane's point.
    g = np.array([0.3, -1.0, 0.5])
    by_flap, by_point = mirror.gradient(tuples(g[None])[0])
    R = np.eye(3) - 2 * np.outer(normal, normal)
    assert np.array(by_flap, dtype=float) == pytest.approx(R @ g)
    assert np.array(by_point, dtype=float) == pytest.approx(g - R @ g)
    assert Mirror((0.0, 0.0, 0.0)).place(d, a) == pytest.approx(d)
