"""How far a design's shape is from its target, of parts and on any mesh; residuals of lines."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE, problem_of
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.design.loop.case import Case
from toros_fem.design.loop.miss import quantities_of, residuals_of, shape_measure
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.figures import TOLERANCE
from toros_fem.meshes import bend
from toros_fem.meshes.transfer import refine
from toros_fem.products.tubes import BendScene, BendTwistScene, TwistScene
from toros_fem.products.walker import WalkerScene

LENGTH = 0.06
TUBE = {"edge_length": 5.5e-3, "filter_radius": 8.5e-3, **DESIGN_ALONE}


@pytest.fixture(scope="module")
def half(alone: MPI.Comm) -> ShapeDesign:
    return problem_of(alone, BendScene.of(**TUBE))


def less(problem: ShapeDesign, points: np.ndarray) -> np.ndarray:
    """Positions of a tube that bends by 150° instead of 180°."""
    return np.asarray(bend(np.radians(150.0), 0.15)(points))


def test_a_part_has_the_miss_of_the_whole(alone: MPI.Comm, half: ShapeDesign) -> None:
    whole = problem_of(alone, BendScene.of(**TUBE, whole=True))
    found = []
    for problem in (half, whole):
        measure, pattern = shape_measure(problem), problem.skin.pattern
        assert measure is not None
        assert measure(pattern, problem.target)["shape_distance_mm"] == pytest.approx(0, abs=1e-9)
        found.append(measure(pattern, less(problem, pattern.points)))
    part, all_of_it = found
    assert part["tip_direction_in_plane_deg"] == pytest.approx(-30.0, abs=0.5)
    assert part["tip_direction_out_of_plane_deg"] == pytest.approx(0.0, abs=1e-6)
    assert part == {
        key: pytest.approx(value, rel=0.02, abs=0.02) for key, value in all_of_it.items()
    }


def test_a_finer_mesh_has_the_same_miss(half: ShapeDesign) -> None:
    """By the map that the target is, and without one by the positions on the own mesh."""
    own = half.skin.pattern
    finer = refine(own).pattern
    keys = ["shape_distance_percent", "tip_direction_deg", "no such key"]
    coarse = quantities_of(half, keys)
    here = [value(own, less(half, own.points)) for value in coarse]
    there = [value(finer, less(half, finer.points)) for value in coarse]
    assert there[:2] == pytest.approx(here[:2], rel=0.02)
    assert np.isnan(here[2])
    fixed = half.changed()
    object.__setattr__(fixed, "case", replace(half.case, target=half.target))
    (moved,) = quantities_of(fixed, keys[:1])
    assert moved(finer, less(half, finer.points)) == pytest.approx(there[0], rel=0.02)


def test_what_is_not_compared_has_no_miss(alone: MPI.Comm) -> None:
    walker = problem_of(alone, WalkerScene.of(edge_length=3.6e-3, filter_radius=5.5e-3))
    assert shape_measure(walker) is None


def case_of(kind: type[Any] = BendTwistScene, **asked: Any) -> Case:
    """A short tube of a kind, on the mesh of its relaxed design."""
    scene = kind().updated(length=LENGTH, relaxed_edge_length=4e-3, **asked)
    found: Case = scene.case(MPI.COMM_SELF, scene.relaxed_level)
    return found


def turned(positions: np.ndarray, axis: str, degrees: float) -> np.ndarray:
    """A shape that is turned about an axis."""
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).apply(positions))


def test_a_target_misses_nothing_and_a_tip_that_leans_counts() -> None:
    case = case_of()
    residuals = residuals_of(case)
    assert residuals.of_shape(case.goal) < 1e-9
    assert residuals.of_metrics(case.goal) < 0.1 * TOLERANCE  # angles of a coarse mesh
    # The tip of a bend by 90° looks along x: about x it keeps its direction, and both angles.
    shape = turned(case.goal, "x", 10.0)
    assert residuals.of_metrics(shape) < TOLERANCE
    off = residuals.rod(shape).centres - residuals.rod(case.goal).centres
    rms = float(np.sqrt((off**2).sum(axis=1).mean())) / LENGTH
    assert residuals.of_shape(shape) == pytest.approx(rms)
    last = residuals.labels == residuals.labels.max()
    middle = residuals.rod(case.goal).centres[-1]
    shape = case.goal.copy()
    shape[last] = turned(shape[last] - middle, "y", 5.0) + middle
    assert residuals.of_shape(shape) == pytest.approx(TOLERANCE, rel=0.01)


def test_a_whole_shape_is_judged_by_its_metrics_alone() -> None:
    residuals = residuals_of(case_of(BendScene))
    assert residuals.labels is None
    shape = residuals.case.pattern.points
    assert residuals.of_shape(shape) == 0
    assert residuals.of_metrics(shape) == pytest.approx(1.0, abs=0.02)  # nothing of the bend


def test_a_length_may_be_off_by_the_tolerance_that_the_verdict_has() -> None:
    residuals = residuals_of(case_of(TwistScene, keep_length=True))
    longer = residuals.case.goal * [1.0, 1.0, 1.0 + TOLERANCE]
    assert residuals.of_metrics(longer) == pytest.approx(TOLERANCE, rel=1e-6)
