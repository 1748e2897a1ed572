"""Regions are opened to a disc and laid flat, or refused."""

import numpy as np
import pytest

from toros_fem.meshes.chart import ChartError, lay_flat


def test_slivers_are_named() -> None:
    """A flat triangle of no use, though none is turned over."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])
    for method in ("exact", "lscm"):
        with pytest.raises(ChartError, match="1 of its 2 triangles are slivers"):
            lay_flat(points, triangles, np.zeros((2, 3), dtype=bool), method, np.inf, tips=False)
