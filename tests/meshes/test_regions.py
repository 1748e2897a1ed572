"""Automatic seams follow creases, and divide a region near its middle by a short way."""

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.meshes.regions import crease_regions
from toros_fem.meshes.triangles import normals


def test_a_small_region_joins_the_neighbour_with_the_longest_border() -> None:
    """A side of less than 1 % of the area of a flat box is no region of its own."""
    points, triangles = surfaces.box(2, (0.03, 0.03, 1e-4))
    places, number = np.unique(points.round(12), axis=0, return_inverse=True)
    region = crease_regions(places, number.ravel()[triangles], np.radians(45))
    assert np.unique(region).tolist() == [0, 1]
    area = np.bincount(region, np.linalg.norm(normals(points, triangles), axis=1) / 2)
    assert area.sum() == pytest.approx(2 * 9e-4 + 4 * 3e-6, rel=1e-12)
    assert area.min() > 0.49 * area.sum()
