"""Skins from mesh files."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from helpers import surfaces
from helpers.designs import DESIGN_ALONE
from helpers.own_skins import FINGER, OWN
from mpi4py import MPI
from scipy.spatial import cKDTree

import toros_fem as tf
from toros_fem import errors
from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import scene_text
from toros_fem.design.loop.case import Case
from toros_fem.measures.shape import ShapePart
from toros_fem.meshes import triangle_limit
from toros_fem.meshes.files import PATTERN_FILE, write_pattern
from toros_fem.products.actuators.cost import require_affordable_meshes
from toros_fem.products.common.plausibility import doubts
from toros_fem.products.own_mesh import Held, OwnMeshScene, OwnSkin, read_skin
from toros_fem.products.own_metrics import MetricTable
from toros_fem.results.runs.stored_run import summary_of

pytestmark = pytest.mark.usefixtures("few_pictures")
FINGER_SKIN = meshio.read(FINGER)
CONFIG = OWN.updated(
    filter_radius=None, pressure=8e3, iterations=2, constrained_iterations=1, polish_iterations=0,
    curve_steps=2, tip_weight=0.0, orientation_length=0.0, **DESIGN_ALONE,
)  # fmt: skip
SYMMETRIC = CONFIG.updated(symmetry="y")
TUBE = surfaces.long_tube()
BENDING = OwnMeshScene.of(held=(Held(where="z < 5 mm"),), bend=40.0, pressure=4e3)
NEW = BENDING.updated(remesh=3e-3)
PART = NEW.updated(bend=None, shorten=10.0, symmetry="xy")


def case_on(comm: MPI.Comm, scene: OwnMeshScene, skin: OwnSkin) -> Case:
    """The case of a skin that is read already, on its finest mesh."""
    scene = replace(scene.updated(filter_radius=4e-3), read=skin)
    return scene.case(comm, scene.finest_level)


@pytest.fixture(scope="module")
def finger(alone: MPI.Comm) -> OwnSkin:
    return read_skin(alone, CONFIG, FINGER)


def test_a_check_on_too_fine_a_mesh_is_refused_before(alone: MPI.Comm, finger: OwnSkin) -> None:
    """Its edges are a power of 2 shorter: 5 stands for 4, which makes 16 times as many."""
    scene = replace(CONFIG.updated(check_refinement=5.0, filter_radius=4e-3), read=finger)
    checked, own = scene.updated(estimate_error=True), len(finger.pattern.panel)
    finest = own * 4 ** (scene.level_count - 1)
    with triangle_limit(16 * finest - 1):
        require_affordable_meshes(alone, scene)
        with pytest.raises(errors.MeshSizeError, match="Take a smaller check_refinement"):
            require_affordable_meshes(alone, checked)
    with triangle_limit(16 * finest):
        require_affordable_meshes(alone, checked)


def test_case_of_a_finger(alone: MPI.Comm, finger: OwnSkin) -> None:
    case = case_on(alone, CONFIG, finger)
    height = finger.pattern.points[:, 2]
    np.testing.assert_array_equal(case.supports.fixed, np.repeat(height[:, None] < 4e-3, 3, 1))
    held = (Held(where="z < 4 mm"), Held(where="z > 80 mm", components="yz"))
    x, _, z = case_on(alone, CONFIG.updated(held=held), finger).supports.fixed.T
    np.testing.assert_array_equal(x, height < 4e-3)
    np.testing.assert_array_equal(z, (height < 4e-3) | (height > 0.08))
    x, _, z = finger.pattern.points[finger.pattern.triangles].mean(axis=1).T
    np.testing.assert_array_equal(case.passive == 1, (z < 1e-5) | (z > 0.08999))
    np.testing.assert_array_equal(case.passive == 0, (x < -7e-3) & (z > 0.03) & (z < 0.04))
    assert [(m.key, m.target) for m in case.metrics] == [("angle_deg", 60), ("distance_mm", None)]
    values = [m.measure(finger.pattern, case.goal) for m in case.metrics]
    assert values == pytest.approx([60, 0], abs=1e-6)
    assert vars(case.parts[0]) == vars(ShapePart())


def test_meshes_from_coarse_to_fine(alone: MPI.Comm, finger: OwnSkin) -> None:
    fine = CONFIG.updated(refinements=2, filter_radius=1e-3)
    assert fine.level_count == 3
    for times, level in enumerate(fine.levels):
        assert (level.edge_length, level.refinements) == (None, times)
        assert level.regularisation.filter_radius == 1e-3 * 2 ** (2 - times)
    middle = replace(fine, read=finger).case(alone, fine.levels[1])
    assert len(middle.pattern.panel) == 4 * len(finger.pattern.panel)
    values = [m.measure(middle.pattern, middle.goal) for m in middle.metrics]
    assert values == pytest.approx([60, 0], abs=1e-6)
    with pytest.raises(errors.ParameterError, match="levels = 4 is too many"):
        fine.updated(levels=4)
    quick = fine.coarse()
    assert (quick.skin.refinements, quick.design.filter_radius) == (0, 4e-3)


def test_meshes_of_laid_lines(alone: MPI.Comm, finger: OwnSkin) -> None:
    """The relaxed design has the mesh of the file, the print the finest, its error one between."""
    edge = finger.edge_length
    lines = replace(CONFIG.updated(start="relaxed", refinements=2, laid_width=1e-3), read=finger)
    levels = (lines.relaxed_level, lines.print_level, lines.density_level)
    assert [level.refinements for level in levels] == [0, 2, 2]
    radii = [level.regularisation.filter_radius for level in levels]
    assert radii == pytest.approx([2 * edge, 2 * edge / 4, 1.5 * edge / 4])
    ratio, coarser = lines.coarser(lines.print_level)
    assert (ratio, coarser.refinements) == (2.0, 1)
    for refinement, more in ((1.5, 1), (2.0, 1), (4.0, 2)):
        ratio, finer = lines.finer(lines.print_level, refinement)
        assert (ratio, finer.refinements) == (0.5**more, 2 + more)
        radius = lines.print_level.regularisation.filter_radius
        assert finer.regularisation.filter_radius == pytest.approx(ratio * radius)
    with pytest.raises(errors.ParameterError, match="there is no coarser one to compare with"):
        lines.coarser(replace(lines.print_level, refinements=0))


def test_what_counts(alone: MPI.Comm, finger: OwnSkin) -> None:
    tip = case_on(alone, CONFIG.updated(tip_weight=1.0, orientation_length=0.03), finger)
    top = finger.pattern.points[:, 2] > 0.09 - 1e-9
    shape: Any = tip.parts[0]
    np.testing.assert_array_equal(shape.weights > 1, top)
    np.testing.assert_array_equal(shape.relative > 0, top)
    area = finger.pattern.vertex_areas
    assert area[top] @ (shape.weights[top] - 1) == pytest.approx(area.sum())
    free = CONFIG.updated(counted="cross-sections", twist=40.0, bend=None, axial_weight=0.25)
    sections = case_on(alone, free, finger)
    part: Any = sections.parts[0]
    assert part.labels.max() == 12
    assert (part.position_weights[0] == [1 / 12, 1 / 12, 0.25 / 12]).all()
    assert [m.key for m in sections.metrics] == ["twist_deg"]
    named = case_on(alone, free.updated(metrics="shortening, twist, angle"), finger)
    assert [(m.key, m.target) for m in named.metrics] == [
        ("shortening_percent", None),
        ("twist_deg", 40.0),
        ("angle_deg", None),
    ]


def test_target_from_a_file(alone: MPI.Comm, tmp_path: Path, finger: OwnSkin) -> None:
    """Another program bends the STL file itself, in its own unit."""
    expected = case_on(alone, CONFIG, finger).goal
    mesh = meshio.read(FINGER)
    # An STL repeats each vertex: the corners of its triangles are moved one by one.
    corners = np.asarray(mesh.points)[mesh.cells_dict["triangle"]].reshape(-1, 3)
    near = ((corners[:, None] * 1e-3 - finger.pattern.points) ** 2).sum(axis=2).argmin(axis=1)
    points, cells = 1e3 * expected[near], np.arange(len(near)).reshape(-1, 3)
    meshio.write_points_cells(tmp_path / "bent.stl", points, [("triangle", cells)])
    meshio.write_points_cells(tmp_path / "other.ply", points, [("triangle", cells[::-1])])
    meshio.write_points_cells(tmp_path / "fewer.ply", points, [("triangle", cells[1:])])
    config = CONFIG.updated(bend=None, metrics="distance, angle")
    skin = read_skin(alone, config, FINGER, tmp_path / "bent.stl")
    case = case_on(alone, config, skin)
    np.testing.assert_allclose(case.goal, expected, atol=1e-7)  # an STL has single precision
    assert [m.target for m in case.metrics] == pytest.approx([0, 60], abs=1e-3)
    finer = case_on(alone, config.updated(refinements=1), skin)
    values = [m.measure(finer.pattern, finer.goal) for m in finer.metrics]
    assert values == pytest.approx([0, 60], abs=1e-3)
    config = config.updated(symmetry="y")
    half = case_on(alone, config, read_skin(alone, config, FINGER, tmp_path / "bent.stl"))
    plane = half.pattern.points[:, 1] == 0
    assert np.abs(half.goal[plane, 1]).max() < 1e-7
    values = [m.measure(half.pattern, half.goal) for m in half.metrics or ()]
    assert values == pytest.approx([0, 60], abs=0.2)
    config = config.updated(symmetry=None)
    with pytest.raises(errors.ParameterError, match="two targets: a file, and bend = 60"):
        case_on(alone, CONFIG, skin)
    with pytest.raises(errors.ParameterError, match="does not meet its neighbours"):
        read_skin(alone, config, FINGER, tmp_path / "other.ply")
    with pytest.raises(errors.ParameterError, match="has 1831 triangles, .* has 1832"):
        read_skin(alone, config, FINGER, tmp_path / "fewer.ply")
    with pytest.raises(errors.ParameterError, match="there is no file"):
        read_skin(alone, config, FINGER, tmp_path / "nothing.ply")


def test_symmetric_design_and_its_metrics(alone: MPI.Comm, tmp_path: Path) -> None:
    """A symmetric finger gets a symmetric print, whose tip stays in the plane."""
    scene, folder = tmp_path / "mine.toml", tmp_path / "run"
    tip = MetricTable(name="tip", measure="bend", of="z > 80 mm", against="z < 4 mm", target=60.0)
    config = CONFIG.updated(symmetry="auto", metric=(tip,))
    scene.write_text(scene_text(config, {"mesh": FINGER}), encoding="utf-8")
    words = ["design", str(scene), "--output", str(folder), "--quiet"]
    for text in ("tip of z > 80 mm", "bend of z > 80 mm against z < 4 mm"):
        words += ["--metric", text]
    assert run(alone, words) == 0
    found = summary_of(folder)
    assert found.entries["parts_by_symmetry"] == 2
    judged, target = found.figures["tip_deg"], found.figures["tip_deg"].target
    assert (judged.value, target) == (found.value("bend_deg"), 60.0)
    assert abs(found.value("tip_y_mm") or 0.0) < 1e-9 < (found.value("tip_lean_deg") or 0.0)
    skin = meshio.read(folder / "skin.vtu")
    centre = np.asarray(skin.points)[skin.cells_dict["triangle"]].mean(axis=1)
    gap, image = cKDTree(centre).query(centre * [1, -1, 1])
    assert gap.max() < 1e-9
    printed = skin.cell_data["printed"][0]
    assert 0 < printed.mean() < 1
    np.testing.assert_array_equal(printed, printed[image])


def test_symmetry_by_hand(alone: MPI.Comm, tmp_path: Path) -> None:
    """A part has supports and target of the whole."""
    write_pattern(tmp_path / PATTERN_FILE, read_skin(alone, SYMMETRIC, FINGER).pattern)
    case = case_on(alone, SYMMETRIC, read_skin(alone, SYMMETRIC, tmp_path))
    x = case.whole.at_vertices(case.goal)
    values = [m.measure(case.pattern, case.goal) for m in case.metrics or ()]
    assert values == pytest.approx([60, 0], abs=1e-6)
    np.testing.assert_allclose(x * [1, -1, 1], x[cKDTree(x).query(x * [1, -1, 1])[1]], atol=1e-9)
    held = case.supports.fixed.all(axis=1)
    np.testing.assert_array_equal(held, case.pattern.points[:, 2] < 4e-3)


def test_files_that_do_not_serve(alone: MPI.Comm, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(errors.ParameterError, match="there is no mesh: name a mesh file"):
        CONFIG.run_design(alone, out)
    with pytest.raises(errors.SurfaceError, match="there is no file"):
        CONFIG.run_design(alone, out, {"mesh": tmp_path / "nothing.stl"})
    with pytest.raises(errors.FileError, match="cannot be read"):
        CONFIG.run_design(alone, out, {"mesh": tmp_path})
    with pytest.raises(errors.FileError, match="nothing cannot be read"):
        CONFIG.run_simulation(alone, out, {"mesh": FINGER, "pattern": tmp_path / "nothing"})
    assert not out.exists()


def test_filter_of_a_mesh(alone: MPI.Comm) -> None:
    """Without a radius it is one and a half mean edges, of the finest mesh."""
    points, triangles = np.asarray(FINGER_SKIN.points), FINGER_SKIN.cells_dict["triangle"]
    sides = points[triangles] - points[np.roll(triangles, 1, axis=1)]
    edge = 1e-3 * np.linalg.norm(sides, axis=2).mean()
    for times in (0, 1):
        config = CONFIG.updated(refinements=times)
        made = config.with_files(alone, {"mesh": FINGER})
        assert made.design.filter_radius == pytest.approx(1.5 * edge / 2**times, rel=1e-5)


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
    coarse = replace(BENDING, read=read_skin(alone, BENDING, path))
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
