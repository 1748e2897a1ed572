"""Distortion between flat and assembled shapes whose stretches are known."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.distortion import distortion, triangle_stretches


def test_stretches_of_an_affine_map() -> None:
    """λ = 1.2 and 0.9 in turned directions, then any rigid motion in space."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    flat = square(n=3).corners
    stretched = flat @ turn @ np.diag([1.2, 0.9]) @ frame + rng.normal(size=3)
    found = triangle_stretches(flat, stretched)
    assert found == pytest.approx(np.tile([1.2, 0.9], (len(flat), 1)), rel=1e-12)


def test_stretched_sheet() -> None:
    flat = square(n=4, size=0.02)
    sheet = square(np.pad(flat.flat_points * [1.25, 0.8], ((0, 0), (0, 1))), n=4, size=0.02)
    found = distortion(sheet)
    assert found.strain == pytest.approx(0.25, rel=1e-12)
    assert found.worst_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.mean_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.area_ratio == pytest.approx(1, rel=1e-12)
    assert found.weight == pytest.approx(sheet.areas, rel=1e-12)
    # The legs 1 : 1 of each right triangle become 1.25 : 0.8.
    assert found.angle_error == pytest.approx(np.arctan(1.25 / 0.8) - np.pi / 4, rel=1e-12)
    assert found.worst_seam == 0
    rows = found.table().splitlines()
    assert len(rows) == 2 + 2 + 1
    assert rows[2].split()[:3] == ["sheet", "32", "4.00"]
    assert "25.00%" in rows[3]


def test_seam_gap_of_gathered_cloth() -> None:
    """The tip's disc is cut 2 % too large, so that it is gathered at its seam."""
    tube = cylinder(MPI.COMM_SELF, 0.05, 0.02, 5e-3, mesh="structured")
    flat = tube.flat_points.copy()
    flat[np.unique(tube.flat_triangles[tube.cells_of("tip")])] *= 1.02
    gathered = Pattern(
        flat, tube.flat_triangles, tube.panel, tube.sewn, tube.points, tube.panel_names, 0.05
    )
    found = distortion(gathered)
    assert found.worst_seam == pytest.approx(1 - 1 / 1.02, rel=1e-9)
    tip = found.panel == tube.panel_index("tip")
    assert found.strain[tip] == pytest.approx(0.02, rel=1e-9)
    assert found.strain[~tip].max() < 1e-12
