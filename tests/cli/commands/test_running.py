"""What is told after a run of a scene."""

from pathlib import Path

import pytest

from toros_fem.cli.running import narrower
from toros_fem.cli.scene_files import read_scene


def test_the_tested_stretch_comes_with_the_name_of_a_fabric(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('kind = "bend"\n[material]\nfabric = "rib-knit"\n', encoding="utf-8")
    assert read_scene(path).config.value("tested_stretch") == 1.15
    path.write_text('kind = "bend"\n', encoding="utf-8")
    assert read_scene(path).config.value("tested_stretch") is None


@pytest.mark.parametrize(
    ("kind", "results", "state", "said"),
    [
        ("bend", "", "not certain", True),
        ("bend", "check_refinement = 2", "not certain", False),
        ("twist", "", "not certain", True),
        ("bend", "", "missed", False),
        ("bend", "", None, False),
        ("tile", "", "not certain", False),
    ],
)
def test_an_uncertain_run_says_how_to_go_on(
    kind: str, results: str, state: str | None, said: bool, tmp_path: Path
) -> None:
    """Unless it was compared with a finer mesh already, or its kind cannot be."""
    path = tmp_path / "a.toml"
    path.write_text(f'kind = "{kind}"\n[results]\n{results}\n' if results else f'kind = "{kind}"\n')
    words = narrower(read_scene(path), Path("run"), {"verdict": {"state": state}})
    assert bool(words) == said
    assert ("other lines" in "".join(words)) == (kind == "twist")
    if said:
        assert words[-1].endswith(" resume run --set check_refinement=2")
        # a finer mesh was tried without being asked for
        tried = {"verdict": {"state": state}, "errors": {"meshes": {"1.0": {}, "0.5": {}}}}
        words = narrower(read_scene(path), Path("run"), tried)
        assert words[-1].endswith("--set check_refinement=4")
