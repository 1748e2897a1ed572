"""Legs of two panels: their angle, cross-sections, tips and supports."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.mechanics.skin.supports import symmetry_plane
from toros_fem.meshes import WALKER, Pattern, stand, walker
from toros_fem.products.actuators.legs import (
    Leg,
    LegWeights,
    rest_on_body,
    tip_positions,
)

ALONG = np.append(WALKER.directions[0], 0.0)
LEG = Leg(ALONG, (0.0, 0.0, -1.0), WALKER.root)


@pytest.fixture(scope="module")
def quarter(alone: MPI.Comm) -> Pattern:
    return walker(alone, 7e-3, planes=(0, 1))


@pytest.fixture(scope="module")
def robot(alone: MPI.Comm) -> Pattern:
    return walker(alone, 8e-3)


@pytest.mark.parametrize("degrees", [-40.0, 0.0, 90.0, 200.0])
def test_measured_angle_of_a_leg(quarter: Pattern, degrees: float) -> None:
    metric = LEG.angle_metric(degrees)
    assert (metric.key, metric.target) == ("angle_deg", degrees)
    bent = stand(np.radians(degrees), 0.03, directions=[ALONG[:2]], root=WALKER.root)
    # The outer third continues straight.
    assert metric.measure(quarter, bent(quarter.points)) == pytest.approx(degrees, abs=0.5)


def test_part_of_a_leg_by_which_its_angle_is_measured(quarter: Pattern) -> None:
    """A leg that bends all along has turned further at its end."""
    bent = stand(1.0, 0.08, directions=[ALONG[:2]], root=WALKER.root)(quarter.points)
    found = [LEG.angle_metric(0.0, outer_count=count).measure(quarter, bent) for count in (2, 4, 8)]
    assert found[0] > found[1] + 2 > found[2] + 4


def test_cross_sections_of_a_leg(quarter: Pattern) -> None:
    found = LEG.sections(quarter, LegWeights(cross_sections=5, centreline_weight=0.1))
    assert set(np.unique(found.labels)) == {-1, 0, 1, 2, 3, 4}
    inside = quarter.points @ ALONG > WALKER.root
    assert np.array_equal(found.labels >= 0, inside)
    assert found.position_weights.sum() == pytest.approx(3 * 0.1)
    assert found.orientation_weights == pytest.approx(5 * (0.03 / quarter.size) ** 2)


def test_tips_are_the_ends_of_the_legs(robot: Pattern) -> None:
    reach = WALKER.body_radius + WALKER.arm_length
    tips = tip_positions(robot, robot.points, WALKER.directions)
    along = (tips[:, :2] * WALKER.directions).sum(axis=1)
    assert np.all((along > 0.95 * reach) & (along <= reach))
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    moved = tip_positions(robot, robot.points @ turn.T, WALKER.directions)
    assert moved == pytest.approx(tips @ turn.T)


@pytest.mark.parametrize(("planes", "count"), [((), 6), ((0,), 3), ((1,), 3), ((0, 1), 1)])
def test_rest_prevents_rigid_motion_only(
    alone: MPI.Comm, planes: tuple[int, ...], count: int
) -> None:
    """Six components, less those that the symmetry planes prevent."""
    pattern = walker(alone, 8e-3, planes=planes)
    supports = rest_on_body(pattern, WALKER.body_radius, planes)
    supports.require_no_rigid_motion(pattern)
    own = supports.fixed.copy()
    for axis in planes:
        own &= ~symmetry_plane(pattern, axis).fixed
    assert own.sum() == count
