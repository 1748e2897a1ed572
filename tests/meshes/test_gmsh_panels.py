"""Polygons meshed by gmsh have the prescribed divisions, and gmsh's own state is left alone."""

import gmsh
import numpy as np

from toros_fem.meshes.gmsh_panels import polygon_meshes

TRIANGLE = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]])


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
