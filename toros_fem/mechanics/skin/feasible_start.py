"""Shapes that leave the stretch bounds in a few triangles, relaxed until they are inside."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import harmonic_extension

# Fraction of the bounds above which a triangle is relaxed.
RELAXED = 0.95
# Number of relaxations, each over one more ring of triangles around.
ROUNDS = 8


def relaxed_into_bounds(
    pattern: Pattern, composite: Composite, fixed: Bools, positions: Floats
) -> Floats | None:
    """Return a shape inside the stretch bounds, near a shape that leaves them in some triangles.

    A shape that is interpolated from a coarser mesh stretches the few triangles most that lie
    across a kink of it. Around these the map from the flat panels is made harmonic. Of two
    materials the wider bounds count: into the narrower ones a solve takes the shape by itself.
    Fixed components, (n, 3), keep their positions. None where the bounds cannot be met in this way.
    """
    triangles = pattern.triangles
    widest, wrinkles = composite.widest_bounds, composite.membrane.relaxed
    bounds = StretchBounds(MPI.COMM_SELF, pattern.corners, *widest, wrinkles=wrinkles)
    found, laplacian = np.array(positions), None
    for rings in range(1, ROUNDS + 1):
        use = bounds.use(found[triangles])
        if use.max(initial=0.0) <= RELAXED:
            break
        if laplacian is None:
            laplacian = pattern.flat_laplacian()
        near = np.zeros(len(found), dtype=bool)
        near[triangles[~(use <= RELAXED)]] = True
        for _ in range(rings):
            near[triangles[near[triangles].any(axis=1)]] = True
        for k in range(3):
            extend = harmonic_extension(laplacian, ~near | fixed[:, k])
            found[:, k] = extend(found[:, k])
    return found if bounds.worst(found[triangles]) < 1 else None
