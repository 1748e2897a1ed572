"""Pads that slide one way: their law of friction, and what a step leaves."""

import numpy as np
import pytest

from toros_fem.mechanics.contact.sliding import Coulomb, Pads, SlidingFriction
from toros_fem.mechanics.contact.solids import rigid_box

ONE = np.ones(1, dtype=bool)
LAW = Coulomb(0.8, 1e-4, 0.25, (1.0, 0.4, 0.2))
NUMBERS = np.random.default_rng(0)
UP = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
NORMAL = NUMBERS.uniform(0.5, 2.0, (40, 1)) * UP
# Half of them stick, half slide.
MOTION = NUMBERS.standard_normal((40, 3)) * 1e-4 * np.repeat([0.3, 8.0], 20)[:, None]


def test_friction_along_against_and_across() -> None:
    law = Coulomb(0.8, 1e-4, 0.25, (2.0, 0.0, 0.0))
    far = 5e-3 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    found = law.at(np.tile([0.0, 0.0, 3.0], (4, 1)), far).force()
    assert found / 3 == pytest.approx(
        np.array([[0.2, 0, 0], [-0.8, 0, 0], [0, 0.8, 0], [0, -0.8, 0]]), abs=1e-12
    )


def test_force_by_the_normal_force() -> None:
    more = 1e-3 * np.random.default_rng(2).standard_normal((40, 1)) * UP
    change = LAW.at(NORMAL + more, MOTION).force() - LAW.at(NORMAL, MOTION).force()
    predicted = np.einsum("ijk,ik->ij", LAW.at(NORMAL, MOTION).force_by_normal(), more)
    assert change == pytest.approx(predicted, rel=1e-6, abs=1e-13)


def test_equal_coefficients_are_coulombs() -> None:
    one, other = Coulomb(0.5, 1e-4, 1.0 - 1e-12), Coulomb(0.5, 1e-4)
    for name in ("energy", "force", "stiffness", "elastic"):
        mine, theirs = (getattr(law.at(NORMAL, MOTION), name)() for law in (one, other))
        assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-12 * np.abs(theirs).max())


def test_elastic_slip_keeps_the_force() -> None:
    kept = LAW.at(NORMAL, MOTION).elastic()
    assert LAW.at(NORMAL, kept).force() == pytest.approx(LAW.at(NORMAL, MOTION).force(), abs=1e-12)
    assert np.linalg.norm(kept, axis=1).max() <= LAW.slip / LAW.ratio * (1 + 1e-12)


def test_the_direction_has_unit_length() -> None:
    assert Pads(ONE, (0.0, 3.0, 0.0)).direction == (0.0, 1.0, 0.0)


def test_vertices_with_pads_and_without() -> None:
    """On the ground pads have their law; other vertices, and other sides, have Coulomb's."""
    body = rigid_box("box", (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    pads = Pads(np.array([True, False]), forward=0.2, backward=0.8)
    friction = SlidingFriction(0.5, 1e-5, 1, [body], pads)
    points, poses = np.zeros((2, 3)), np.zeros((1, 6))
    friction.begin(np.zeros((2, 2, 3)))
    friction.lag(np.tile([0.0, 0.0, 2.0], (2, 2, 1)), points, poses)
    ahead = friction.force(points + [1e-3, 0, 0], poses)[:, :, 0] / 2
    back = friction.force(points - [1e-3, 0, 0], poses)[:, :, 0] / 2
    assert ahead == pytest.approx(np.array([[0.2, 0.5], [0.5, 0.5]]))
    assert back == pytest.approx(-np.array([[0.8, 0.5], [0.5, 0.5]]))
