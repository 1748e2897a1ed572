"""The page on scene files says what the code does."""

import re
from pathlib import Path

import pytest
from helpers.scenes import ROOT

from toros_fem.base.units import DIMENSIONS
from toros_fem.cli.scene_files.reading import read_scene
from toros_fem.products.kinds import ABOUT, KINDS

PAGE = (ROOT / "docs" / "scene_files.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_kinds() -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| (.*) \| (yes|no) \| (yes|no) \|$", PAGE, re.MULTILINE)
    word = {True: "yes", False: "no"}
    can = {k: [word[hasattr(of, f"run_{a}")] for a in ("design", "simulation")]
           for k, of in KINDS.items()}  # fmt: skip
    assert rows == [(kind, about, *can[kind]) for kind, about in ABOUT.items()]


def test_units() -> None:
    for meaning, units in DIMENSIONS.values():
        assert f"| {meaning} | {', '.join(units)} |\n" in PAGE


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_examples_are_scenes(tmp_path: Path, number: int) -> None:
    assert len(BLOCKS) == 3
    (tmp_path / "a.toml").write_text(BLOCKS[number], encoding="utf-8")
    found = read_scene(tmp_path / "a.toml")
    assert found.config != found.kind()
    assert read_scene(found.path, coarse=True).config != found.config
