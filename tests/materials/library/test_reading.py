"""Files of materials: what is read, and how what is wrong is told."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import MATERIAL_KINDS, TRUSTS
from toros_fem.materials.sheet import Composite

MINE = """\
[my-jersey]
kind = "fabric"
title = "my jersey"
young = "60 kPa"
poisson = 0.25
thickness = "0.4 mm"
c1 = 1.8
density = "150 g/m²"
stretch_range = [1.0, 1.6]
trust = "measured"
source = "pull test of 3 strips"
"""


def test_shipped_materials() -> None:
    library = read_library()
    defaults = Composite()
    jersey = library["jersey-light"]
    assert jersey.material == replace(defaults.fabric, c1=defaults.c1, c2=defaults.c2)
    both = library["printed-tpu-95a-on-jersey"]
    assert both.material == defaults.reinforcement
    assert both.with_fabric
    assert library["dragon-skin-20"].young == 0.29e6
    assert {"tpu-85a", "tpu-95a", "ecoflex-00-30", "dragon-skin-10", "dragon-skin-30"} <= set(
        library
    )
    assert {entry.kind for entry in library.values()} == set(MATERIAL_KINDS)
    assert {entry.trust for entry in library.values()} == set(TRUSTS) - {"doubted"}
    assert max(entry.young for entry in library.values() if entry.kind == "print") == 100e6


def test_a_file_extends_and_replaces(alone: MPI.Comm, tmp_path: Path) -> None:
    path = shared(alone, tmp_path) / "mine.toml"
    if alone.rank == 0:
        again = MINE.replace("my-jersey", "jersey-light")
        path.write_text(f"{MINE}\n{again}", encoding="utf-8")
    alone.barrier()
    library = read_library(path, comm=alone)
    assert alone.allgather(library) == [library] * alone.size
    mine = library["my-jersey"]
    assert (mine.young, mine.thickness, mine.density) == (60e3, 0.4e-3, 0.15)
    assert (mine.c1, mine.c2, mine.knit_ratio) == (1.8, None, None)
    assert library["jersey-light"].title == "my jersey"
    assert len(library) == len(read_library()) + 1
    with pytest.raises(FileError, match=r"there is no .*other.toml"):
        read_library(path, tmp_path / "other.toml", comm=alone)


WRONG = [
    ('young = "60 kPa"', 'yuong = "60 kPa"', "line 4: my-jersey.yuong: .*did you mean 'young'"),
    ('young = "60 kPa"', 'young = "60 mm"', "line 4: my-jersey.young: .*'60 mm' is a length"),
    ('young = "60 kPa"', "young = -1", "line 4: my-jersey.young: young = -1 Pa must be"),
    ('young = "60 kPa"\n', "", "line 1: my-jersey: it has no young"),
    ('kind = "fabric"', 'kind = "cloth"', "line 2: my-jersey.kind: kind = 'cloth' must be one of"),
    ('kind = "fabric"', 'kind = "rubber"', "my-jersey.c1: c1 = 1.8 belongs to eq. "),
    ("[1.0, 1.6]", "[1.0, 1.9]", r"line 9: my-jersey.stretch_range: .* 1.9\) ends beyond c1"),
    ("[1.0, 1.6]", "[1.6]", "line 9: my-jersey.stretch_range: .* must be two finite"),
    ("[my-jersey]", '["my jersey"]', "line 1: my jersey: name = 'my jersey' must be letters"),
    ("[my-jersey]", "x = 3\n[my-jersey]", r"line 1: x: must be a table: write \[x\]"),
    ('"my jersey"', '""', "line 3: my-jersey.title: title = '' must be one line"),
    ("[my-jersey]", "[my-jersey", "line 1: .*this is no TOML"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG, ids=range(len(WRONG)))
def test_wrong_files(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    assert old in MINE
    path.write_text(MINE.replace(old, new), encoding="utf-8")
    with pytest.raises(FileError, match=message) as caught:
        read_library(path)
    assert caught.value.path == path


def test_names() -> None:
    library = read_library()
    assert named(library, "tpu-85a").kind == "print"
    with pytest.raises(FileError, match="'tpu-85' is no print of the library; did you mean"):
        named(library, "tpu-85", "print")
    with pytest.raises(FileError, match="'tpu-85a' is a print, and a fabric is asked for"):
        named(library, "tpu-85a", "fabric")
    with pytest.raises(FileError, match="is no material of the library; known are jersey-li"):
        named(library, "§§§")
