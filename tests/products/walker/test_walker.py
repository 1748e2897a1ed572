"""The demo of a walker: its quarter, its target and its chambers."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import plane_centroids, walker
from toros_fem.meshes.mirror import mirrored
from toros_fem.products.walker import walker as demo
from toros_fem.products.walker.gait import Gait

SMALL = demo.WalkerConfig(edge_length=6e-3)


@pytest.mark.parametrize("motion", ["stand", "crawl"])
def test_target_turns_the_leg_by_the_angle(comm: MPI.Comm, motion: str) -> None:
    case = demo.case(comm, SMALL.updated(motion=motion))
    (angle,) = case.metrics
    assert angle.target == demo.ANGLE[motion]
    assert angle.measure(case.pattern, case.target) == pytest.approx(angle.target, abs=0.5)
    reach = (case.target - case.pattern.points).mean(axis=0)[0]
    assert (reach > 0) == (motion == "crawl")


def test_leg_starts_soft_on_top(comm: MPI.Comm) -> None:
    """The leg turns down, so the top is the side that stretches."""
    case = demo.case(comm, SMALL)
    assert case.start is not None
    top = case.pattern.cells_of("top")
    assert case.start[top].max() < np.delete(case.start, top).min()
    assert case.symmetry == (0, 1)


def test_another_angle(comm: MPI.Comm) -> None:
    (angle,) = demo.case(comm, SMALL.asked({"angle_deg": 72.0})).metrics
    assert angle.target == 72


def test_feet_are_printed(comm: MPI.Comm) -> None:
    config = SMALL.updated(foot_length=0.02)
    case = demo.case(comm, config)
    assert case.passive is not None
    foot = case.passive == 1
    along = case.pattern.points @ [*config.star.directions[0], 0.0]
    begin = config.star.reach - 0.02
    assert along[case.pattern.triangles[foot]].min() > begin - config.edge_length
    assert along[case.pattern.triangles[~foot]].max() < begin + config.edge_length
    assert np.isnan(case.passive[~foot]).all()
    assert demo.case(comm, config.updated(foot_length=None)).passive is None


def test_chambers_of_the_whole(comm: MPI.Comm) -> None:
    pattern = walker(comm, 6e-3, SMALL.star)
    found = demo.chambers(pattern, SMALL.star)
    areas = [pattern.areas[found.of_cell == k].sum() for k in range(3)]
    assert areas[1] == pytest.approx(areas[2], rel=1e-6), "front and rear legs are alike"
    assert found.names == ("body", "front", "rear")


def test_sections_of_a_stride(comm: MPI.Comm) -> None:
    """The foot counts by its place along x; its target is half a leg's width from the middle."""
    shape, stride = (demo.case(comm, SMALL.updated(aim=aim)) for aim in demo.AIMS)
    assert shape.cross_sections is not None
    assert stride.cross_sections is not None
    weights = stride.cross_sections.position_weights
    assert weights[-1, 0] == 1 > weights[:-1].max()
    assert stride.cross_sections.orientation_weights.max() > 0
    foot = stride.cross_sections.labels == len(weights) - 1
    assert stride.target[foot, 0].mean() == pytest.approx(SMALL.leg_width / 2)
    assert (stride.target[~foot] == shape.target[~foot]).all()
    (metric,) = stride.metrics
    assert metric.key == "foot_mm"
    assert metric.measure(stride.pattern, stride.target) == pytest.approx(metric.target)


def test_pressures_of_body_and_leg_are_designed(comm: MPI.Comm) -> None:
    config = SMALL.updated(aim="stride", design_pressure=True)
    chambers = demo.case(comm, config).chambers
    assert chambers is not None
    assert chambers.names == ("body", "leg")
    assert demo.case(comm, config.updated(aim="shape")).chambers is None


@pytest.mark.parametrize("feet", ["one-way", "nonslip"])
def test_ground_and_pads(comm: MPI.Comm, feet: str) -> None:
    config = SMALL.updated(feet=feet, pad_friction=0.1)
    pattern = walker(comm, 6e-3, SMALL.star)
    contact = demo.contact_of(pattern, config, -0.03)
    assert contact.grounds[0].point == (0.0, 0.0, -0.03)
    assert contact.friction == 0.8
    if feet == "nonslip":
        assert contact.pads is None
        return
    assert contact.pads is not None
    reach = np.hypot(*pattern.points[contact.pads.vertices, :2].T)
    assert reach.min() > SMALL.star.reach - config.pad_length - 1e-9
    assert (contact.pads.forward, contact.pads.backward) == (0.1, 0.8)


@pytest.mark.slow
def test_a_walker_walks() -> None:
    """Legs with a printed bottom bend under the body, and pads let it go ahead alone."""
    pytest.importorskip("ipctk")
    comm = MPI.COMM_SELF
    config = demo.WalkerConfig(edge_length=7e-3, pressure=10e3)
    half = walker(comm, config.edge_length, config.star, planes=(1,))
    whole = mirrored(half, (1,))
    reach = (plane_centroids(whole.pattern) @ config.star.directions.T).max(axis=1)
    printed = (whole.pattern.panel == whole.pattern.panel_index("bottom")) & (reach > 0.02)
    gait = Gait(demo.CHAMBERS, np.array([[1.0, 1, 1], [0.4, 0.4, 0.4]]), 1)
    points, walk, failure = demo.follow_gait(
        comm, config, gait, half, whole, printed, 3 * [config.pressure]
    )
    assert not failure
    assert walk is not None
    assert len(points) == 3
    assert walk.stride > 10e-3
    assert walk.slip < 0.1 * walk.stride
    assert walk.touching.all()
    assert walk.supplied_energy > 20 * abs(walk.lost_energy)
    assert all(p.result.smallest_distance for p in points)


def test_bad_values() -> None:
    with pytest.raises(errors.ParameterError, match="motion = 'run' must be one of"):
        SMALL.updated(motion="run")
    with pytest.raises(errors.ParameterError, match="aim = 'win' must be one of"):
        SMALL.updated(aim="win")
    with pytest.raises(errors.ParameterError, match="gait_steps = 0 must be .* at least 1"):
        SMALL.updated(gait_steps=0)
