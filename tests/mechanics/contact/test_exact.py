"""Contact against known answers, on coarse meshes, and balance of forces.

The long ones run on one rank: results do not depend on the number of ranks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.contact import CONTACT
from benchmarks.accuracy.known import Refinement, refinements
from benchmarks.accuracy.touching import (
    BALL_FORCE,
    BELT_FRICTION,
    BELT_PULL,
    DRUM_SIDES,
    PAD,
    PAD_FRICTION,
    PAD_THICKNESS,
    PAD_WEIGHT,
    against_plate,
    ball_depth,
    belt,
    closed_fold,
    on_slope,
    plate_force,
    pull_ratio,
    under_ball,
)

CASES = {case.name: case for case in CONTACT}


def coarse(name: str, mesh: str) -> list[Refinement]:
    """The two coarsest refinements on one kind of mesh."""
    return list(refinements(replace(CASES[name], meshes=(mesh,)), quick=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mesh", "bound"),
    [
        ("plate-radius", "unstructured", 3e-4),
        ("plate-stretch", "unstructured", 5e-4),
        ("plate-volume", "unstructured", 6.5e-3),
        ("tube-flattened", "right", 3.5e-3),
    ],
)
def test_membranes_between_plates(name: str, mesh: str, bound: float) -> None:
    first, fine = coarse(name, mesh)
    assert fine.relative_error <= bound
    if name != "plate-radius":  # its error is small and of either sign
        assert fine.observed_order >= 2 - 0.1
        assert fine.relative_error < first.relative_error


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mesh"), [("fold-gap", "right"), ("plate-height", "structured")])
def test_what_touches_comes_as_near_as_the_distance(name: str, mesh: str) -> None:
    _, fine = coarse(name, mesh)
    assert fine.observed_order == pytest.approx(1, abs=0.01)


def test_the_force_of_a_plate_balances_pressure_and_supports() -> None:
    found = against_plate("unstructured", 6, 4)
    push = found.touch.sum(axis=0)
    assert plate_force(found) == pytest.approx(-push[2], rel=1e-9)
    assert np.abs(push[:2]).max() < 1e-12
    assert 0 < found.result.smallest_distance < 0.3e-3 / 4


@pytest.mark.slow
def test_a_ball_presses_by_what_the_border_carries() -> None:
    found = under_ball("unstructured", 6, 9)
    assert found.touch[:, 2].sum() == pytest.approx(-BALL_FORCE, rel=1e-8)
    balance = found.touch.sum(axis=0) + found.reactions.sum(axis=0)
    assert np.abs(balance).max() < 1e-8 * BALL_FORCE
    assert ball_depth(found).value == pytest.approx(CASES["ball-depth"].reference, rel=0.04)


def test_layers_of_a_fold_push_each_other_alike() -> None:
    found = closed_fold(2, 4)
    push = np.abs(found.touch[:, 2]).sum()
    assert push > 0.01
    assert np.abs(found.touch.sum(axis=0)).max() < 1e-12 * push


@pytest.mark.slow
def test_a_belt_holds_by_the_exponential_of_its_angle() -> None:
    """To both sides, as the drum turns with the pull or against it."""
    expected = np.exp(np.pi * BELT_FRICTION)
    for turn, ratio in ((0.3, expected), (-0.3, 1 / expected)):
        found = belt(16, DRUM_SIDES, 4, BELT_FRICTION, turn)
        assert pull_ratio(found).value == pytest.approx(ratio, rel=1e-2)
        balance = found.touch.sum(axis=0) + found.reactions.sum(axis=0) - [0, 0, BELT_PULL]
        assert np.abs(balance).max() < 1e-8 * BELT_PULL


def test_a_belt_without_friction_pulls_alike() -> None:
    assert pull_ratio(belt(16, DRUM_SIDES, 4, None)).value == pytest.approx(1, rel=1e-4)


def test_a_pad_keeps_its_place_up_to_the_angle_of_friction() -> None:
    """It slips elastically by 1 − √(1 − tan α/μ) of the largest elastic slip."""
    found = on_slope(2, 4, 0.99 * PAD_FRICTION, dragged=False)
    assert found.result.converged
    moved = (found.points - found.pattern.points)[:, 0] / (PAD_THICKNESS / 4)
    assert moved == pytest.approx(1 - np.sqrt(0.01), rel=1e-3)
    weight = PAD_WEIGHT * PAD**2
    assert found.touch.sum(axis=0) == pytest.approx(
        weight / np.hypot(1, 0.99 * PAD_FRICTION) * np.array([-0.99 * PAD_FRICTION, 0, 1]),
        abs=1e-6 * weight,
    )


@pytest.mark.slow
def test_a_pad_slips_beyond_the_angle_of_friction() -> None:
    found = on_slope(2, 4, 1.01 * PAD_FRICTION, dragged=False).result
    assert not found.converged
    assert "without converging" in found.reason


def test_a_sliding_pad_is_held_back_by_its_weight_less_friction() -> None:
    rows = list(refinements(CASES["slope-slide"], quick=True))
    assert [row.value for row in rows] == pytest.approx([PAD_FRICTION] * 2, rel=1e-8)
