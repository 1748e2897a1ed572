"""The demo of a gripper: the object beside the finger, the target, and what is to touch."""

import numpy as np
import pytest
from mpi4py import MPI

from demos import gripper as demo
from toros_fem import errors

SMALL = demo.GripperConfig(edge_length=4e-3)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_target_goes_around_the_object(comm: MPI.Comm, shape: str) -> None:
    """Up to the distance of the flat panels and the curvature of the sphere across the strip."""
    config = SMALL.updated(shape=shape, inflated_depth=0.0)
    case = demo.case(comm, config)
    gap, angle = case.metrics
    assert gap.key == "gap_mm"
    assert gap.target == 0.0
    assert gap.measure(case.pattern, case.target) < 0.2
    assert gap.measure(case.pattern, case.pattern.points) > 2
    # The outer third of the finger has turned by a part of the whole angle.
    assert angle.target is not None
    assert 0 < angle.target <= config.wrap_angle + 1e-6


def test_finger_starts_to_bend_where_its_tip_comes_to_end() -> None:
    config = demo.GripperConfig(finger_length=0.09, size=0.04, wrap_angle=90.0)
    assert config.bend_start == pytest.approx(0.09 - np.pi / 2 * 0.02)
    box = config.updated(shape="box", tail_length=0.015)
    assert box.bend_start == pytest.approx(0.09 - 0.015 - np.pi / 2 * 0.005)


def test_touching_strip_and_backbone(comm: MPI.Comm) -> None:
    case = demo.case(comm, SMALL)
    assert case.contact is not None
    assert case.passive is not None
    x, y, _ = case.pattern.points[case.contact.weights > 0].T
    assert np.all(x > SMALL.bend_start)
    assert np.all(np.abs(y) < SMALL.finger_width / 6)
    top = case.pattern.cells_of("top")
    assert np.all(np.isnan(np.delete(case.passive, top)))
    assert np.nanmin(case.passive[top]) == 1.0


def test_bad_values() -> None:
    with pytest.raises(errors.ParameterError, match="shape = 'egg' must be one of"):
        SMALL.updated(shape="egg")
    with pytest.raises(errors.ParameterError, match="unknown parameter 'wrap_angel'; did you mean"):
        SMALL.updated(wrap_angel=80.0)
