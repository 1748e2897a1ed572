"""Scenes that make no sense are refused or doubted before they run; those that work are not."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import ParameterError
from toros_fem.base.scene import Scene
from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene
from toros_fem.design.density.filters import RESOLVED
from toros_fem.meshes import cylinder
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.common.plausibility import RANGES, doubts, target_doubts
from toros_fem.products.kinds import KINDS
from toros_fem.products.own_mesh import OwnMeshScene, OwnSkin

SCENES = sorted((ROOT / "demos" / "scenes").glob("*.toml"))


def scene(kind: str, key: str, value: float) -> Scene:
    return KINDS[kind].of(**{key: value})


def test_a_filter_is_doubted_where_the_design_warns() -> None:
    assert RANGES["filter"].usual[0] == RESOLVED


@pytest.mark.parametrize("kind", KINDS)
def test_defaults_are_beyond_doubt(kind: str) -> None:
    assert doubts(KINDS[kind]()) == doubts(KINDS[kind]().coarse()) == []


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_scenes_of_the_demos_are_beyond_doubt(path: Path) -> None:
    assert doubts(read_scene(path).config) == []


@pytest.mark.parametrize(
    ("kind", "key", "value", "group"),
    [
        ("bend", "pressure", 5.0, "load"),  # kPa were meant
        ("walker", "pressure", 20.0, "load"),
        ("bend", "angle", 3.14159, "angle"),  # rad
        ("twist", "twist", 5.2, "angle"),
        ("contract", "contraction", 0.08, "shortening"),  # a part, not per cent
        ("contract", "contraction", 40.0, "shortening"),
        ("bend", "filter_radius", 21.5e-3, "width"),
        ("gripper", "tip_angle", 1.57, "angle"),
        ("bend-twist", "angle", 400.0, "bound"),
        ("bend", "reinforcement_young", 1e5, "contrast"),
        ("inflate", "highest_pressure", 1e6, "load"),
        ("bend", "filter_radius", 1e-4, "filter"),
        ("bend", "curve_pressure", 20e6, "load"),
        ("bend", "c1", 9.0, "stretch"),
        ("bend", "reinforcement_c1", 9.0, "stretch"),
        ("bend", "edge_length", 5e-3, "edges"),
        ("walker", "body_radius", 20.0, "length"),  # mm
        ("gripper", "contact_distance", 2.5e-3, "thickness"),
        ("bend", "print_height", 3e-3, "thickness"),
        ("tile", "size", 10.0, "thickness"),
        ("inflate", "pressure", 10.0, "load"),
        ("twist", "smoothing_radius", 2.0, "length"),
        ("bend", "length", 2.4, "size"),
    ],
)
def test_doubted(kind: str, key: str, value: float, group: str) -> None:
    found = doubts(scene(kind, key, value))
    assert any(RANGES[group].words in one for one in found), found


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("bend", "pressure", 1e9),
        ("bend", "pressure", 0.0),
        ("bend", "bladder_thickness", 1.0),
        ("gripper", "thickness", 0.1),
        ("bend", "print_width", 0.05),
        ("contract", "laid_width", 1.0),
        ("bend", "angle", 720.0),
        ("twist", "twist", 2160.0),
        ("contract", "contraction", 60.0),
        ("twist", "length", 150.0),  # mm
        ("inflate", "length", 150.0),
        ("inflate", "edge_length", 1.4),
        ("bend", "edge_length", 0.1),
        ("gripper", "finger_length", 90.0),
        ("gripper", "pressure", 900e6),
        ("gripper", "lift_distance", 50.0),
        ("walker", "leg_length", 60.0),
        ("tile", "thickness", 0.5),
        ("tile", "print_width", 0.6),
        ("tile", "filter_radius", 0.7),
        ("tile", "c1", 1900.0),
    ],
)
def test_refused(kind: str, key: str, value: float) -> None:
    with pytest.raises(ParameterError) as caught:
        doubts(scene(kind, key, value))
    assert caught.value.key == key
    assert str(caught.value).startswith(f"{key}: ")


def test_a_length_that_is_asked_for_is_within_reach() -> None:
    asked = KINDS["twist"].of(keep_length=True)
    for ratio in (0.3, 1000.0):
        with pytest.raises(ParameterError, match="^length_ratio: "):
            doubts(asked.updated(length_ratio=ratio))
    assert doubts(asked.updated(length_ratio=1.1)) == []


@pytest.mark.parametrize(
    ("kind", "key", "value", "needed"),
    [
        ("twist", "length_ratio", 1.2, "keep_length = true"),
        ("walker", "reach", 7e-3, 'motion = "crawl"'),
        ("bend", "laid_width", 1e-3, 'start = "relaxed"'),
        ("contract", "iterations", 70, 'start = "random"'),
        ("tile", "stiffness_90", 800.0, 'target = "orthotropic"'),
        ("bend", "bladder_young", 1e5, "bladder_thickness is none"),
    ],
)
def test_a_value_that_does_not_count_is_doubted(
    kind: str, key: str, value: float, needed: str
) -> None:
    (told,) = doubts(KINDS[kind].of(**{key: value}))
    assert told.startswith(f"{key} = ")
    assert "does not count: " in told
    assert needed in told


@pytest.mark.parametrize("kind", KINDS)
def test_what_keys_need_is_known(kind: str) -> None:
    known = KINDS[kind].described()
    for name, (other, values) in KINDS[kind].needs().items():
        assert name in known
        assert [known[other].read(value) for value in values] == list(values)
        assert values or known[other].optional


def test_a_way_that_is_asked_for_is_within_reach() -> None:
    asked = KINDS["walker"].of(reach=6.0)
    with pytest.raises(ParameterError, match="^reach: "):
        doubts(asked.updated(motion="crawl"))


def test_steepness_is_bounded() -> None:
    with pytest.raises(ParameterError, match="beta"):
        KINDS["bend"].of(beta=1e300)


def test_check_tells_doubts_and_refuses_with_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.toml"
    path.write_text('kind = "bend"\n[pressure]\npressure = 5\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path)]) == 0
    text = capsys.readouterr().out
    assert "can be read, but is doubtful" in text
    assert "in order" not in text
    assert text.count("\ndoubt ") == 1
    path.write_text('kind = "bend"\n[pressure]\npressure = "1 GPa"\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path)]) == 2
    assert f"{path}, line 3: pressure: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("table", "line"), [("material", 'fabric_young = "0.1 Pa"'), ("pressure", 'pressure = "1 GPa"')]
)
def test_a_simulation_refuses_what_a_design_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, line: str
) -> None:
    """Before a folder is made; a target that nobody gave is no reason."""
    path, output = tmp_path / "a.toml", tmp_path / "out"
    path.write_text(f'kind = "bend"\n[{table}]\n{line}\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["simulate", str(path), "--output", str(output)]) == 2
    told = capsys.readouterr().err
    assert str(path) in told
    assert ": pressure: " in told
    assert not output.exists()
    short = KINDS["bend"].of(length=0.05)
    assert any("angle" in one for one in doubts(short))
    assert not any("angle" in one for one in doubts(short, simulated=True))


@pytest.mark.parametrize(
    "line",
    [
        'filter_radius = "30 mm"',
        'line_width = "20 mm"',
    ],
)
def test_check_refuses_what_a_design_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    path = tmp_path / "a.toml"
    table = "print" if line.startswith("island") else "design"
    path.write_text(f'kind = "bend"\n[{table}]\n{line}\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path), "--coarse"]) == 2
    told = capsys.readouterr().err
    assert f"{path}, line 3: " in told
    assert line.split()[0] in told


@pytest.mark.parametrize(
    ("kind", "table", "line"),
    [
        ("twist", "lines", 'print_edge_length = "1 um"'),
        ("tile", "skin", 'edge_length = "1 um"'),
        ("inflate", "skin", 'edge_length = "1 um"'),
        ("twist", "print", 'print_width = "2 mm"'),
        ("gripper", "object", 'size = "110 mm"'),
        ("gripper", "skin", 'finger_length = "45 mm"'),
        ("gripper", "skin", 'root_length = "3.75 mm"'),
        ("walker", "skin", 'leg_length = "5 mm"'),
        ("walker", "skin", 'foot_length = "70 mm"'),
        ("walker", "contact", 'pad_length = "70 mm"'),
        ("walker", "skin", 'body_radius = "1 mm"'),
    ],
)
def test_refusals_name_the_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, table: str, line: str
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f'kind = "{kind}"\n[{table}]\n{line}\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path)]) == 2
    told = capsys.readouterr().err
    assert f"{path}, line 3: " in told
    assert line.split()[0] in told


def test_check_refuses_what_the_finest_mesh_cannot_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A filter of a coarser mesh could; and a relaxed start has no filter of densities."""
    path = tmp_path / "a.toml"
    skin, widths = 'edge_length = "0.8 mm"', 'filter_radius = "1.5 mm"\nline_width = "4 mm"'
    path.write_text(f'kind = "bend"\n[skin]\n{skin}\n[design]\n{widths}\nlevels = 1\n', "utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path)]) == 2
    assert f"{path}, line 6: " in capsys.readouterr().err
    path.write_text('kind = "bend"\n[design]\nfilter_radius = "15 mm"\n', "utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path), "--coarse"]) == 0
    path.write_text('kind = "twist"\n[design]\nline_width = "20 mm"\n', "utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path), "--coarse"]) == 0


def test_design_is_refused_with_line_and_leaves_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.toml"
    path.write_text('kind = "bend"\n[target]\nangle = 700\n', encoding="utf-8")
    run_folder = tmp_path / "run"
    assert run(MPI.COMM_SELF, ["design", str(path), "--output", str(run_folder)]) == 2
    assert f"{path}, line 3: angle: " in capsys.readouterr().err
    assert not run_folder.exists()


def test_own_mesh_too_coarse_to_bend() -> None:
    def own(edge: float) -> OwnMeshScene:
        pattern = cylinder(MPI.COMM_SELF, 0.1, 0.02, edge, mesh="structured")
        return replace(OwnMeshScene.of(bend=60.0), read=OwnSkin(pattern))

    with pytest.raises(ParameterError, match="halved by each step.*remesh"):
        doubts(own(0.011))
    assert doubts(own(2e-3)) == []


def test_a_line_on_the_axis_may_keep_its_length() -> None:
    """A bend about the axis stretches the outer side by half of what one about the wall does."""
    pattern = cylinder(MPI.COMM_SELF, 0.1, 0.02, 4e-3, mesh="structured")

    def strain(neutral: float | None) -> float:
        scene = replace(OwnMeshScene.of(bend=60.0, neutral=neutral), read=OwnSkin(pattern))
        return next(group.value for group in scene.groups() if group.name == "bound")

    assert strain(0.0) == pytest.approx(strain(None) / 2)


def case_of(factor: float) -> tf.Case:
    """A tube whose target is it, a factor as large."""
    pattern = cylinder(MPI.COMM_SELF, 0.06, 0.02, 5e-3, mesh="structured")
    held = tf.clamp(pattern, ["base"])
    return tf.Case(pattern, factor * pattern.points, held, 5e3, parts=[tf.ShapePart()])


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1.0, ""),
        (1.4, ""),
        (0.97, "its area is 94% of that of the cut panels"),
        (2.0, "on 100% of its area the fabric stretches by more than c1 = 1.9 (up to 2)"),
    ],
)
def test_a_target_that_no_fabric_takes_is_doubted(factor: float, said: str) -> None:
    found = target_doubts(case_of(factor))
    assert len(found) == bool(said)
    assert said in "".join(found)


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_targets_of_the_demos_are_beyond_doubt(path: Path) -> None:
    read = read_scene(path, coarse=True)
    if isinstance(read.config, ActuatorScene):
        config = read.config.with_files(MPI.COMM_SELF, read.files)
        assert target_doubts(config.case(MPI.COMM_SELF, config.levels[0])) == []


def test_check_tells_doubts_of_a_target(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bend about a line on the outer side of the axis shortens most of the wall."""
    path = tmp_path / "a.toml"
    path.write_text('kind = "bend"\n[target]\nneutral = "-4 mm"\n', encoding="utf-8")
    assert run(alone, ["check", str(path), "--coarse"]) == 0
    said = capsys.readouterr()
    assert "doubt       target: its area is " in said.out
    assert 'edge_length = "2.8 mm" (not "1.4 mm")' in said.err
