"""The operations of the symmetries of a tile."""

import numpy as np
import pytest

from toros_fem.meshes import SYMMETRIES
from toros_fem.meshes.tile_symmetry import check_symmetry, unstructured
from toros_fem.meshes.triangles import flat_areas


def test_symmetries_are_groups_with_the_identity_first() -> None:
    assert [len(group) for group in SYMMETRIES.values()] == [1, 4, 4, 8]
    for group in SYMMETRIES.values():
        assert (group[0] == np.eye(2)).all()
        members = {tuple(operation.ravel()) for operation in group}
        assert {tuple((a @ b).ravel()) for a in group for b in group} == members


def test_what_a_rectangle_allows() -> None:
    square, oblong = np.array([0.02, 0.02]), np.array([0.03, 0.02])
    for symmetry in SYMMETRIES:
        check_symmetry(symmetry, square)
    check_symmetry("orthotropic", oblong)


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_images_of_a_region_fill_the_rectangle(symmetry: str) -> None:
    sides, counts = np.array([0.02, 0.02]), np.array([8, 8])
    points, triangles = unstructured(sides, counts, symmetry)
    areas = flat_areas(points[triangles])
    assert areas.min() > 0, "also those of mirrors"
    assert areas.sum() == pytest.approx(4e-4, rel=1e-12)
    assert points.min(axis=0) == pytest.approx([0, 0], abs=1e-15)
    assert points.max(axis=0) == pytest.approx(sides, rel=1e-12)
    for axis in (0, 1):  # both borders have the same division
        low, high = (np.unique(points[np.abs(points[:, axis] - at) < 1e-9, 1 - axis].round(9))
                     for at in (0, 0.02))  # fmt: skip
        assert np.array_equal(low, high)
        assert low == pytest.approx(np.linspace(0, 0.02, 9), abs=1e-9)
