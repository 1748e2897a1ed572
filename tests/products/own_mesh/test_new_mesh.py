"""A mesh file whose triangles cannot bend is meshed anew, and then bends."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from helpers import surfaces
from mpi4py import MPI
from scipy.spatial import cKDTree

import toros_fem as tf
from toros_fem import errors
from toros_fem.products.own_mesh.own_mesh import Held, OwnMeshScene, read_skin
from toros_fem.products.plausibility import doubts

TUBE = surfaces.long_tube()
CONFIG = OwnMeshScene.of(held=(Held(where="z < 5 mm"),), bend=40.0, pressure=4e3)
NEW = CONFIG.updated(remesh=3e-3)
PART = NEW.updated(bend=None, shorten=10.0, symmetry="xy")


def stl(path: Path, points: np.ndarray) -> Path:
    """An STL file of the tube in mm, with its vertices elsewhere."""
    meshio.write_points_cells(path, 1e3 * points, [("triangle", TUBE.triangles)])
    return path


def angle(comm: MPI.Comm, scene: OwnMeshScene, path: Path) -> float:
    """Bend in deg of the tube whose side at +x and cap are printed."""
    skin = read_skin(comm, scene, path)
    scene = replace(scene.updated(filter_radius=5e-3), read=skin)
    assert not [one for one in doubts(scene) if one.startswith("refinements")]
    case = scene.case(comm, scene.finest_level)
    design = tf.ShapeDesign(comm, case, scene.design.regularisation)
    x, _, z = case.pattern.points[case.pattern.triangles].mean(axis=1).T
    printed = (x > 5e-3) | (z > 79.9e-3)
    density = printed.astype(float)[design.skin.owned_cells]
    found = design.physics.solver.solve(density, 4e3)
    return design.metrics_of(found)["angle_deg"]


def test_a_long_tube_bends_on_a_new_mesh(alone: MPI.Comm, tmp_path: Path) -> None:
    path = stl(tmp_path / "tube.stl", TUBE.points)
    coarse = replace(CONFIG, read=read_skin(alone, CONFIG, path))
    with pytest.raises(errors.ParameterError, match="around the skin.*`remesh` makes a new"):
        doubts(coarse)
    whole, half = (angle(alone, NEW.updated(symmetry=one), path) for one in (None, "y"))
    assert whole == pytest.approx(65, abs=7)
    assert half == pytest.approx(whole, rel=0.05)


def test_an_open_mesh_is_refused_before_it_is_meshed(alone: MPI.Comm, tmp_path: Path) -> None:
    path = tmp_path / "open.stl"
    meshio.write_points_cells(path, 1e3 * TUBE.points, [("triangle", TUBE.triangles[1:])])
    with pytest.raises(errors.PatternError, match="open.stl is open.*3 edges .* a hole of 0.08 m"):
        read_skin(alone, NEW, path)


def test_a_new_mesh_of_a_part_fits_its_image(alone: MPI.Comm, tmp_path: Path) -> None:
    """Though the new mesh is not symmetric about the plane that the part was cut at before."""
    skin = read_skin(alone, PART, stl(tmp_path / "tube.stl", TUBE.points))
    whole = skin.whole
    assert len(whole.free_edges) == 0
    assert whole.triangles.max() + 1 == len(whole.points)
    for axis in (0, 1):
        image = whole.points * np.where(np.arange(3) == axis, -1, 1)
        assert cKDTree(whole.points).query(image)[0].max() < 1e-12


def test_target_of_a_file_goes_to_the_new_vertices(
    alone: MPI.Comm, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A stretch is linear, so that interpolation is exact."""
    config: Any = NEW.updated(bend=None)
    stretched = stl(tmp_path / "stretched.stl", TUBE.points * [1, 1, 1.2])
    with caplog.at_level(logging.INFO, logger="toros_fem"):
        skin = read_skin(alone, config, stl(tmp_path / "tube.stl", TUBE.points), stretched)
    assert len(skin.target) == len(skin.pattern.points) > 700
    np.testing.assert_allclose(skin.target, skin.pattern.points * [1, 1, 1.2], atol=1e-8)
    assert f"256 triangles meshed anew by {len(skin.pattern.panel)}, 0.19 mm apart" in caplog.text
