"""The schema takes what the reader takes, and marks what it refuses."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files.layout import scene_schema
from toros_fem.cli.scene_files.writing import scene_text
from toros_fem.products.kinds import KINDS

TYPES: dict[str, Any] = {
    "object": dict, "array": list, "string": str, "boolean": bool, "integer": int,
    "number": (int, float),
}  # fmt: skip


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """Check a value by the words of JSON schema that are used here."""
    if "anyOf" in schema:
        return any(fits(value, one) for one in schema["anyOf"])
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    kind = schema["type"]
    if not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean"):
        return False
    if kind == "object":
        known = schema["properties"]
        return all(name in known and fits(one, known[name]) for name, one in value.items())
    if kind == "array":
        return all(fits(one, schema["items"]) for one in value)
    if kind == "string":
        return bool(re.search(schema.get("pattern", ""), value))
    if kind == "boolean":
        return True
    low, high = schema.get("minimum", value), schema.get("maximum", value)
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    strictly = (above is None or value > above) and (below is None or value < below)
    return bool(low <= value <= high and strictly)


@pytest.mark.parametrize("name", list(KINDS))
def test_new_scenes_fit_with_every_key(name: str) -> None:
    text = scene_text(KINDS[name].example(), KINDS[name].EXAMPLE_FILES)
    live = re.sub(r"^#(?=\w+ = |\[)", "", text, flags=re.MULTILINE)
    live = live.replace(' = ""', ' = "none"')
    for content in (text, live):
        assert fits(tomllib.loads(content), scene_schema(KINDS[name]))


def test_scenes_of_the_demos_fit() -> None:
    for path in sorted((ROOT / "demos" / "scenes").glob("*.toml")):
        content = tomllib.loads(path.read_text("utf-8"))
        assert fits(content, scene_schema(KINDS[content["kind"]])), path.name


@pytest.mark.parametrize(
    "wrong",
    [
        "[pressure]\npresure = 1", "[pressure]\npressure = -1", '[pressure]\npressure = "3 mm"',
        "[design]\nseed = 0.5", "[design]\nlevels = 0", '[skin]\nmesh = "hexagons"',
        '[skin]\nwhole = "yes"', "[skin]\nlength = true", '[material]\nfabric = 3',
        "[coarse]\nlenght = 1", "skin = 3", "[lines]\nshare_limit = 0.95",
    ],
)  # fmt: skip
def test_wrong_values_are_marked(wrong: str) -> None:
    schema = scene_schema(KINDS["bend"])
    assert not fits(tomllib.loads(f'kind = "bend"\n{wrong}'), schema)
    assert not fits({"kind": "bent"}, schema)


def test_a_new_scene_names_its_schema(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert run(MPI.COMM_SELF, ["new", "bend", str(path), "--schema"]) == 0
    assert path.read_text("utf-8").startswith("#:schema ./mine.schema.json\n")
    found = json.loads((tmp_path / "mine.schema.json").read_text("utf-8"))
    assert found == scene_schema(KINDS["bend"])
    path.unlink()
    assert run(MPI.COMM_SELF, ["new", "bend", str(path), "--schema"]) == 2  # the schema is there
    assert not path.exists()
