"""Relaxation of shapes that leave the stretch bounds."""

import numpy as np
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.search import relaxed_into_bounds
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, Skin


def use_of(pattern: Pattern, positions: np.ndarray) -> np.ndarray:
    composite = Composite()
    bounds = StretchBounds(MPI.COMM_SELF, pattern.corners, composite.c1, composite.c2)
    return bounds.use(positions[pattern.triangles])


def test_a_vertex_that_is_off_is_put_back(short_tube: Skin) -> None:
    pattern = short_tube.pattern
    fixed = clamp(pattern, ["base"]).fixed
    # A tube stretched to 80 % of the bound, with one vertex off by an edge's length.
    positions = pattern.points * [1.0, 1.0, 1.72]
    middle = int(np.argmin(np.abs(pattern.points - [0.01, 0.0, 0.03]).sum(axis=1)))
    positions[middle, 2] += 4.5e-3
    before = use_of(pattern, positions)
    assert before.max() > 1
    found = relaxed_into_bounds(pattern, Composite(), fixed, positions)
    assert use_of(pattern, found).max() <= 0.95
    moved = np.abs(found - positions).max(axis=1) > 0
    far = np.linalg.norm(pattern.points - pattern.points[middle], axis=1) > 0.03
    assert moved[middle]
    assert not moved[far].any(), "only its surroundings move"
    np.testing.assert_array_equal(found[fixed], positions[fixed])


def test_a_shape_inside_stays(short_tube: Skin) -> None:
    pattern, fixed = short_tube.pattern, clamp(short_tube.pattern, ["base"]).fixed
    found = relaxed_into_bounds(pattern, Composite(), fixed, pattern.points)
    np.testing.assert_array_equal(found, pattern.points)


def test_a_shape_that_is_far_outside_is_refused(short_tube: Skin) -> None:
    pattern, fixed = short_tube.pattern, clamp(short_tube.pattern, ["base"]).fixed
    assert relaxed_into_bounds(pattern, Composite(), fixed, 3 * pattern.points) is None
