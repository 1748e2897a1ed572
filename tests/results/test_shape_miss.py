"""How far a design's shape is from its target, of parts and on any mesh."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE, problem_of
from mpi4py import MPI

from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.meshes import bend
from toros_fem.meshes.transfer import refine
from toros_fem.products.tubes.bend import BendScene
from toros_fem.products.walker.walker import WalkerScene
from toros_fem.results.shape_miss import quantities_of, shape_measure

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
