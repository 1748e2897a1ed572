"""What is told after a run of a scene."""

from pathlib import Path

from toros_fem.cli.command_line.running import beyond_tests
from toros_fem.cli.scene_files.reading import read_scene


def test_fabric_beyond_its_tests(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('kind = "bend"\n[material]\nfabric = "rib-knit"\n', encoding="utf-8")
    scene = read_scene(path)
    assert scene.materials["fabric"].stretch_range == (1.0, 1.15)
    assert "known up to 1.15" in beyond_tests(scene, 0.88)
    assert beyond_tests(scene, 0.1) == beyond_tests(scene, None) == ""
    path.write_text('kind = "bend"\n', encoding="utf-8")
    assert beyond_tests(read_scene(path), 0.88) == ""
