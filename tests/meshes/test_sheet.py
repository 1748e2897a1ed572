"""Rectangles and discs of every kind of mesh."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import disc, rectangle


def test_a_sheet_is_placed_in_space(alone: MPI.Comm) -> None:
    pattern = rectangle(
        alone, 0.02, 0.02, 0.01, place=lambda flat: np.column_stack([flat, flat[:, 0] ** 2])
    )
    assert pattern.points[:, 2] == pytest.approx(pattern.points[:, 0] ** 2)
    with pytest.raises(errors.ParameterError, match="edge_length"):
        disc(alone, 0.01, 0.02)
