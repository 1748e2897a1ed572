"""Enclosed volume and its second variation."""

import numpy as np
import pytest
from helpers.expressions import number, vector

from toros_fem.forms.pressure import enclosed_volume


def test_volume_of_a_tetrahedron_wherever_the_origin_is() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=float)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    for origin in (np.zeros(3), np.array([5.0, -4.0, 7.0])):
        moved = corners + origin
        parts = [number(enclosed_volume([vector(moved[k]) for k in face])) for face in faces]
        assert sum(parts) == pytest.approx(1.0, rel=1e-12)
