"""Materials are written into a file, and read again as the same."""

from dataclasses import replace
from pathlib import Path

import pytest

from toros_fem.base.errors import FileError, OutputError
from toros_fem.materials.library.files import material_text, read_library, write_material

SHIPPED = read_library()


def test_others_and_comments_stay(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    first, second = (replace(SHIPPED["jersey-light"], name=name) for name in "ab")
    write_material(path, first)
    path.write_text(path.read_text() + "# the end\n\n# of b\n", encoding="utf-8")
    write_material(path, second)
    before = path.read_text()
    write_material(path, replace(first, young=1e5 / 3, note='a "quoted" note'))
    after = path.read_text()
    assert after != before
    assert after.partition("# the end")[1:] == before.partition("# the end")[1:]
    assert read_library(path)["a"].young == 1e5 / 3
    write_material(path, first)
    assert path.read_text() == before
    write_material(path, replace(second, title="the last"))
    assert path.read_text() == before.rpartition("[b]")[0] + before.rpartition("[b]")[1] + (
        before.rpartition("[b]")[2].replace(second.title, "the last")
    )


def test_what_cannot_be_written(tmp_path: Path) -> None:
    entry = SHIPPED["jersey-light"]
    path = tmp_path / "mine.toml"
    path.write_text("[a]\nx = 1\n", encoding="utf-8")
    with pytest.raises(FileError, match="line 2: a.x: unknown key"):
        write_material(path, entry)
    assert path.read_text() == "[a]\nx = 1\n"
    keys = material_text(entry).splitlines()[1:]
    dotted = [f"{name}.{key}" for key in keys for name in ("jersey-light", "b")]
    path.write_text("\n".join(dotted), encoding="utf-8")
    assert "b" in read_library(path)
    with pytest.raises(FileError, match="does not stand there as a table"):
        write_material(path, replace(entry, young=2.0))
    with pytest.raises(OutputError, match="could not be written"):
        write_material("/proc/nowhere/mine.toml", entry)
