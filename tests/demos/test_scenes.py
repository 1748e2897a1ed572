"""Each demo as a scene file, and the example of a finger from an STL file."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from demo_runs import DEMOS
from helpers.scenes import ROOT, shared
from mpi4py import MPI

from demos import own_design
from toros_fem.base.config import Config
from toros_fem.cli.scene_files.reading import read_scene
from toros_fem.products.own_mesh.own_mesh import OwnMeshConfig
from toros_fem.products.tile_design import tile
from toros_fem.products.tiles import pulled_sheet

FOLDER = ROOT / "demos" / "scenes"
CONFIGS: dict[str, tuple[Config, Callable[[Any], Any]]] = {
    **{name: (demo.config, demo.coarse) for name, demo in DEMOS.items()},
    "tile": (tile.TargetTileConfig(), tile.coarse),
    "tile_sheet": (pulled_sheet.TileSheetConfig(), pulled_sheet.coarse),
}
# They are no scenes: the one compares six designs, the other is the command `toros unwrap`.
OTHERS = {"three_field", "unwrap"}


def test_every_demo_is_a_scene() -> None:
    demos = {path.stem for path in (ROOT / "demos").glob("*.py")} - OTHERS
    assert {path.stem for path in FOLDER.glob("*.toml")} == demos == {*CONFIGS, "own_design"}


@pytest.mark.parametrize("name", list(CONFIGS))
def test_scene_has_the_numbers_of_the_demo(name: str) -> None:
    path, (config, coarse) = FOLDER / f"{name}.toml", CONFIGS[name]
    found = read_scene(path)
    assert found.config == config
    assert found.kind.name == name.replace("_", "-")
    assert read_scene(path, coarse=True).config == coarse(config)
    # The file says something: none of its values is left to the defaults alone.
    assert len(tomllib.loads(path.read_text(encoding="utf-8"))) > 1


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_own_design_gives_the_same_numbers(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = shared(comm, tmp_path)
    changes = ["iterations=2", "constrained_iterations=1", "bend=45 deg"]
    found = read_scene(FOLDER / "own_design.toml", comm=comm, changes=changes)
    assert found.kind.design is not None
    scene = found.kind.design.run(comm, folder / "scene", found.config, **found.files)
    short = own_design.OwnDesignConfig(iterations=2, constrained_iterations=1, angle=45.0)
    script = own_design.run(comm, folder / "script", short)
    same = ("triangles", "pressure_pa", "objective_last", "distance_mm", "volume_m3")
    assert [scene[key] for key in same] == [script[key] for key in same]
    assert scene["design"]["distance_mm"] == script["design"]["distance_mm"]
    assert scene["manufacture"]["border_mm"] == script["manufacture"]["border_mm"]


def test_example_of_a_finger() -> None:
    found = read_scene(ROOT / "examples" / "finger.toml")
    config = found.config
    assert isinstance(config, OwnMeshConfig)
    assert found.files["mesh"].resolve() == ROOT / "demos" / "surfaces" / "finger.stl"
    assert (len(config.held), len(config.printed), len(config.plain)) == (1, 2, 1)
    assert config.level_count == 2
    quick = read_scene(found.path, coarse=True).config
    assert isinstance(quick, OwnMeshConfig)
    assert quick.level_count == 1
    assert (quick.filter_radius, config.filter_radius) == (4e-3, 2e-3)
