"""Jets on numbers: the angle at a fold, flaps in a mirror, and derivatives by differences."""

from collections.abc import Callable

import numpy as np
import pytest
import ufl
from helpers.expressions import number
from kit.slopes import slope

from toros_fem.forms.bending import EITHER, STEEP, fold, reflected
from toros_fem.forms.jets import Jet, Vector, compose, dot, total

FLAT = np.array([[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0], [0.6, -0.7, 0]], dtype=float)
BENT = FLAT + 0.2 * np.random.default_rng(4).standard_normal((4, 3))
NORMAL = np.array([0.0, 0.6, 0.8])


def nodes(points: np.ndarray) -> list[Vector]:
    """Points as the forms take them, with all their components as unknowns."""
    jets = [Jet(ufl.as_ufl(float(x)), {i: 1}) for i, x in enumerate(points.ravel())]
    return [(jets[i], jets[i + 1], jets[i + 2]) for i in range(0, len(jets), 3)]


def folded(points: np.ndarray, side: float | None = None) -> Jet:
    a, b, c, d = nodes(points)
    return fold(a, b, c, d, None if side is None else ufl.as_ufl(side))


def turned(angle: float) -> np.ndarray:
    """The flap turned about the edge, away from the normal if positive."""
    points = FLAT.copy()
    height = -points[3, 1]
    points[3] = [0.6, -height * np.cos(angle), -height * np.sin(angle)]
    return points


def steep(points: np.ndarray) -> Jet:
    """A fold by 165 degrees and a bit."""
    return fold(*nodes(points - BENT + turned(-2.88)))


def inside_out(points: np.ndarray) -> Jet:
    """A fold that begins closed, by 185 degrees and a bit."""
    a, b, c, d = nodes(points - BENT + turned(3.23))
    return fold(a, b, c, d, ufl.as_ufl(1.0))


def mirrored(points: np.ndarray) -> Jet:
    """The fold of a triangle with its flap in a mirror that is oblique to the edge."""
    a, b, c, d = nodes(points)
    return fold(a, b, c, reflected(d, a, NORMAL))


def in_one_law(points: np.ndarray) -> Jet:
    """A product of jets, and a law of two that share unknowns."""
    a, b, c, d = nodes(points)
    one, two = dot(a, b) * 2 - dot(c, d), 1 + dot(b, c) * dot(a, d)
    return compose(lambda x, y: ufl.exp(x / 4) * y**2, [one, two]) + one * two - (-two)


@pytest.mark.parametrize("side", [None, 0.0, 1.0, -1.0])
@pytest.mark.parametrize("angle", [-2.6, -0.3, 0.0, 1e-9, 1.0, 2.6])
def test_angle_of_a_fold(angle: float, side: float | None) -> None:
    """It is that of the triangles up to 150° to either side of where the fold begins."""
    if side and abs(angle - side * np.pi / 2) > STEEP:
        return
    assert number(folded(turned(angle), side).value) == pytest.approx(angle, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_fold_that_begins_closed_may_turn_inside_out(side: float) -> None:
    """Its angle grows on beyond 180° without a jump, to its stop near 270°."""
    angles = side * np.radians([170, 180, 190, 235, 268])
    found = np.array([number(folded(turned(angle), side).value) for angle in angles])
    assert found[:4] == pytest.approx(angles[:4], rel=1e-12)
    assert side * (found[4] - angles[4]) > 1.0


def test_a_fold_at_a_mirror_goes_to_either_side() -> None:
    """One that begins steep is the plain angle, which jumps at 180°."""
    angles = np.radians([-179, -120, 0, 120, 179])
    found = [number(folded(turned(angle), EITHER).value) for angle in angles]
    assert found == pytest.approx(angles, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_fold_does_not_close(sign: int) -> None:
    """Towards π the angle of the energy grows without bound."""
    gaps = np.array([0.4, 0.1, 0.01, 1e-4])
    stopped = [sign * number(folded(turned(sign * (np.pi - gap))).value) for gap in gaps]
    room = np.pi - STEEP
    assert stopped == pytest.approx(np.pi - gaps + (room - gaps) ** 3 / (room * gaps), rel=1e-4)
    assert np.isfinite(number(folded(turned(np.pi)).value))


def test_mirrored_flap() -> None:
    """A point is mirrored through another one; without a normal it stays."""
    at, through = BENT[3], BENT[0]
    expected = at - 2 * NORMAL * (NORMAL @ (at - through))
    a, _, _, d = nodes(BENT)
    assert [number(x.value) for x in reflected(d, a, NORMAL)] == pytest.approx(expected)
    assert [number(x.value) for x in reflected(d, a, np.zeros(3))] == pytest.approx(at)


@pytest.mark.parametrize("function", [folded, steep, inside_out, mirrored, in_one_law])
def test_derivatives_by_differences(function: Callable[[np.ndarray], Jet]) -> None:
    jet, numbers = function(BENT), np.random.default_rng(1)
    way = numbers.standard_normal(12)

    def at(h: float) -> Jet:
        return function(BENT + h * way.reshape(-1, 3))

    def gradient(jet: Jet) -> np.ndarray:
        return np.array([number(jet.gradient[i]) for i in range(12)])

    hessian = np.zeros((12, 12))
    for (i, j), value in jet.hessian.items():
        assert i <= j
        hessian[i, j] = hessian[j, i] = number(value)
    by_value = slope(lambda h: number(at(h).value), 1e-3)
    assert gradient(jet) @ way == pytest.approx(by_value, rel=1e-7, abs=1e-9)
    assert hessian @ way == pytest.approx(
        slope(lambda h: gradient(at(h)), 1e-3), rel=1e-7, abs=1e-8
    )


def test_sums_leave_out_plain_zeros() -> None:
    assert total([0, 0.0]) == 0
    assert [total(range(n)) for n in range(7)] == [0, 0, 1, 3, 6, 10, 15]
