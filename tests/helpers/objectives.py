"""Targets of the short tube, and the check of an objective's gradient."""

import numpy as np
import pytest
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.mpi import total
from toros_fem.measures.cross_sections import CrossSections, label_cross_sections
from toros_fem.measures.shape import Objective
from toros_fem.meshes import Skin, bend, compose, twist

LENGTH = 0.06  # of the short tube in m


TARGET = compose(twist(4.0, LENGTH), bend(1.0, LENGTH))


def tube_sections(skin: Skin) -> CrossSections:
    """Six cross-sections of the short tube, all weights different."""
    label = label_cross_sections(skin.pattern, skin.pattern.vertices_of("wall"), (0, 0, 1), 5)
    weights = np.arange(1.0, 7.0).astype(np.float64)
    return CrossSections(label, np.tile([1.0, 2.0, 3.0], (6, 1)), weights)


def check_gradient(objective: Objective, skin: Skin, comm: MPI.Comm) -> None:
    """Compare the gradient at a disturbed shape, distributed as the skin is, with differences."""
    rng = np.random.default_rng(1)
    points, owned = skin.pattern.points, skin.owned_vertices
    x = (points + 2e-3 * rng.standard_normal(points.shape))[owned]
    way = 1e-4 * (points[:, [1, 2, 0]] + 1e-3 * rng.standard_normal(points.shape))[owned]
    parts = objective.backward(x) * way
    rise = slope(lambda h: objective.forward(x + h * way))
    assert total(comm, parts.sum()) == pytest.approx(rise, abs=1e-8 * total(comm, abs(parts).sum()))
