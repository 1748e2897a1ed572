"""Objectives of profiles: values, derivatives and residuals by hand, bad targets."""

import dataclasses

import numpy as np
import pytest

from toros_fem import errors
from toros_fem.products.tiles.objectives import Contrast, ProfileTarget
from toros_fem.products.tiles.stiffness_profile import Profile


def profile_of(stress: list[float], contraction: list[float], strain: float) -> Profile:
    """Return a profile without states."""
    none = (None,) * len(stress)
    return Profile(
        angles=np.zeros(len(stress)),
        strain=strain,
        stress=np.array(stress),
        tangent=np.array(stress),
        contraction=np.array(contraction),
        shear=np.zeros(len(stress)),
        state=none,
        gradients=none,
        steps=0,
        factorisations=0,
    )


def test_objectives_by_hand() -> None:
    profile = profile_of([11.0, 30.0, 24.0], [0.3, 0.1, -0.2], 0.1)
    assert profile.stiffness == pytest.approx([110.0, 300.0, 240.0], rel=1e-15)
    target = np.array([100.0, np.nan, 300.0])
    only = ProfileTarget(target)
    assert only.forward(profile) == pytest.approx((0.1**2 + 0.2**2) / 3, rel=1e-12)
    assert only.largest_deviation(profile) == pytest.approx(0.2, rel=1e-14)
    sharing = ProfileTarget(target, weights=np.array([3.0, 1.0, 4.0]))
    assert sharing.forward(profile) == pytest.approx((3 * 0.1**2 + 4 * 0.2**2) / 8, rel=1e-12)
    contraction = np.array([np.nan, 0.4, 0.1])
    wide = ProfileTarget(contraction=contraction)
    assert wide.forward(profile) == pytest.approx((0.3**2 + 0.3**2) / 3, rel=1e-14)
    assert wide.largest_deviation(profile) == pytest.approx(0.3, rel=1e-14)
    both = ProfileTarget(target, contraction, contraction_weight=5.0)
    expected = only.forward(profile) + 5 * wide.forward(profile)
    assert both.forward(profile) == pytest.approx(expected, rel=1e-14)
    reached = ProfileTarget(profile.stiffness, profile.contraction)
    assert reached.forward(profile) == pytest.approx(0, abs=1e-28)
    contrast = Contrast(np.array([True, False, False]), np.array([False, True, True]))
    assert contrast.forward(profile) == pytest.approx(11 / 27, rel=1e-14)
    none = dataclasses.replace(both, weights=np.array([1.0, 2.0, 0.0]), contraction_weight=0.0)
    assert not len(contrast.residuals(profile))
    for each, terms in (
        (only, [0.1**2 / 3, 0.2**2 / 3]),
        (sharing, [3 * 0.1**2 / 8, 4 * 0.2**2 / 8]),
        (both, [0.1**2 / 3, 0.2**2 / 3, 5 * 0.3**2 / 3, 5 * 0.3**2 / 3]),
        (none, [0.1**2 / 3]),
    ):
        r = each.residuals(profile)
        assert r**2 == pytest.approx(terms, rel=1e-12)


def test_bad_targets() -> None:
    ones = np.ones(3)
    with pytest.raises(errors.TargetError, match=r"shapes \[\]; give at least one"):
        ProfileTarget()
    with pytest.raises(errors.TargetError, match=r"shapes \[\(2,\), \(3,\)\]"):
        ProfileTarget(ones, ones[:2])
    for stiffness, contraction in ((np.nan * ones, None), (None, np.nan * ones), (None, None)):
        with pytest.raises(errors.TargetError, match="there is no target"):
            ProfileTarget(stiffness, contraction, ones)
    for value in (0.0, -2.0):
        with pytest.raises(errors.TargetError, match=f"a target stiffness is {value:g} N/m"):
            ProfileTarget(np.array([1.0, value, np.nan]))
    for weights in (0 * ones, -ones, np.nan * ones, ones - [0, 0, 2]):
        with pytest.raises(errors.TargetError, match="none of them negative"):
            ProfileTarget(ones, weights=weights)
    with pytest.raises(errors.TargetError, match="contraction_weight = -1.0 must be"):
        ProfileTarget(ones, ones, contraction_weight=-1.0)
    profile = profile_of([1.0, 2.0], [0.1, 0.2], 0.1)
    for target in (ProfileTarget(ones), ProfileTarget(contraction=ones)):
        for act in (target.forward, target.backward):
            with pytest.raises(errors.TargetError, match="has 3 directions, the profile 2"):
                act(profile)
    some, none = np.array([True, False]), np.zeros(2, dtype=bool)
    for soft, stiff in ((some, none), (none, some), (some, np.ones(3, dtype=bool))):
        with pytest.raises(errors.TargetError, match="each must select a direction"):
            Contrast(soft, stiff)
