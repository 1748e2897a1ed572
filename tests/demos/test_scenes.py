"""Each demo as a scene file, and the example of a finger from an STL file."""

import tomllib

import pytest
from helpers.scenes import ROOT

from toros_fem.cli.scene_files import read_scene
from toros_fem.products.kinds import KINDS
from toros_fem.products.own_mesh import OwnMeshScene

FOLDER = ROOT / "demos" / "scenes"
CONFIGS = {
    name.replace("-", "_"): (kind(), kind.coarse)
    for name, kind in KINDS.items()
    if name != "own-mesh"
}
# They are no scenes: one compares six designs, the other pulls a sheet of tiles.
OTHERS = {"three_field", "tile_sheet"}


def test_every_demo_is_a_scene() -> None:
    demos = {path.stem for path in (ROOT / "demos").glob("*.py")} - OTHERS
    assert {path.stem for path in FOLDER.glob("*.toml")} == demos == {*CONFIGS, "own_design"}


# Demos whose figures come from a finer mesh.
CHECKED = {"bend": 2.0, "walker": 2.0}


@pytest.mark.parametrize("name", list(CONFIGS))
def test_scene_has_the_defaults_of_its_kind(name: str) -> None:
    path, (config, coarse) = FOLDER / f"{name}.toml", CONFIGS[name]
    if name in CHECKED:
        config = config.updated(check_refinement=CHECKED[name])
    found = read_scene(path)
    assert found.config == config
    assert name.replace("_", "-") == found.kind.KIND
    assert read_scene(path, coarse=True).config == coarse(config)
    # The file says something: none of its values is left to the defaults alone.
    assert len(tomllib.loads(path.read_text(encoding="utf-8"))) > 1


def test_example_of_a_finger() -> None:
    found = read_scene(ROOT / "examples" / "finger.toml")
    config = found.config
    assert isinstance(config, OwnMeshScene)
    assert found.files["mesh"].resolve() == ROOT / "demos" / "surfaces" / "finger.stl"
    assert (len(config.held), len(config.printed), len(config.plain)) == (1, 2, 1)
    assert config.level_count == 2
    quick = read_scene(found.path, coarse=True).config
    assert isinstance(quick, OwnMeshScene)
    assert quick.level_count == 1
    assert (quick.design.filter_radius, config.design.filter_radius) == (4e-3, 2e-3)
