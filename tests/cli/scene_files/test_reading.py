"""Scene files: what is read, and how what is wrong is told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.cli.scene_files import read_scene
from toros_fem.products.kinds import KINDS
from toros_fem.products.own_mesh import Held
from toros_fem.products.tubes import BendScene


def scene(folder: Path, text: str, **options: Any) -> Any:
    path = folder / "my.toml"
    path.write_text(text, encoding="utf-8")
    return read_scene(path, **options)


def test_values_with_and_without_units(tmp_path: Path) -> None:
    found = scene(
        tmp_path,
        """
        kind = "bend"
        target = { angle = "3.5 rad", neutral = 0.008 }
        pressure.pressure = "6 kPa"
        [skin]
        length = '12 cm'
        whole = true
        [design]
        levels = "none"
        seed = 3
        """,
    )
    assert found.kind is KINDS["bend"]
    assert found.config.target.angle == pytest.approx(np.degrees(3.5), rel=1e-15)
    assert found.config == BendScene.of(
        angle=found.config.target.angle, neutral=0.008, pressure=6e3, length=0.12,
        whole=True, seed=3,
    )  # fmt: skip
    assert found.files == {}


@pytest.mark.parametrize("name", list(KINDS))
def test_quick_variant_is_that_of_the_kind(tmp_path: Path, name: str) -> None:
    kind = KINDS[name]
    assert scene(tmp_path, f'kind = "{name}"').config == kind()
    assert scene(tmp_path, f'kind = "{name}"', coarse=True).config == kind().coarse()


def test_what_the_quick_variant_changes_may_be_given(tmp_path: Path) -> None:
    text = 'kind = "bend"\n[design]\nseed = 5\n[coarse]\niterations = 7\nedge_length = "4 mm"\n'
    assert scene(tmp_path, text).config == BendScene.of(seed=5)
    found = scene(tmp_path, text, coarse=True).config
    plain = BendScene.of(seed=5).coarse()
    assert found == plain.updated(iterations=7, edge_length=4e-3)


def test_changes_override_all_else(tmp_path: Path) -> None:
    text = 'kind = "own-mesh"\n[files]\nmesh = "a/b.stl"\n[held]\nwhere = "z < 1 mm"\n'
    changes = [
        "pressure=7kPa", "design.levels=none", "bend=30 deg", "iterations=4",
        "held.where=z < 2 mm and x > 0", "held.components=xy", "files.target=c.ply",
        "metrics = angle, twist",
    ]  # fmt: skip
    found = scene(tmp_path, text, coarse=True, changes=changes)
    assert found.config.pressure.pressure == 7e3
    assert found.config.target.bend == 30.0
    assert found.config.design.iterations == 4
    assert found.config.objective.metric_names == ("angle", "twist")
    assert found.config.held == (Held(where="z < 2 mm and x > 0", components="xy"),)
    # Paths of the file are relative to it, those of the command line to the current folder.
    assert found.files == {"mesh": tmp_path / "a/b.stl", "target": Path("c.ply")}


BEND, OWN = 'kind = "bend"\n', 'kind = "own-mesh"\n'
WRONG = [
    ("", "my.toml: it names no kind. Begin with kind"),
    ("kind = 3", "line 1: kind: 3 is no kind"),
    ('kind = "bnd"', "line 1: kind: 'bnd' is no kind; did you mean 'bend'?"),
    (BEND + 'kind = "twist"', "line 2: this key or table stands in the file already"),
    (BEND + '\npressure = 5 kPa', "line 3: .*Text needs quotes, and so do values with"),
    (BEND + 'seed = 3', r"line 2: seed: unknown key 'seed'; it stands in the table \[design\]"),
    (BEND + '[desing]\nseed = 3', "line 2: desing: unknown table 'desing'; did you mean 'd"),
    (BEND + '[design]\n\nsed = 3', "line 4: design.sed: unknown key 'sed'; did you mean 'see"),
    (BEND + '[design]\npresure = 3', r"did you mean 'pressure', in the table \[pressure\]\?"),
    (BEND + '[design]\npressure = 3', r"design.pressure: .* stands in the table \[pressure\]"),
    (BEND + '[skin]\nlength = "5 kPa"', "line 3: skin.length: .*'5 kPa' is a pressure or a mod"),
    (BEND + '[skin]\nlength = "5"', "line 3: skin.length: .*'5' has no unit; known are m, cm"),
    (BEND + '[skin]\nlength = -1', "line 3: skin.length: length = -1 m must be a finite nu"),
    (BEND + '[skin]\nmesh = "hexagons"', "skin.mesh: mesh = 'hexagons' must be one of"),
    (BEND + '[skin]\nlength = "0,15 m"', "'0,15 m' has a comma. Write a point: '0.15 m'"),
    (BEND + '[skin]\nlength = "1.500,0 mm"', "has a comma. Write a point, and one alone"),
    (BEND + '"\\u001b[31mred" = 1', r"my.toml: '\\x1b\[31mred': unknown"),
    (BEND + "a = [1,\n", "this is no TOML"),
    (BEND + "[skin]\nlength = 0,15", "line 3: a number has a comma. Write a point: 0.15"),
    (BEND + '[pressure]\npressure = "5kpa"', "unknown unit 'kpa'; did you mean 'kPa'"),
    (BEND + '[pressure]\npressure = "none"', "This value cannot be left out"),
    (BEND + '[material]\nfabric_thickness = 1', "did you mean 'thickness'"),
    (BEND + '[design]\nseed = 1\nseed = 2', "line 4: this key or table stands in the file"),
    (BEND + '[design]\nseed = 1\n[design]\n', "line 4: this key or table stands in the file"),
    (BEND + '[design]\nseed = 1' + 5000 * "0", "this is no TOML"),
    (BEND + '[design]\n\nlevels = 9', "line 4: design.levels: levels = 9 is too many"),
    ('kind = "gripper"\n[skin]\nfinger_length = "30 mm"', "line 3: skin.finger_length: around an"),
    (BEND + '[files]\nmesh = "a.stl"', "line 3: files.mesh: unknown key 'mesh'; known are start"),
    (BEND + "[files]\nmaterials = 3", "line 3: files.materials: materials = 3 must be a path"),
    (BEND + 'files = "x"', r"line 2: files: must be a table: write \[files\]"),
    (BEND + 'coarse = 1', r"line 2: coarse: must be a table"),
    (BEND + '[coarse]\nseed = "x"', "line 3: coarse.seed: seed = 'x' must be a whole number"),
    (OWN + 'held = 3', r"line 2: held: must be a table \[held\], or several \[\[held\]"),
    (OWN + '[[held]]\nwhere = "z < 1 mm"\n[[held]]\nwhere = "z"', "line 5: held.1.where: w"),
    (OWN + '[held]\nwhere = "q < 1"', "held.where: where: .*'q' at character 1,"),
    (OWN + '[held]\nwere = "z < 1"', "held.were: unknown key 'were'; did you mean 'where"),
    (OWN + '[held]\n', "line 2: held: a region needs where"),
    (OWN + '[[metric]]\nmeasure = "tip"\nof = "z > 1"\ntarget = 3', "line 5: metric.0.target: t"),
    (OWN + '[metric]\nof = "z >"', "line 3: metric.of: of: 'z >' cannot be read at character 4"),
    (OWN + '[objective]\nmetrics = "angel"', "objective.metrics: metrics = 'angel' names"),
    ("a = " + 2000 * "[", "my.toml: tables and lists are nested too deeply|this is no TOML"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), WRONG, ids=range(len(WRONG)))
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message) as caught:
        scene(tmp_path, text)
    assert caught.value.path == tmp_path / "my.toml"
    assert len(str(caught.value)) < 1500


def test_all_errors_are_told_with_their_lines(tmp_path: Path) -> None:
    text = BEND + '[design]\nseed = 0.5\n[no]\n[skin]\nlength = "5 kPa"\nlenght = 1\ncaps = 3\n'
    with pytest.raises(FileError) as caught:
        scene(tmp_path, text)
    lines = str(caught.value).replace(f"{tmp_path / 'my.toml'}, line ", "").split("\n")
    begins = [
        "3: design.seed: seed = 0.5 must",
        "4: no: unknown table 'no'",
        "6: skin.length: length = '5 kPa'",
        "7: skin.lenght: unknown key 'lenght'; did",
        "8: skin.caps: ",
    ]
    assert len(lines) == len(begins)
    for line, begin in zip(lines, begins, strict=True):
        assert line.startswith(begin), line
    assert (caught.value.line, caught.value.key) == (3, "design.seed")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("seed", "change 'seed': write KEY=VALUE"),
        ("=3", "write KEY=VALUE"),
        ("sed=3", "unknown key 'sed'; did you mean 'seed'"),
        ("desing.seed=3", "unknown table 'desing'; did you mean 'design'"),
        ("skin.seed=3", "unknown key"),
        ("seed=three", "'three' must be a whole number"),
        ("pressure=5mm", "'5mm' is a length"),
        ("files.msh=a", "did you mean 'mesh'"),
        ("files.mesh=", "mesh = '' must be a path in quotes"),
        ("files.mesh=3", "3 must be a path"),
        ("held.where=z", "a comparison, z < 5 mm"),
        ("held.wher=z", "did you mean 'where'"),
        ("plain.where=z<1", "the file has 2 tables plain"),
        ("levels=4", "^change 'levels=4': levels = 4 is too many"),
    ],
)
def test_wrong_changes(tmp_path: Path, change: str, message: str) -> None:
    text = 'kind = "own-mesh"\n[[plain]]\nwhere = "x < 1"\n[[plain]]\nwhere = "x > 2"\n'
    with pytest.raises(FileError, match=message):
        scene(tmp_path, text, changes=[change])


def test_files_that_cannot_be_read(alone: MPI.Comm, tmp_path: Path) -> None:
    """With a communicator the first rank reads, and all ranks raise."""
    (tmp_path / "latin.toml").write_bytes(b'kind = "bend"\n# \xe4\n')
    (tmp_path / "long.toml").write_bytes(b"#" * 1_000_001)
    (tmp_path / "dos.toml").write_bytes(
        b'\xef\xbb\xbfkind = "bend"\r\n[skin]\r\nlength = "1 m"\r\n'
    )
    for name, message in (
        ("nothing.toml", "there is no .*nothing.toml. Check its path"),
        (".", "is a folder; name a scene file"),
        ("a\0b", "cannot be read"),
        ("latin.toml", "latin.toml, line 2: no UTF-8 text"),
        ("long.toml", "longer than 1000000 bytes"),
    ):
        with pytest.raises(FileError, match=message):
            read_scene(tmp_path / name, comm=alone)
    found = read_scene(tmp_path / "dos.toml", comm=alone).config
    assert found == BendScene.of(length=1.0)
    assert alone.allgather(found) == [found] * alone.size


def test_files_that_are_not_there(alone: MPI.Comm, tmp_path: Path) -> None:
    text = 'kind = "own-mesh"\n[files]\nmesh = "here.stl"\ntarget = "sub/there.stl"\n'
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    (tmp_path / "here.stl").touch()
    found = read_scene(tmp_path / "my.toml", comm=alone)
    with pytest.raises(FileError, match=r"my.toml, line 4: files.target: there is no .*there.stl"):
        found.require_files(alone)
    change = f"files.target={tmp_path / 'here.stl'}"
    read_scene(found.path, comm=alone, changes=[change]).require_files(alone)
    without = read_scene(found.path, comm=alone, changes=["files.target=none"])
    assert list(without.files) == ["mesh"]
    without.require_files(alone)
    other = read_scene(found.path, comm=alone, changes=['files.mesh="no.stl"'])
    with pytest.raises(FileError, match="^files.mesh: there is no no.stl") as caught:
        other.require_files(alone)
    assert caught.value.line is None
