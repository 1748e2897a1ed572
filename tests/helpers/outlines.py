"""Checks of flat skins of two panels."""

import numpy as np
import pytest

from toros_fem.meshes import Pattern, plane_centroids
from toros_fem.meshes.triangles import edges_of


def volume(pattern: Pattern, positions: np.ndarray | None = None) -> float:
    corners = (pattern.points if positions is None else positions)[pattern.triangles]
    return float(np.linalg.det(corners).sum() / 6)


def check_twins(pattern: Pattern) -> None:
    """Both panels have the same mesh, the top is above, and the pillow strains them slightly."""
    top, bottom = pattern.cells_of("top"), pattern.cells_of("bottom")
    assert len(top) == len(bottom)
    low = pattern.points[pattern.triangles[bottom][:, ::-1]]
    assert pattern.points[pattern.triangles[top]] == pytest.approx(low * [1, 1, -1], abs=1e-18)
    centroids = plane_centroids(pattern)
    assert centroids[top] == pytest.approx(centroids[bottom], abs=1e-15)
    assert centroids[top] == pytest.approx(pattern.centroids[top], abs=1e-15)
    a, b, c = np.moveaxis(pattern.points[pattern.triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    assert (normal[top, 2] > 0).all()
    assert (normal[bottom, 2] < 0).all()
    assert np.linalg.norm(normal, axis=1) / 2 == pytest.approx(pattern.areas, rel=2e-3)


def edges_on(pattern: Pattern, panel: str, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Ends of the mesh edges on a line, sorted, (k, 2), as fractions of its length."""
    ends = edges_of(pattern.triangles[pattern.cells_of(panel)]).ends
    along = end - begin
    away = pattern.points[:, :2] - begin
    on = np.abs(away[:, 0] * along[1] - away[:, 1] * along[0]) < 1e-9 * np.linalg.norm(along)
    fraction = away @ along / (along @ along)
    found = fraction[ends[on[ends].all(axis=1)]]
    return np.sort(np.sort(found, axis=1), axis=0)
