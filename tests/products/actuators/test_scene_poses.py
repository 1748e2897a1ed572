"""Scenes with further poses: what they read, and what a run tells of each."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.cli.scene_files import read_scene, scene_text
from toros_fem.design.loop.blocked import Blocked
from toros_fem.measures.figures import largest_part
from toros_fem.mechanics.terms.loads import GRAVITY
from toros_fem.products.actuators import corrections
from toros_fem.products.actuators.cost import OF_RANK
from toros_fem.products.actuators.pressure import OTHER_SHAPE
from toros_fem.products.tubes import BendScene, TwistScene
from toros_fem.products.walker import WalkerScene
from toros_fem.results.runs.stored_run import read_run

HEAD = 'kind = "bend"\n[target]\nangle = 60\n[pressure]\npressure = "6 kPa"\n'
POSES = HEAD + (
    '[[pose]]\nangle = "30 deg"\npressure = "3 kPa"\n'
    '[[pose]]\nname = "loaded"\nimportance = 2\nhung_mass = "5 g"\n'
)


def scene_of(folder: Path, text: str) -> BendScene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    found = read_scene(path).config
    assert isinstance(found, BendScene)
    return found


def test_poses_have_what_differs(alone: MPI.Comm, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, POSES).updated(edge_length=5e-3)
    case = scene.case_of_poses(alone, scene.finest_level)
    half, loaded = case.poses
    assert [one.pressure for one in (case, half, loaded)] == [6e3, 3e3, 6e3]
    assert [one.pressure_bounds for one in (case, half, loaded)] == [None] * 3
    assert [one.judged[0].target for one in (case, half, loaded)] == [60, 30, 60]
    assert (half.name, loaded.name, loaded.importance) == (None, "loaded", 2)
    assert half.pattern is case.pattern
    # A plane of symmetry halves the tube, and what it carries.
    assert loaded.force is not None
    pull = loaded.force.sum(axis=0)
    assert pull == pytest.approx([-5e-3 * GRAVITY / 2, 0, 0])
    assert not np.any(loaded.force[case.pattern.points[:, 2] < 0.149])
    assert case.force is None


def test_a_blocked_tip_is_where_a_bend_puts_it(alone: MPI.Comm, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, f"{HEAD}[[pose]]\nblocked_angle = 30\nblocked_force = 0.4\n")
    case = scene.case_of_poses(alone, scene.updated(edge_length=5e-3).finest_level)
    (pose,) = case.poses
    assert pose.blocked is not None
    assert pose.blocked.force == 0.4
    # An arc of 0.15 m by 30°, whose inner side at 0.01 m keeps its length.
    angle, arc = np.radians(30), 0.15 / np.radians(30) + 0.01
    x, z = arc * (1 - np.cos(angle)), arc * np.sin(angle)
    assert pose.blocked.pose == pytest.approx((x, 0, z - 0.15, 0, angle, 0), abs=1e-3)
    assert pose.blocked.free == (False, False, True, False, True, False)


def test_a_written_scene_reads_the_same(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, POSES)
    again = scene_of(tmp_path, scene_text(scene))
    assert again == scene
    assert again.as_dict()["poses"] == [
        {"angle": 30.0, "pressure": 3e3},
        {"name": "loaded", "importance": 2.0, "hung_mass": 5e-3},
    ]
    assert "poses" not in BendScene().as_dict()


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ("angel = 3", "line 7.*did you mean 'angle'"),
        ("length = 0.1", "line 7.*unknown key 'length'; known are name, importance, angle"),
        ("hold_pressure = true", "line 7.*unknown key"),
        ("angle = 9000", "line 7.*at most 720"),
        ('name = "half way"', "line 7.*must be an identifier"),
        ("importance = 0", "line 7.*above 0"),
    ],
)
def test_wrong_keys_are_told(tmp_path: Path, pose: str, words: str) -> None:
    with pytest.raises(FileError, match=words):
        scene_of(tmp_path, f"{HEAD}[[pose]]\n{pose}\n")


def test_names_of_poses_differ(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="line 9.*name = 'a' is that of two poses"):
        scene_of(tmp_path, f'{HEAD}[[pose]]\nname = "a"\n[[pose]]\nname = "a"\n')


def test_what_the_first_pose_cannot_have(alone: MPI.Comm) -> None:
    scene = BendScene.of(blocked_angle=30.0, edge_length=5e-3)
    with pytest.raises(ParameterError, match=r"Write it in a table \[\[pose\]\]"):
        scene.case_of_poses(alone, scene.finest_level)


def test_robots_check_their_poses() -> None:
    """A walker knows contact in its gait alone."""
    with pytest.raises(ParameterError, match="unknown key 'friction'"):
        WalkerScene(poses=({"friction": 0.3},))
    with pytest.raises(ParameterError, match="bent_length"):
        WalkerScene(poses=({"bent_length": 3.0},))


@pytest.mark.parametrize(("asked", "pushes", "next_asked"), [(0.9, 0.8, 1.0), (0.9, 3.0, 0.9)])
def test_a_push_beyond_what_is_asked_stays(asked: float, pushes: float, next_asked: float) -> None:
    """A least force is not asked down."""
    blocked = Blocked("tip", (0.0,) * 6, (1.0, 0.0, 0.0), 0.9)
    case = SimpleNamespace(blocked=blocked, asks=np.array(0.9))
    of = SimpleNamespace(metrics_of=lambda _: {"pose_2_force_n": pushes}, case=case)
    printed: Any = SimpleNamespace(problem=of, equilibrium=None)
    problem: Any = of
    found = corrections._target(problem, printed, printed, np.array(asked))
    assert found == pytest.approx(next_asked)


def test_lines_are_laid_for_one_pose() -> None:
    with pytest.raises(ParameterError, match="start = 'random'"):
        TwistScene(poses=({"twist": 60.0},))
    scene = TwistScene.of(start="random")
    assert TwistScene(design=scene.design, poses=({"twist": 60.0},)).poses


@pytest.mark.slow
def test_a_run_tells_all_poses(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figures with intervals, entries, frames with targets, and a picture."""
    small = BendScene.of(
        length=0.06, edge_length=4e-3, filter_radius=6.2e-3, iterations=8, levels=1, angle=35.0,
        constrained_iterations=2, polish_iterations=0, corrections=1, level_iterations=2,
        pressure=6e3, **{**DESIGN_ALONE, "estimate_error": True, "curve_pressure": 6e3},
        curve_steps=1,
    )  # fmt: skip
    poses = ({"angle": 20.0, "pressure": 3e3}, {"name": "loaded", "hung_mass": 5e-3})
    scene = type(small)(**{**vars(small), "poses": poses})
    from toros_fem.products.actuators import pressure

    monkeypatch.setattr(pressure, "_joins_rest", lambda *_: False)
    made = scene.run_design(alone, tmp_path)
    keys = [figure.key for figure in made.figures if figure.state is not None]
    shape = ["shape_distance_percent", "tip_direction_deg"]
    assert keys == [
        "angle_deg", "pose_2_angle_deg", "loaded_angle_deg",
        *(before + key for before in ("", "pose_2_", "loaded_") for key in shape),
    ]  # fmt: skip
    assert all(made.intervals[key] > 0 for key in keys)
    worst = made.printed.evaluation
    assert worst is not None
    assert largest_part(made.figures) > 0
    assert made.value("pose_2_pressure_pa") == pytest.approx(made.pressure / 2)
    assert f"pose_2: {OTHER_SHAPE}" in made.binding
    assert f"loaded: {OTHER_SHAPE}" in made.binding
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert set(summary["poses"]) == {"pose_2", "loaded"}
    assert summary["inputs"]["poses"][1] == {"name": "loaded", "hung_mass": 5e-3}
    # What hangs from the tip is on another path over the pressure.
    run = read_run(tmp_path)
    point, length = run.over_pressure(made.pressure).poses
    assert (point.key, length.key) == ("angle_deg", "length_ratio")
    assert point.pressure == pytest.approx(made.pressure / 2)
    assert point.figure.target == 20
    frames = run.series["pose"]
    assert [frame.number for frame in frames] == [1, 2, 3]
    assert len({frame.skin for frame in frames}) >= 2, "poses have targets of their own"
    assert (tmp_path / "poses.png").stat().st_size > 10_000


def test_each_pose_takes_memory(alone: MPI.Comm, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, POSES).updated(edge_length=5e-3)
    three, one = (of.expected_cost(alone).memory for of in (scene, BendScene.of(edge_length=5e-3)))
    assert three - OF_RANK == pytest.approx(3 * (one - OF_RANK))
