"""Flat discs: unrolled, by ABF++ and by least conformal energy; their distortion."""

import numpy as np
import pytest
from helpers import surfaces
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder, unwrap
from toros_fem.meshes.surfaces.cut import cut_open
from toros_fem.meshes.surfaces.flatten import (
    Distortion,
    abf_angles,
    closure_error,
    conformal,
    triangle_stretches,
    unrolled,
)
from toros_fem.meshes.triangles import corner_angles, edges_of


@pytest.mark.parametrize("method", ["abf", "lscm"])
def test_spherical_cap_against_the_stereographic_map(method: str) -> None:
    """Angles converge at first order, the scale between centre and rim at second order."""
    wrong, scale = [], []
    for rows in (4, 8, 16):
        surface, image = surfaces.cap(rows, np.radians(60))
        angles = corner_angles(surface.points, surface.triangles)
        wanted = abf_angles(surface.triangles, angles) if method == "abf" else angles
        flat = conformal(surface.triangles, wanted)
        found = corner_angles(flat, surface.triangles)
        wrong.append(np.abs(found - angles).mean())
        k = rows // 2
        half, rim = slice(1 + 3 * k * (k - 1), 1 + 3 * k * (k + 1)), slice(-6 * rows, None)
        size = [np.sqrt(np.mean(np.sum((flat[ring] - flat[0]) ** 2, axis=1)))
                for ring in (half, rim)]  # fmt: skip
        exact = np.linalg.norm(image[[half.start, -1]], axis=1)
        scale.append(abs(size[1] / size[0] / (exact[1] / exact[0]) - 1))
    assert surfaces.misfit(flat, image) < 2.5e-3
    assert np.log2(wrong[1] / wrong[2]) > 0.98
    assert np.log2(scale[1] / scale[2]) == pytest.approx(2, abs=0.05)
    assert scale[2] < 2e-4


def test_abf_meets_its_constraints() -> None:
    surface, _ = surfaces.cap(8, np.radians(80))
    triangles = surface.triangles
    found = abf_angles(triangles, corner_angles(surface.points, triangles))
    assert found.sum(axis=1) == pytest.approx(np.pi, abs=1e-12)
    inner = slice(0, len(surface.points) - 48)
    around = np.bincount(triangles.ravel(), found.ravel())[inner]
    assert around == pytest.approx(2 * np.pi, abs=1e-11)
    laid = corner_angles(conformal(triangles, found), triangles)
    assert laid == pytest.approx(found, abs=1e-9), "wheels close, so that it can be laid out"


def test_fine_tube_unrolls_to_rounding() -> None:
    """Rounding must not grow from triangle to triangle: here it grew by 12 orders."""
    surface = surfaces.prism(around=80, rows=60, radius=0.01, length=0.1)
    edges = edges_of(surface.triangles)
    seam = np.abs(surface.points[:, 1]) + np.maximum(0, -surface.points[:, 0]) < 1e-9
    triangles, sewn = cut_open(surface.triangles, edges, seam[edges.ends].all(axis=1))
    points = surface.points[sewn]
    flat = unrolled(points, triangles)
    assert closure_error(points, flat, triangles) < 1e-12
    assert np.ptp(flat, axis=0).max() == pytest.approx(0.1, rel=1e-12)


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
    found = Distortion(sheet)
    assert found.strain == pytest.approx(0.25, rel=1e-12)
    assert found.worst_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.mean_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.area_ratio == pytest.approx(1, rel=1e-12)
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
    found = Distortion(gathered)
    assert found.worst_seam == pytest.approx(1 - 1 / 1.02, rel=1e-9)
    tip = gathered.panel == tube.panel_index("tip")
    assert found.strain[tip] == pytest.approx(0.02, rel=1e-9)
    assert found.strain[~tip].max() < 1e-12


@pytest.mark.slow
def test_conformal_maps_of_fine_surfaces(alone: MPI.Comm) -> None:
    """A fine cone, which is developable, keeps its lengths, and angles by ABF++ are laid out."""
    cone = surfaces.cone(120, 60)
    laid = unwrap(alone, cone, method="lscm")
    assert len(cone.triangles) > 14_000
    assert laid.distortion.worst_stretch < 1e-7
    cap, _ = surfaces.cap(40, np.radians(60))
    wanted = abf_angles(cap.triangles, corner_angles(cap.points, cap.triangles))
    found = corner_angles(conformal(cap.triangles, wanted), cap.triangles)
    assert found == pytest.approx(wanted, abs=1e-9)
