"""Flat discs: unrolled, by ABF++ and by least conformal energy."""

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.meshes.cut import cut_open
from toros_fem.meshes.flatten import abf_angles, closure_error, conformal, unrolled
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
    cut = cut_open(surface.triangles, edges, seam[edges.ends].all(axis=1))
    points = surface.points[cut.sewn]
    flat = unrolled(points, cut.triangles)
    assert closure_error(points, flat, cut.triangles) < 1e-12
    assert np.ptp(flat, axis=0).max() > 0.1
