"""Polygons meshed by gmsh have the prescribed divisions, and gmsh's own state is left alone."""

import gmsh
import numpy as np
import pytest

from toros_fem.meshes.gmsh_panels import polygon_meshes
from toros_fem.meshes.topology import edges_of, flat_areas, lengths

CORNERS = np.array([[0.0, 0.0], [0.04, 0.0], [0.04, 0.02], [0.0, 0.03]])
COUNTS = [8, 5, 7, 6]
TRIANGLE = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]])


def test_polygons() -> None:
    meshes = polygon_meshes([(CORNERS, COUNTS), (TRIANGLE, [2, 2, 2])], 5e-3)
    for (flat, triangles), area in zip(meshes, (1e-3, 5e-5), strict=True):
        areas = flat_areas(flat[triangles])
        assert areas.min() > 0, "counter-clockwise"
        assert areas.sum() == pytest.approx(area, rel=1e-12)
        assert np.array_equal(np.unique(triangles), np.arange(len(flat)))
    flat, triangles = meshes[0]
    edges = edges_of(triangles)
    border = edges.ends[edges.border]
    assert len(border) == sum(COUNTS)
    for k, count in enumerate(COUNTS):
        a, b = CORNERS[k], CORNERS[(k + 1) % 4]
        away = (flat[border] - a) @ np.array([a[1] - b[1], b[0] - a[0]])
        on = (np.abs(away) < 1e-12).all(axis=1)
        side = np.linalg.norm(b - a)
        assert lengths(flat, border[on]) == pytest.approx(np.full(count, side / count), rel=1e-9)
    again = polygon_meshes([(CORNERS, COUNTS)], 5e-3)[0]
    assert np.array_equal(again[0], flat)


def test_a_model_of_the_user_is_left_alone() -> None:
    assert not gmsh.isInitialized()
    polygon_meshes([(TRIANGLE, [1, 1, 1])], 0.01)
    assert not gmsh.isInitialized()
    gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.model.add("mine")
        polygon_meshes([(TRIANGLE, [1, 1, 1])], 0.01)
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "mine"
        assert "toros_fem panel" not in gmsh.model.list()
    finally:
        gmsh.finalize()
