"""Whatever stands in a file, its reader ends in a typed error of one line, in little memory."""

from __future__ import annotations

import functools
import io
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from helpers.line_fields import two_sheets
from helpers.scenes import DATA
from mpi4py import MPI

from toros_fem.base.errors import OutputError, TorosError
from toros_fem.cli.scene_files import read_scene
from toros_fem.making.machine_files import _earlier
from toros_fem.making.printability import read_print_polygons
from toros_fem.materials.library.files import read_materials
from toros_fem.meshes import from_mesh, read_pattern, read_surface
from toros_fem.products.fitting.reading import read_tensile_tests
from toros_fem.products.tiles.report import read_tile
from toros_fem.results.report.page_file import write_report
from toros_fem.results.runs.open_run import read_record

# What `make fuzz` found.
FOUND = DATA / "found"
ALONE = MPI.COMM_SELF
# Bytes that a reader may take beside the file's own size.
MOST = 100_000_000


def packed(**members: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return out.getvalue()


def array(shape: str, kind: str = "'<f8'") -> bytes:
    """A file of NumPy whose head promises an array."""
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def zeros() -> bytes:
    out = io.BytesIO()
    np.save(out, np.zeros(50_000_000))
    return out.getvalue()


CONTENTS: dict[str, Callable[[], bytes]] = {
    "nothing": lambda: b"",
    "no text": lambda: b"\xff\xfe\x00\x01" * 50,
    "a null": lambda: b"a = \x00\n",
    "a bomb": lambda: packed(x=zeros()),
    "a promise": lambda: packed(x=array("(10**12,)"), header=b"{}"),
    "a promise of many axes": lambda: packed(x=array("(2,) * 70")),
    "objects": lambda: packed(x=array("(3,)", "'|O'")),
    "a head that is code": lambda: packed(x=array("__import__('os')")),
    "a zip without its end": lambda: packed(x=b"1")[:-9],
    "a header that nests": lambda: packed(header=b"\x93NUMPY" + b"[" * 5000),
    "lists in lists": lambda: b"[" * 30_000,
    "tables in tables": lambda: b"x = " + b"{a=" * 9000,
    "a key of many parts": lambda: b".".join([b"a"] * 5_000) + b" = 1\n",
    "quoted parts": lambda: b".".join([b'"a b"'] * 5_000) + b" = 1\n",
    "a header of many parts": lambda: b"[" + b".".join([b"a"] * 5_000) + b"]\n",
    "a long number": lambda: b'kind = "bend"\n[skin]\nlength = ' + b"9" * 30_000,
    "a long text": lambda: b'kind = "bend"\n[skin]\nlength = "' + b"9" * 30_000 + b' mm"\n',
    "an exponent": lambda: b'kind = "bend"\n[skin]\nlength = "1e999999999 m"\n',
    "a JSON of another kind": lambda: b'{"format": [], "figures": {"a": 3}, "files": 7}',
    "a JSON of numbers": lambda: b"[1e999]",
    "NaN": lambda: b"NaN",
    "columns": lambda: b"," * 30_000 + b"\n1\n",
    "quotes": lambda: b'strain,force\n"' + b'\\"' * 5_000,
    "a table of words": lambda: b"iteration,objective\none,two\n",
    "a count of an STL": lambda: b" " * 80 + b"\xff\xff\xff\x7f" + b"\x00" * 50,
    "a count of a PLY": lambda: (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n"
    ),
    "an entity in an entity": lambda: (
        b'<!DOCTYPE x [<!ENTITY a "lol">'
        + b"".join(b'<!ENTITY %c "&%c;&%c;&%c;&%c;">' % (98 + k, *4 * (97 + k,)) for k in range(20))
        + b']><VTKFile type="UnstructuredGrid">&u;</VTKFile>'
    ),
}


def viewed(folder: Path) -> object:
    """The page of a run, which has a history if nothing else."""
    history = folder / "history.csv"
    if not os.path.lexists(history):
        history.write_text("iteration,objective\n0,1.5\n1,1.25\n", encoding="utf-8")
    return write_report(folder)


READERS: dict[str, Callable[[Path], object]] = {
    "scene.toml": read_scene,
    "materials.toml": read_materials,
    "tests.csv": lambda path: read_tensile_tests([path]),
    "pattern.npz": lambda path: read_pattern(ALONE, path),
    "print.npz": lambda path: read_print_polygons(ALONE, path),
    "tile.npz": lambda path: read_tile(ALONE, path),
    "summary.json": lambda path: viewed(path.parent),
    "history.csv": lambda path: viewed(path.parent),
    "curve.csv": lambda path: viewed(path.parent),
    "tolerance.json": lambda path: viewed(path.parent),
    "frames/pressure-000000.npz": lambda path: viewed(path.parents[1]),
    "state/run.json": lambda path: read_record(ALONE, path.parents[1]),
    "manufacture.json": lambda path: _earlier(path.parent),
    **{f"skin.{end}": lambda path: read_surface(ALONE, path) for end in ("stl", "ply", "vtu")},
    "deformed.vtu": lambda path: from_mesh(ALONE, path, two_sheets(0.0)),
}


@pytest.mark.parametrize("name", ["summary.json", "history.csv", "curve.csv", "tolerance.json"])
def test_a_pipe_in_a_run_is_no_file(name: str, tmp_path: Path) -> None:
    """A reader that waits for its writer would wait for ever."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(OutputError, match=f"{name} cannot be read: it is a pipe"):
        viewed(tmp_path)


@functools.cache
def content_of(what: str) -> bytes:
    return CONTENTS[what]()


@pytest.mark.parametrize("name", READERS)
def test_only_typed_errors(name: str, tmp_path: Path) -> None:
    path, told = tmp_path / name, 0
    path.parent.mkdir(exist_ok=True)
    for what in CONTENTS:
        path.write_bytes(content_of(what))
        error = raised(partial(READERS[name], path))
        assert not (fault := wrong(error, path)), f"{what}: {fault}"
        told += error is not None
    assert told > len(CONTENTS) / 2 or name in ("manufacture.json", "materials.toml")


def wrong(error: BaseException | None, path: Path) -> str:
    """What is wrong with what a reader raised; nothing of a typed error of one short line."""
    if error is not None and not isinstance(error, TorosError):
        return repr(error)
    message = str(error or "")
    lines = message.split("\n")
    fits = len(lines) <= 21 and all(len(line) < 600 + 3 * len(str(path)) for line in lines)
    return "" if fits else message


@pytest.mark.parametrize("kept", sorted(FOUND.glob("*-*")), ids=lambda path: path.name)
def test_what_was_found(kept: Path, tmp_path: Path) -> None:
    """Files that `make fuzz` found: the name of the reader, and of the content."""
    name = kept.name.rpartition("-")[0].replace("+", "/")
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(kept.read_bytes())
    assert not wrong(raised(partial(READERS[name], path)), path)


def raised(read: Callable[[], object]) -> BaseException | None:
    """What a reader raises, without more memory than the file's own size."""
    tracemalloc.start()
    try:
        read()
    except BaseException as error:
        return error
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < MOST, f"{peak / 1e6:.0f} MB"
    return None
