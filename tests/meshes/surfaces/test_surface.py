"""Orientation, volume and area of surfaces."""

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.meshes.surfaces.surface import oriented, volume


def test_oriented_surfaces() -> None:
    """Any triangles are reversed; the first one of each region decides."""
    rng = np.random.default_rng(1)
    for made in (surfaces.sphere(3), surfaces.torus(), surfaces.prism()):
        reverse = rng.random(len(made.triangles)) < 0.4
        mixed = np.where(reverse[:, None], made.triangles[:, ::-1], made.triangles)
        found = oriented(mixed)
        expected = made.triangles[:, ::-1] if reverse[0] else made.triangles
        first = np.argmin(found, axis=1) - np.argmin(expected, axis=1)
        rolled = [np.roll(row, shift) for row, shift in zip(expected, first, strict=True)]
        assert np.array_equal(found, rolled)
    two = np.array([[0, 1, 2], [5, 4, 3]])
    assert np.array_equal(oriented(two), two), "each region by itself"


def test_volume_and_area() -> None:
    box = surfaces.welded_box(2)
    assert volume(box.points + [1, 2, 3], box.triangles) == pytest.approx(6e-6, rel=1e-9)
    assert volume(box.points, box.triangles[:, ::-1]) == pytest.approx(-6e-6, rel=1e-9)
    assert box.area == pytest.approx(2 * (6 + 3 + 2) * 1e-4, rel=1e-9)
    assert box.closed
    assert not surfaces.prism().closed
