"""The demo of a walker: its quarter, its target and its chambers."""

from typing import Any

import numpy as np
import pytest
from helpers.designs import case_of
from mpi4py import MPI

from toros_fem.meshes import walker
from toros_fem.products import walker as demo

SMALL = demo.WalkerScene.of(edge_length=6e-3)


@pytest.mark.parametrize("motion", ["stand", "crawl"])
def test_target_turns_the_leg_by_the_angle(alone: MPI.Comm, motion: str) -> None:
    case = case_of(alone, SMALL.updated(motion=motion))
    (angle,) = case.metrics
    assert angle.target == demo.ANGLE[motion]
    assert angle.measure(case.pattern, case.goal) == pytest.approx(angle.target, abs=0.5)
    reach = (case.goal - case.pattern.points).mean(axis=0)[0]
    assert (reach > 0) == (motion == "crawl")


def test_leg_starts_soft_on_top(alone: MPI.Comm) -> None:
    """The leg turns down, so the top is the side that stretches."""
    case = case_of(alone, SMALL)
    top = case.pattern.cells_of("top")
    assert case.start[top].max() < np.delete(case.start, top).min()
    assert case.symmetry == (0, 1)


def test_feet_are_printed(alone: MPI.Comm) -> None:
    config = SMALL.updated(foot_length=0.02)
    case = case_of(alone, config)
    foot = case.passive == 1
    along = case.pattern.points @ [*config.star.directions[0], 0.0]
    begin = config.star.reach - 0.02
    assert along[case.pattern.triangles[foot]].min() > begin - config.skin.edge_length
    assert along[case.pattern.triangles[~foot]].max() < begin + config.skin.edge_length
    assert np.isnan(case.passive[~foot]).all()
    assert case_of(alone, config.updated(foot_length=None)).passive is None


def test_chambers_of_the_whole(alone: MPI.Comm) -> None:
    pattern = walker(alone, 6e-3, SMALL.star)
    found = demo.chambers(pattern, SMALL.star)
    areas = [pattern.areas[found.of_cell == k].sum() for k in range(3)]
    assert areas[1] == pytest.approx(areas[2], rel=1e-6), "front and rear legs are alike"
    assert found.names == ("body", "front", "rear")


def test_sections_of_a_stride(alone: MPI.Comm) -> None:
    """The foot counts by its place along x; its target is half a leg's width from the middle."""
    shape, stride = (case_of(alone, SMALL.updated(aim=aim)) for aim in demo.AIMS)
    sections: Any = stride.parts[0]
    weights = sections.position_weights
    assert weights[-1, 0] == 1 > weights[:-1].max()
    assert sections.orientation_weights.max() > 0
    foot = sections.labels == len(weights) - 1
    assert stride.goal[foot, 0].mean() == pytest.approx(SMALL.skin.leg_width / 2)
    assert (stride.goal[~foot] == shape.goal[~foot]).all()
    (metric,) = stride.metrics
    assert metric.key == "foot_mm"
    assert metric.measure(stride.pattern, stride.goal) == pytest.approx(metric.target)


def test_pressures_of_body_and_leg_are_designed(alone: MPI.Comm) -> None:
    config = SMALL.updated(aim="stride")
    chambers = case_of(alone, config).chambers
    assert chambers.names == ("body", "leg")
    assert case_of(alone, config.updated(aim="shape")).chambers is None
    assert case_of(alone, config.updated(hold_pressure=True)).chambers is None


@pytest.mark.parametrize("feet", ["one-way", "nonslip"])
def test_ground_and_pads(alone: MPI.Comm, feet: str) -> None:
    config = SMALL.updated(feet=feet, pad_friction=0.1)
    pattern = walker(alone, 6e-3, SMALL.star)
    contact = config.contact_on(pattern, -0.03)
    assert contact.grounds[0].point == (0.0, 0.0, -0.03)
    assert contact.friction == 0.8
    if feet == "nonslip":
        assert contact.pads is None
        return
    reach = np.hypot(*pattern.points[contact.pads.vertices, :2].T)
    assert reach.min() > SMALL.star.reach - config.contact.pad_length - 1e-9
    assert (contact.pads.forward, contact.pads.backward) == (0.1, 0.8)
