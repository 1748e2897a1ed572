"""Studies: their values, their table, and that they go on."""

import csv
from pathlib import Path

import pytest
from helpers.command_runs import changes
from mpi4py import MPI

from toros_fem.base.errors import FileError, OutputError, ParameterError
from toros_fem.cli.commands.main import run
from toros_fem.cli.running import Trial, combinations, rows_of, run_study, values_of
from toros_fem.cli.scene_files import keys_of, read_scene
from toros_fem.measures.figures import Figure
from toros_fem.products.kinds import KINDS
from toros_fem.results.runs.stored_run import Summary

KEYS = {key: one for of in keys_of(KINDS["bend"]).values() for key, one in of.items()}
SMALL = 'kind = "inflate"\n[skin]\nlength = "60 mm"\nedge_length = "6 mm"\n[pressure]\nlevels = 2\n'


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("pressure=2..10kPa:5", [2e3, 4e3, 6e3, 8e3, 10e3]),
        ("pressure=2000..4000:3", [2e3, 3e3, 4e3]),
        ("pressure.pressure=1kPa,2kPa", [1e3, 2e3]),
        ("seed=1..4", [1, 2, 3, 4]),
        ("seed=7", [7]),
        ("angle=-90..90:3", [-90.0, 0.0, 90.0]),
        ("length=10..20 cm:2", [0.1, 0.2]),
        ("fabric=jersey-light,rib-knit", ["jersey-light", "rib-knit"]),
        ("bladder_thickness=none,0.2 mm", [None, 2e-4]),
        ("hold_pressure=true,false", [True, False]),
    ],
)
def test_values(words: str, values: list[object]) -> None:
    key, found = values_of(words, KEYS)
    assert key == words.partition("=")[0].rpartition(".")[2]
    assert found == pytest.approx(values) if isinstance(values[0], float) else found == values


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("pressure", "write KEY=VALUES"),
        ("presure=1,2", "did you mean 'pressure'"),
        ("pressure=1..2kPa", "how many values"),
        ("pressure=1..2kPa:1", "how many values, 2 to 10000"),
        ("pressure=5..5kPa:3", "not different"),
        ("pressure=1..2 m:3", "a length"),
        ("seed=4..1", "there is none"),
        ("fabric=a..b", "needs numbers"),
        ("pressure=1..2kPa:99999", "how many values, 2 to 10000"),
    ],
)
def test_wrong_values(words: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        values_of(words, KEYS)


def test_combinations() -> None:
    found = combinations({"a": [1, 2], "b": [3, 4]})
    assert [tuple(one.values()) for one in found] == [(1, 3), (1, 4), (2, 3), (2, 4)]
    with pytest.raises(ParameterError, match="more than"):
        combinations({"a": range(200), "b": range(200)})


def test_a_target_that_varies_has_a_column_beside_what_was_found(
    alone: MPI.Comm, tmp_path: Path
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(SMALL, encoding="utf-8")
    scene = read_scene(path, comm=alone)
    trials = [
        Trial({"angle": asked}, tmp_path, scene, Summary({"angle_deg": found}, {}))
        for asked, found in [
            (60.0, Figure("angle", "deg", 57.0, 1.0, 60.0, 1.8)),
            (90.0, Figure("angle", "deg", 88.0, 2.0, 90.0, 2.7)),
        ]
    ]
    rows = rows_of({"angle": KEYS["angle"]}, trials)
    assert [row["given_angle_deg"] for row in rows] == [60.0, 90.0]
    assert [row["angle_deg"] for row in rows] == [57.0, 88.0]
    assert [row["angle_state"] for row in rows] == ["missed", "not certain"]


@pytest.mark.slow
def test_study_makes_one_table_and_goes_on(alone: MPI.Comm, tmp_path: Path) -> None:
    scene, output = tmp_path / "a.toml", tmp_path / "study"
    scene.write_text(SMALL, encoding="utf-8")
    words = ["study", str(scene), "--simulate", "--output", str(output)]
    over = ["--over", "highest_pressure=12..16kPa:2"]
    assert run(alone, [*words, *over]) == 0
    with (output / "study.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["highest_pressure_pa"]) for row in rows] == [12e3, 16e3]
    wide = [float(row["radius_percent"]) for row in rows]
    assert 0 < wide[0] < wide[1]
    assert (output / "study.png").stat().st_size > 10_000
    first = (output / "highest_pressure=12000" / "summary.json").stat().st_mtime_ns
    assert run(alone, [*words, "--over", "highest_pressure=12..16kPa:3"]) == 0
    assert (output / "study.csv").read_text(encoding="utf-8").count("\n") == 4
    assert (output / "highest_pressure=12000" / "summary.json").stat().st_mtime_ns == first
    scene.write_text(SMALL.replace("60 mm", "70 mm"), encoding="utf-8")
    run_study(alone, scene, {"highest_pressure": [12e3]}, output, command="simulate")
    assert (output / "highest_pressure=12000" / "summary.json").stat().st_mtime_ns != first, "anew"


def test_wrong_values_are_told_before_anything_runs(alone: MPI.Comm, tmp_path: Path) -> None:
    scene, output = tmp_path / "a.toml", tmp_path / "study"
    scene.write_text(SMALL, encoding="utf-8")
    with pytest.raises((FileError, ParameterError)):
        run_study(alone, scene, {"pressure": [4e3, -1.0]}, output)
    assert not output.exists()


@pytest.mark.slow
def test_failed_runs_are_told(alone: MPI.Comm, tmp_path: Path) -> None:
    scene, output = tmp_path / "a.toml", tmp_path / "study"
    scene.write_text('kind = "bend"\n', encoding="utf-8")
    words = ["study", str(scene), "--output", str(output), *changes(), "--over", "angle=700"]
    assert run(alone, words) == 3
    text = (output / "study.csv").read_text(encoding="utf-8")
    assert "a smaller target" in text


def test_a_table_of_somebody_else_stays(alone: MPI.Comm, tmp_path: Path) -> None:
    scene, output = tmp_path / "a.toml", tmp_path / "study"
    scene.write_text(SMALL, encoding="utf-8")
    output.mkdir()
    (output / "study.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match=r"has study\.csv, which would"):
        run_study(alone, scene, {"highest_pressure": [12e3]}, output, command="simulate")
    assert (output / "study.csv").read_text(encoding="utf-8") == "mine"
