"""Materials of a scene by name."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.cli.scene_files import read_scene, scene_text
from toros_fem.materials.library.files import read_library, write_material
from toros_fem.materials.sheet import Bladder, Material, print_offset, reinforced
from toros_fem.products.kinds import KINDS
from toros_fem.products.tubes import BendScene

LIBRARY = read_library()


def scene(folder: Path, text: str, **options: Any) -> Any:
    path = folder / "my.toml"
    path.write_text(f'kind = "bend"\n{text}', encoding="utf-8")
    return read_scene(path, **options)


def sheet(name: str) -> Material:
    """A fabric as the composite has it, whose bounds are those of both materials."""
    return replace(LIBRARY[name].material, c1=None, c2=None)


def test_names_of_the_defaults_are_the_defaults(tmp_path: Path) -> None:
    text = '[material]\nfabric = "jersey-light"\nreinforcement = "printed-tpu-95a-on-jersey"\n'
    found = scene(tmp_path, text)
    assert found.config.material.composite == BendScene().material.composite
    assert {role: entry.name for role, entry in found.materials.items()} == {
        "fabric": "jersey-light",
        "reinforcement": "printed-tpu-95a-on-jersey",
    }


def test_numbers_of_names(tmp_path: Path) -> None:
    text = """
        [material]
        fabric = "rib-knit"
        reinforcement = "tpu-85a"
        bladder = "dragon-skin-10"
        bladder_thickness = "0.3 mm"
        c1 = 1.7
        """
    material = scene(tmp_path, text).config.material
    composite = material.composite
    knit, layer = LIBRARY["rib-knit"], LIBRARY["tpu-85a"]
    assert composite.fabric == knit.material
    assert composite.knit.ratio == knit.knit_ratio
    assert composite.reinforcement == reinforced(knit.material, layer.material)
    assert composite.print_offset == print_offset(knit.material, layer.material)
    assert composite.print_side is None
    assert material.print_height == layer.thickness != composite.reinforcement.thickness
    assert composite.bladder == Bladder(106e3, 0.3e-3)
    assert (composite.c1, composite.c2) == (1.7, 2.6)


def test_a_print_goes_onto_a_fabric_of_numbers(tmp_path: Path) -> None:
    text = '[material]\nreinforcement = "tpu-85a"\nfabric_young = "1 MPa"\nthickness = "0.8 mm"\n'
    composite = scene(tmp_path, text).config.material.composite
    layer = LIBRARY["tpu-85a"].material
    assert composite.reinforcement == reinforced(composite.fabric, layer)
    assert composite.fabric.young == 1e6


def test_later_layers(tmp_path: Path) -> None:
    """The quick variant, then the command line: each replaces what it names, and no more."""
    text = """
        [material]
        fabric = "swimsuit-knit"
        reinforcement = "tpu-85a"
        [coarse]
        fabric = "jersey-light"
        reinforcement_young = "3 MPa"
        """
    jersey, layer = sheet("jersey-light"), LIBRARY["tpu-85a"].material
    quick = scene(tmp_path, text, coarse=True).config.material.composite
    assert quick.knit is None
    assert quick.fabric == jersey
    assert quick.reinforcement.young == 3e6
    assert quick.reinforcement.thickness == reinforced(jersey, layer).thickness
    found = scene(tmp_path, text, changes=["fabric_young=0.4 MPa", "material.c2=2.2"])
    plain = replace(LIBRARY["swimsuit-knit"].material, young=0.4e6)
    assert found.config.material.composite.fabric == plain
    assert found.config.material.composite.reinforcement == reinforced(plain, layer)
    assert found.config.material.c2 == 2.2
    found = scene(tmp_path, text, coarse=True, changes=["reinforcement = tpu-95a-on-jersey"])
    assert found.config.material.composite.reinforcement == LIBRARY["tpu-95a-on-jersey"].material
    assert found.config.material.print_offset is None
    assert found.config.material.print_height is None
    found = scene(tmp_path, text, changes=["print_offset=0.2 mm"])
    assert found.config.material.print_offset == 0.2e-3


def test_a_number_beats_a_name(tmp_path: Path) -> None:
    """Beside it, and later; a name that comes later beats the numbers before it."""
    text = '[material]\nfabric = "rib-knit"\npoisson = 0.2\nreinforcement = "tpu-85a"\n'
    text += 'reinforcement_thickness = "1 mm"\n'
    knit = LIBRARY["rib-knit"].material
    composite = scene(tmp_path, text).config.material.composite
    assert composite.fabric == replace(knit, poisson=0.2)
    assert composite.reinforcement.thickness == 1e-3
    laid = reinforced(composite.fabric, LIBRARY["tpu-85a"].material)
    assert composite.reinforcement == replace(laid, thickness=1e-3)
    found = scene(tmp_path, text, changes=["knit_ratio=2", "fabric=rib-knit"]).config.material
    assert (found.composite.knit.ratio, found.composite.fabric) == (2.0, knit)


def test_bounds_of_a_print(tmp_path: Path) -> None:
    """A print has its own bounds, and not wider ones than its fabric."""
    narrow = replace(LIBRARY["tpu-85a"], name="narrow", c1=1.4, c2=3.0)
    write_material(tmp_path / "m.toml", narrow)
    text = """
        files.materials = "m.toml"
        [material]
        fabric = "jersey-light"
        reinforcement = "narrow"
        """
    config = scene(tmp_path, text).config
    assert (config.material.reinforcement_c1, config.material.reinforcement_c2) == (1.4, None)
    assert config.material.composite.reinforcement_bounds == (1.4, 2.6)
    assert config.material.composite.fabric_bounds == (1.9, 2.6)
    config = scene(tmp_path, text, changes=["c1=1.3"]).config
    assert config.material.composite.reinforcement_bounds == (1.3, 2.6)
    config = scene(tmp_path, text, changes=["reinforcement=tpu-95a-on-jersey"]).config
    assert config.material.composite.shares_bounds


def test_a_file_of_ones_own(alone: MPI.Comm, tmp_path: Path) -> None:
    mine = replace(LIBRARY["jersey-light"], name="mine", young=77e3)
    write_material(tmp_path / "sub" / "m.toml", mine)
    write_material(tmp_path / "other.toml", replace(mine, young=88e3))
    text = 'kind = "bend"\nfiles.materials = "sub/m.toml"\nmaterial.fabric = "mine"\n'
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    path = tmp_path / "my.toml"
    found = read_scene(path, comm=alone)
    assert found.config.as_dict()["fabric_young"] == 77e3
    assert "materials" not in found.files
    change = f"files.materials={tmp_path / 'other.toml'}"
    found = read_scene(path, comm=alone, changes=[change])
    assert found.config.as_dict()["fabric_young"] == 88e3
    with pytest.raises(FileError, match="line 3: material.fabric: 'mine' is no fabric"):
        read_scene(path, comm=alone, changes=["files.materials=none"])
    with pytest.raises(FileError, match=r"there is no no.toml"):
        read_scene(path, comm=alone, changes=["files.materials=no.toml"])


WRONG = [
    ('[material]\nfabric = "jersy-light"', "line 3: material.fabric: .* mean 'jersey-light'"),
    ('[material]\nfabric = "tpu-85a"', "'tpu-85a' is a print, and a fabric is asked for"),
    ("[material]\nfabric = 3", "line 3: material.fabric: fabric = 3 must be a text in quotes"),
    ('[material]\nfabrik = "x"', "unknown key 'fabrik'; did you mean 'fabric'?"),
    ('[design]\nfabric = "x"', r"line 3: design.fabric: .* in the table \[material\]"),
    ('[coarse]\nbladder = "ecoflex"', "line 3: coarse.bladder: 'ecoflex' is no rubber of the lib"),
    ("[files]\nmaterials = 3", "line 3: files.materials: materials = 3 must be a path in quotes"),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=range(len(WRONG)))
def test_wrong_names(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        scene(tmp_path, text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["fabric=x"], "change 'fabric=x': 'x' is no fabric of the library"),
        (["fabric=3"], "change 'fabric=3': fabric = 3 must be a text in quotes"),
        (["material.fabrik=x"], "unknown key 'fabrik'; did you mean 'fabric'"),
        (["files.materials=3"], "3 must be a path"),
    ],
)
def test_wrong_changes(tmp_path: Path, changes: list[str], message: str) -> None:
    with pytest.raises(FileError, match=message):
        scene(tmp_path, "", changes=changes)


def test_a_scene_without_knit(tmp_path: Path) -> None:
    path = tmp_path / "tile.toml"
    path.write_text('kind = "tile"\nmaterial.fabric = "rib-knit"\n', encoding="utf-8")
    with pytest.raises(FileError, match="'rib-knit' has a knit_ratio, which scenes of this kind"):
        read_scene(path)


def test_written_scene_has_the_numbers_and_says_the_names(tmp_path: Path) -> None:
    found = scene(tmp_path, '[material]\nfabric = "rib-knit"\nreinforcement = "tpu-85a"\n')
    text = scene_text(found.config, materials=found.materials)
    assert '\n# fabric = "rib-knit": rib knit of underwear' in text
    assert '\n# reinforcement = "tpu-85a": TPU 85A, printed layer; data sheet' in text
    again = scene(tmp_path, text.partition('kind = "bend"\n')[2])
    assert again.config == found.config
    assert again.materials == {}
    assert 'reinforcement = "printed-tpu-95a", bladder = ' in scene_text(BendScene()).replace(
        "\n# ", " "
    )
    assert "dragon-skin" not in scene_text(KINDS["tile"]())


def test_masses_of_names(tmp_path: Path) -> None:
    """A walker's fabric has the mass of its name; a number may stand beside the name."""
    path = tmp_path / "walker.toml"
    for more, mass in (("", 0.276), ('fabric_mass = "300 g/m²"', 0.3)):
        path.write_text(f'kind = "walker"\n[material]\nfabric = "rib-knit"\n{more}', "utf-8")
        assert read_scene(path).config.value("fabric_mass") == mass
