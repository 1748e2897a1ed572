"""Lattice shifts of the nodes that a triangle of a tile sees."""

import numpy as np
import pytest

from toros_fem.forms.periodic import placed


def test_lattice_moves_corners_and_flaps_alone() -> None:
    """Rotations stand behind the nodes and stay as they are; F̄'s columns are taken off."""
    nodes = [np.full(3, float(k)) for k in range(3)]
    rotations, along, across = np.array([9.0, 9.0, 9.0]), np.eye(3)[0], np.eye(3)[1]
    shifts = [(0.0, 0.0), (2.0, 0.0), (0.0, -3.0)]
    found = placed([*nodes, rotations, along, across], shifts)
    assert len(found) == 4
    assert found[0] == pytest.approx([0, 0, 0])
    assert found[1] == pytest.approx([3, 1, 1])
    assert found[2] == pytest.approx([2, -1, 2])
    assert found[3] == pytest.approx([9, 9, 9])
