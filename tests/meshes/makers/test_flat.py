"""Polygons meshed by gmsh have the prescribed divisions, and gmsh's own state is left alone."""

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor

import gmsh
import numpy as np
import pytest

from toros_fem.meshes.makers.flat import polygon_mesh
from toros_fem.meshes.triangles import edges_of, flat_areas

TRIANGLE = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]])


@pytest.fixture
def session() -> Generator[None]:
    """Gmsh as another program has it open."""
    gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    yield
    gmsh.finalize()


def test_it_is_closed_where_it_was_not_open() -> None:
    assert not gmsh.isInitialized()
    polygon_mesh(TRIANGLE, 0.01)
    assert not gmsh.isInitialized()


def test_threads_wait_for_each_other() -> None:
    edges = [2e-3, 1e-3, 5e-4, 2.5e-4]
    with ThreadPoolExecutor(4) as pool:
        meshes = list(pool.map(lambda edge: polygon_mesh(TRIANGLE, edge), edges))
    for edge, (points, triangles) in zip(edges, meshes, strict=True):
        alone = polygon_mesh(TRIANGLE, edge)
        assert np.array_equal(points, alone[0])
        assert np.array_equal(triangles, alone[1])


@pytest.mark.usefixtures("session")
def test_a_model_of_the_user_is_left_alone() -> None:
    gmsh.model.add("mine")
    polygon_mesh(TRIANGLE, 0.01)
    assert gmsh.isInitialized()
    assert gmsh.model.getCurrent() == "mine"
    assert gmsh.model.list() == ["", "mine"]


@pytest.mark.usefixtures("session")
def test_options_of_the_user_are_left_alone() -> None:
    own = {
        "General.Terminal": 1, "Mesh.Algorithm": 5, "Mesh.RandomSeed": 3, "Mesh.MeshSizeMin": 2e-3,
        "Mesh.MeshSizeMax": 0.5, "General.NumThreads": 2,
    }  # fmt: skip
    for name, value in own.items():
        gmsh.option.setNumber(name, value)
    polygon_mesh(TRIANGLE, 0.01)
    assert {name: gmsh.option.getNumber(name) for name in own} == own


def test_polygons_share_their_common_side() -> None:
    corners = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [0.0, 0.02], [0.05, 0.01]])
    flat, triangles = polygon_mesh(
        corners, 6e-3, counts=[4, 3, 4, 3, 6], faces=[np.array([0, 1, 2, 3]), np.array([1, 4, 2])]
    )
    edges = edges_of(triangles)
    assert flat_areas(flat[triangles]).min() > 0
    assert flat_areas(flat[triangles]).sum() == pytest.approx(4e-4 + 3e-4, rel=1e-9)
    middle = flat[edges.ends[edges.inner]].mean(axis=1)
    assert np.count_nonzero(np.abs(middle[:, 0] - 0.02) < 1e-12) == 3, "edges on it, all inner"
    assert len(np.unique(np.round(flat, 9), axis=0)) == len(flat)
