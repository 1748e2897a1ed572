"""Scene files that are written: they hold all keys, and are read again as the same."""

import re
from pathlib import Path

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.cli.scene_files import WIDTH, read_scene, scene_text
from toros_fem.products.kinds import KINDS
from toros_fem.products.own_mesh import Held, OwnMeshScene, Printed
from toros_fem.products.own_metrics import MetricTable


@pytest.mark.parametrize("name", list(KINDS))
def test_new_file_holds_all_keys_once(tmp_path: Path, name: str) -> None:
    kind = KINDS[name]
    path = tmp_path / "new.toml"
    path.write_text(scene_text(kind.example(), kind.EXAMPLE_FILES), encoding="utf-8")
    found = read_scene(path)
    assert found.config == kind.example()
    assert {key: value.name for key, value in found.files.items()} == kind.EXAMPLE_FILES
    body, _, quick = path.read_text(encoding="utf-8").partition("\n[coarse]\n")
    several = rf"^#?\[({'|'.join(kind.entries()) or '-'})\]\n(#?\w+ = .*\n?)+"
    keys = re.findall(r"^#?(\w+) = ", re.sub(several, "", body, flags=re.MULTILINE), re.MULTILINE)
    once = [key for key in keys if key not in ("kind", *kind.files())]
    assert sorted(once) == sorted(kind.described()), "each key stands in the file, and once"
    assert max(map(len, body.splitlines())) <= WIDTH
    # Taking the # away before all keys changes nothing: what stands behind them is the default.
    live = re.sub(r"^#(?=\w+ = )", "", body.replace("#[", "["), flags=re.MULTILINE)
    live = re.sub(r'^(\w+) = ""$', r'\1 = "none"', live, flags=re.MULTILINE)
    live = re.sub(r'^(where|of) = "none"$', r'\1 = "z < 1"', live, flags=re.MULTILINE)
    path.write_text(live, encoding="utf-8")
    changed = read_scene(path).config
    none = dict.fromkeys(changed.entries(), ())
    assert changed.updated(**none) == kind.example().updated(**none)
    # The table of the quick variant shows what it changes.
    path.write_text(body + "\n[coarse]\n" + quick.replace("#", ""), encoding="utf-8")
    assert read_scene(path, coarse=True).config == kind.example().coarse()


def test_other_values_are_read_again(tmp_path: Path) -> None:
    config = OwnMeshScene.of(
        scale=1e-2 / 3,
        held=(Held(where='z < 5 mm'), Held(panels='a"b, c\\d', components="x")),
        printed=(Printed(where="x > 0", panels="ä"),),
        bend=1 / 3,
        bending=None,
        perimeter_weight=1e-4,
        pressure=1e5 / 7,
        seed=12,
        metrics="angle, distance",
        metric=(MetricTable(of="base, tip", measure="tip"),),
    )  # fmt: skip
    path = tmp_path / "own.toml"
    path.write_text(scene_text(config, {"mesh": "my file.stl"}), "utf-8")
    found = read_scene(path)
    assert found.config == config
    assert found.files == {"mesh": tmp_path / "my file.stl"}


def test_what_is_refused() -> None:
    with pytest.raises(ParameterError, match="files names 'mash'"):
        scene_text(OwnMeshScene(), {"mash": "a"})
