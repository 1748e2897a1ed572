"""Rectangles and discs of every kind of mesh."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import rectangle


def test_a_sheet_is_placed_in_space(alone: MPI.Comm) -> None:
    pattern = rectangle(
        alone, 0.02, 0.02, 0.01, place=lambda flat: np.column_stack([flat, flat[:, 0] ** 2])
    )
    assert pattern.points[:, 2] == pytest.approx(pattern.points[:, 0] ** 2)
