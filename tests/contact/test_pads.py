"""Pads that slide one way: the law of friction, its derivatives, and what a path carries."""

import numpy as np
import pytest

from toros_fem import errors
from toros_fem.contact import Contact, Ground, Pads
from toros_fem.contact.pads import SlidingLaw

pytestmark = pytest.mark.one_rank

LAW = Pads(np.ones(1, dtype=bool), forward=0.2, backward=0.8).law(1e-4)


def slidings() -> np.ndarray:
    """Slidings in m inside and outside of the slip, in all directions."""
    drawn = np.random.default_rng(3).standard_normal((40, 2))
    return drawn * np.repeat([2e-5, 4e-4], 20)[:, None]


def test_friction_along_against_and_across() -> None:
    """Full friction: μ times the normal force, by the direction of sliding."""
    far = 5e-3 * np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    assert LAW.gradient(far) == pytest.approx(
        np.array([[0.2, 0], [-0.8, 0], [0, 0.8], [0, -0.8]]), abs=1e-12
    )


def test_friction_dissipates_what_the_gauge_says() -> None:
    """The work of full friction is μ g: the potential is of degree one in the sliding."""
    far = 50 * slidings()[20:]
    work = (LAW.gradient(far) * far).sum(axis=1)
    assert work == pytest.approx(0.8 * LAW.gauge(far))
    assert LAW.potential(far) == pytest.approx(work)


def test_equal_coefficients_are_coulombs() -> None:
    law = SlidingLaw(0.5, 1.0, 1e-4)
    friction = law.gradient(30 * slidings())
    sliding = np.linalg.norm(30 * slidings(), axis=1) > 1e-4
    assert np.linalg.norm(friction, axis=1)[sliding] == pytest.approx(0.5)


def test_derivatives() -> None:
    """Taylor remainders of second order, of the potential and of the gradient."""
    at = slidings()
    # A difference across s = 0 would see the jump of the second derivative.
    at = at[np.abs(at[:, 0]) > 2e-6]
    way = np.random.default_rng(4).standard_normal(at.shape)
    value, slope, turn = LAW.potential(at), LAW.gradient(at), LAW.hessian(at)
    steps = 1e-6 * 0.5 ** np.arange(4)
    first, second = [], []
    for h in steps:
        moved = at + h * way
        first.append(np.abs(LAW.potential(moved) - value - h * (slope * way).sum(axis=1)).sum())
        change = h * np.einsum("nij,nj->ni", turn, way)
        second.append(np.abs(LAW.gradient(moved) - slope - change).sum())
    for remainders in (first, second):
        rates = np.log2(np.array(remainders[:-1]) / remainders[1:])
        assert rates[-1] == pytest.approx(2.0, abs=0.02)


def test_potential_is_convex() -> None:
    """Between any two slidings, also across the change of direction."""
    one, two = slidings(), slidings()[::-1]
    middle = LAW.potential((one + two) / 2)
    assert (middle <= (LAW.potential(one) + LAW.potential(two)) / 2 + 1e-18).all()
    assert np.linalg.eigvalsh(LAW.hessian(one)).min() > -1e-9 / LAW.slip


def test_nothing_slides() -> None:
    zero = np.zeros((1, 2))
    assert not LAW.gradient(zero).any()
    assert LAW.hessian(zero)[0] == pytest.approx(np.diag([1.6e4, 1.6e4]))


def test_elastic_part_keeps_the_force() -> None:
    """The part that a path carries has the friction of the whole sliding."""
    at = slidings()
    kept = LAW.elastic(at)
    assert LAW.gradient(kept) == pytest.approx(LAW.gradient(at), abs=1e-12)
    assert LAW.gauge(kept).max() <= LAW.slip * (1 + 1e-12)
    holds = LAW.gauge(at) < LAW.slip
    assert holds.any()
    assert kept[holds] == pytest.approx(at[holds], abs=0)


def test_bad_pads() -> None:
    some = np.array([True, False])
    with pytest.raises(errors.ParameterError, match="forward = 0.9 must be at most"):
        Pads(some, forward=0.9)
    with pytest.raises(errors.ParameterError, match="True for one"):
        Pads(~some & some)
    with pytest.raises(errors.ParameterError, match="direction"):
        Pads(some, (0.0, 0.0, 0.0))
    assert Pads(some, (0.0, 3.0, 0.0)).direction == (0.0, 1.0, 0.0)


def test_pads_need_a_ground() -> None:
    some = np.array([True, False])
    assert Contact(ground=Ground(), pads=Pads(some)).pads is not None
    with pytest.raises(errors.ParameterError, match="pads slide on the ground"):
        Contact(pads=Pads(some))
