"""The page on scene files says what the code does."""

import re
from pathlib import Path

import pytest
from helpers.scenes import ROOT

from toros_fem.base.keys import DIMENSIONS
from toros_fem.cli.scene_files import read_scene
from toros_fem.products.kinds import ABOUT, KINDS

PAGE = (ROOT / "docs" / "scene_files.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_kinds() -> None:
    both, one = PAGE.partition("## Kinds\n")[2].partition("## ")[0].split("can be designed and")
    can = {kind: {of for of in ("design", "simulation") if hasattr(KINDS[kind], f"run_{of}")}
           for kind in ABOUT}  # fmt: skip
    assert set(re.findall(r"`([\w-]+)`", both)) == {k for k, of in can.items() if len(of) == 2}
    assert set(re.findall(r"`([\w-]+)`", one)) == {k for k, of in can.items() if len(of) == 1}


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
