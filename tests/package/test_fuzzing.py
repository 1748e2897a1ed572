"""Files with random faults end in a typed error or a valid object: never in another exception.

The faults are changes of bytes, and of words and numbers, of small good files.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

from toros_fem.base.errors import (
    CheckpointError,
    LibraryError,
    PatternError,
    PatternFileError,
    RunError,
    SceneError,
    SurfaceError,
    TargetError,
    TileFileError,
    TorosError,
)
from toros_fem.cli.scene_files.reading import Scene, read_scene
from toros_fem.cli.scene_files.writing import scene_text
from toros_fem.design.loop.journal import Checkpoint
from toros_fem.materials.library import read_library
from toros_fem.materials.library.writing import material_text
from toros_fem.meshes import (
    Pattern,
    Surface,
    cylinder,
    from_mesh,
    mesh_file,
    read_pattern,
    read_surface,
    write_pattern,
)
from toros_fem.products.kinds import KINDS
from toros_fem.products.tiles import PrintedTile, read_tile, write_tile
from toros_fem.results.runs.files import read_checkpoint, write_checkpoint
from toros_fem.results.runs.folder import RunRecord, open_run, read_run

ALONE = MPI.COMM_SELF
POINTS = 0.01 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [1, 4, 3]])
# Words that programs trip over.
WORDS = [
    b"nan", b"inf", b"-1", b"0", b"1e400", b"99999999999999999999", b"1.5", b"", b"\0", b"x",
    "Ü".encode(), b"\xff\xfe", b"[", b"]", b'"', b"=", b"-0", b"1e-400", b"true", b"4294967295",
]  # fmt: skip
# A fabric with bounds, a knit, a print and a rubber.
LIBRARY = [
    entry
    for name, entry in read_library().items()
    if name in ("jersey-light", "rib-knit", "tpu-95a-on-jersey", "dragon-skin-20")
]
# Characters of the longest message, of which a path may be a good part.
LONGEST = 600
# Seconds in which every file is read or refused.
PATIENCE = 40

EXAMPLES = settings(
    max_examples=50,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)


def faults() -> st.SearchStrategy[list[tuple[str, float, int]]]:
    """Kinds of faults, with the place in the file and what is put there."""
    kinds = st.sampled_from(["byte", "cut", "double", "end", "word", "number", "line", "drop"])
    fault = st.tuples(kinds, st.floats(0, 1), st.integers(0, 2**16))
    return st.lists(fault, min_size=1, max_size=4)


def damaged(content: bytes, kind: str, place: float, what: int) -> bytes:
    """The content with one fault."""
    at = min(int(place * len(content)), max(len(content) - 1, 0))
    size = 1 + what % 40
    if kind == "byte":
        return content[:at] + bytes([what % 256]) + content[at + 1 :]
    if kind == "cut":
        return content[:at] + content[at + size :]
    if kind == "double":
        return content[: at + size] + content[at:]
    if kind == "end":
        return content[:at]
    lines = content.split(b"\n")
    row = min(int(place * len(lines)), len(lines) - 1)
    words = lines[row].split(b" ")
    column = what % len(words)
    if kind == "word":
        words[column] = WORDS[what % len(WORDS)]
    elif kind == "number":
        words[column] = str(what % 9 - 2).encode()
    elif kind == "line":
        words = [*words, b"\n", *lines[what % len(lines)].split(b" ")]
    else:
        words = []
    return b"\n".join([*lines[:row], b" ".join(words), *lines[row + 1 :]])


@pytest.fixture(scope="module", autouse=True)
def _impatient() -> Iterator[None]:
    """Files here are small: what hangs in meshio shall not last."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_file, "SECONDS", 1.0)
        yield


class TooLongError(BaseException):
    """A file takes more than `PATIENCE` to read; no `except Exception` catches it."""


@contextmanager
def soon() -> Iterator[None]:
    """Fail what hangs."""

    def stop(_: int, __: FrameType | None) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def read_damaged(
    path: Path,
    content: bytes,
    found: list[tuple[str, float, int]],
    read: Callable[[], object],
    kind: type,
    failures: tuple[type[TorosError], ...],
) -> None:
    for fault in found:
        content = damaged(content, *fault)
    path.write_bytes(content)
    with soon():
        made, refusal = None, ""
        try:
            made = read()
        except failures as error:
            refusal = str(error)
    assert isinstance(made, kind) or 10 < len(refusal) < LONGEST


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


FORMATS: dict[str, dict[str, Any]] = {
    "ascii.stl": {"binary": False},
    "binary.stl": {"binary": True},
    "ascii.ply": {"binary": False},
    "binary.ply": {"binary": True},
    "skin.obj": {},
    "skin.off": {},
    "skin.mesh": {},
    "old.msh": {"file_format": "gmsh22", "binary": False},
    "new.msh": {"file_format": "gmsh", "binary": False},
    "skin.vtu": {"binary": False},
    "skin.xdmf": {"data_format": "XML"},
    "skin.vtk": {"binary": False},
}


@pytest.fixture(scope="module", params=list(FORMATS))
def damaged_mesh(request: pytest.FixtureRequest, folder: Path) -> tuple[Path, bytes]:
    path = folder / request.param
    meshio.write_points_cells(path, POINTS, [("triangle", TRIANGLES)], **FORMATS[request.param])
    assert len(read_surface(ALONE, path).triangles) == len(TRIANGLES)
    return path, path.read_bytes()


@EXAMPLES
@given(found=faults())
def test_surfaces(damaged_mesh: tuple[Path, bytes], found: list[tuple[str, float, int]]) -> None:
    path, content = damaged_mesh
    read_damaged(
        path,
        content,
        found,
        lambda: read_surface(ALONE, path),
        Surface,
        (SurfaceError, PatternError),
    )


@pytest.fixture(scope="module")
def skin() -> Pattern:
    return cylinder(ALONE, 0.04, 0.02, 9e-3)


@pytest.fixture(scope="module", params=["target.obj", "target.ply", "target.vtu"])
def target_file(request: pytest.FixtureRequest, folder: Path, skin: Pattern) -> tuple[Path, bytes]:
    path = folder / request.param
    form = {"binary": False} if path.suffix in (".ply", ".vtu") else {}
    meshio.write_points_cells(path, skin.points, [("triangle", skin.triangles)], **form)
    assert from_mesh(ALONE, path, skin).shape == skin.points.shape
    return path, path.read_bytes()


@EXAMPLES
@given(found=faults())
def test_targets(
    target_file: tuple[Path, bytes], skin: Pattern, found: list[tuple[str, float, int]]
) -> None:
    path, content = target_file
    read_damaged(
        path, content, found, lambda: from_mesh(ALONE, path, skin), np.ndarray, (TargetError,)
    )


@EXAMPLES
@given(found=faults())
def test_patterns(folder: Path, skin: Pattern, found: list[tuple[str, float, int]]) -> None:
    path = folder / "pattern.npz"
    write_pattern(path, skin)
    content = path.read_bytes()
    read_damaged(
        path, content, found, lambda: read_pattern(ALONE, path), Pattern, (PatternFileError,)
    )


@EXAMPLES
@given(found=faults())
def test_tiles(folder: Path, found: list[tuple[str, float, int]]) -> None:
    write_tile(folder, PrintedTile(np.ones(36, dtype=bool), (0.01, 0.01), 3e-3))
    content = (folder / "tile.npz").read_bytes()
    read_damaged(
        folder / "tile.npz",
        content,
        found,
        lambda: read_tile(ALONE, folder),
        PrintedTile,
        (TileFileError,),
    )


def entries() -> st.SearchStrategy[Any]:
    """Values that an archive's entry may hold instead of the right one."""
    numbers = st.floats() | st.integers(-(2**40), 2**40)
    lists = st.lists(numbers, max_size=5)
    return (numbers | st.text(max_size=5) | st.booleans() | lists | st.binary(max_size=5)).map(
        np.asarray
    )


@EXAMPLES
@given(data=st.data())
def test_tiles_of_other_entries(folder: Path, data: st.DataObject) -> None:
    """The archive is whole; an entry in it is not what it should be."""
    path = folder / "tile.npz"
    write_tile(folder, PrintedTile(np.ones(36, dtype=bool), (0.01, 0.01), 3e-3))
    _exchange(path, data)
    with soon(), contextlib.suppress(TileFileError):
        assert isinstance(read_tile(ALONE, folder), PrintedTile)


@EXAMPLES
@given(data=st.data())
def test_patterns_of_other_entries(folder: Path, skin: Pattern, data: st.DataObject) -> None:
    path = folder / "pattern.npz"
    write_pattern(path, skin)
    _exchange(path, data)
    with soon(), contextlib.suppress(PatternFileError):
        assert isinstance(read_pattern(ALONE, path), Pattern)


def _exchange(path: Path, data: st.DataObject) -> None:
    """Put another value into one entry of an archive."""
    with np.load(path) as archive:
        content = dict(archive)
    name = data.draw(st.sampled_from(sorted(content)))
    content[name] = data.draw(entries())
    np.savez(path, **content)


@EXAMPLES
@given(kind=st.sampled_from(sorted(KINDS)), found=faults())
def test_scenes(folder: Path, kind: str, found: list[tuple[str, float, int]]) -> None:
    path = folder / "scene.toml"
    content = scene_text(KINDS[kind]).encode()
    read_damaged(path, content, found, lambda: read_scene(path), Scene, (SceneError,))


@EXAMPLES
@given(found=faults())
def test_materials(folder: Path, found: list[tuple[str, float, int]]) -> None:
    """A library, and a scene that names one of its materials."""
    path, scene = folder / "materials.toml", folder / "named.toml"
    text = "\n".join(map(material_text, LIBRARY))
    read_damaged(path, text.encode(), found, lambda: read_library(path), dict, (LibraryError,))
    scene.write_text(
        'kind = "bend"\nfiles.materials = "materials.toml"\nmaterial.fabric = "rib-knit"\n',
        encoding="utf-8",
    )
    with contextlib.suppress(SceneError, LibraryError):
        assert isinstance(read_scene(scene), Scene)


@EXAMPLES
@given(found=faults())
def test_checkpoints(folder: Path, found: list[tuple[str, float, int]]) -> None:
    path, owner = folder / "loop.npz", {"run": "this"}
    state = Checkpoint(
        {"density": np.linspace(0, 1, 20, dtype=np.float64)}, {"stage": 1, "value": 0.5}
    )
    write_checkpoint(path, state, owner)

    def read() -> Checkpoint:
        return read_checkpoint(path, owner)[0]

    read_damaged(path, path.read_bytes(), found, read, Checkpoint, (CheckpointError,))


@EXAMPLES
@given(found=faults())
def test_records_of_runs(folder: Path, record: bytes, found: list[tuple[str, float, int]]) -> None:
    place = folder / "a run"
    (place / "state").mkdir(parents=True, exist_ok=True)

    def read() -> RunRecord:
        return read_run(ALONE, place)[0]

    read_damaged(
        place / "state" / "run.json", record, found, read, RunRecord, (RunError, CheckpointError)
    )


@pytest.fixture(scope="module")
def record(folder: Path) -> bytes:
    with open_run(ALONE, folder / "whole run", {"seed": 1, "angle": 90.0}):
        pass
    return (folder / "whole run" / "state" / "run.json").read_bytes()
