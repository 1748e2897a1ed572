"""The schema takes what the reader takes, and marks what it refuses."""

import json
import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene, scene_schema, scene_text
from toros_fem.products.kinds import KINDS

WRONG = [
    'kind = "bent"', "[pressure]\npresure = 1", "[pressure]\npressure = -1",
    '[pressure]\npressure = "3 mm"', "[design]\nseed = 0.5", "[design]\nlevels = 0",
    '[skin]\nmesh = "hexagons"', '[skin]\nwhole = "yes"', "[skin]\nlength = true",
    "[material]\nfabric = 3", "[coarse]\nlenght = 1", "skin = 3", "[lines]\nshare_limit = 0.95",
]  # fmt: skip


def taplo(schema: Path, *scenes: Path) -> str:
    """Return what the checker that editors use says of scenes; "" of right ones."""
    told = subprocess.run(
        ["taplo", "check", "--schema", f"file://{schema}", *map(str, scenes)],
        capture_output=True, text=True, env={**os.environ, "RUST_LOG": "error"},
    )  # fmt: skip
    assert told.returncode == bool(told.stderr), told
    return told.stderr


def written(folder: Path, name: str) -> Path:
    path = folder / f"{name}.schema.json"
    path.write_text(json.dumps(scene_schema(KINDS[name])), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", list(KINDS))
def test_new_scenes_fit_with_every_key(tmp_path: Path, name: str) -> None:
    text = scene_text(KINDS[name].example(), KINDS[name].EXAMPLE_FILES)
    live = re.sub(r"^#(?=\w+ = |\[)", "", text, flags=re.MULTILINE)
    live = live.replace(' = ""', ' = "none"')
    scenes = [tmp_path / "new.toml", tmp_path / "live.toml"]
    for path, content in zip(scenes, (text, live), strict=True):
        path.write_text(content, encoding="utf-8")
    of_demos = [
        path
        for path in sorted((ROOT / "demos" / "scenes").glob("*.toml"))
        if tomllib.loads(path.read_text("utf-8"))["kind"] == name
    ]
    assert taplo(written(tmp_path, name), *scenes, *of_demos) == ""


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_values_are_marked(tmp_path: Path, wrong: str) -> None:
    path, kind = tmp_path / "wrong.toml", "" if "kind" in wrong else 'kind = "bend"\n'
    path.write_text(f"{kind}{wrong}", encoding="utf-8")
    assert "error" in taplo(written(tmp_path, "bend"), path)
    with pytest.raises(FileError):
        read_scene(path)


def test_a_new_scene_names_its_schema(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert run(MPI.COMM_SELF, ["new", "bend", str(path), "--schema"]) == 0
    assert path.read_text("utf-8").startswith("#:schema ./mine.schema.json\n")
    found = json.loads((tmp_path / "mine.schema.json").read_text("utf-8"))
    assert found == scene_schema(KINDS["bend"])
    path.unlink()
    assert run(MPI.COMM_SELF, ["new", "bend", str(path), "--schema"]) == 2  # the schema is there
    assert not path.exists()
