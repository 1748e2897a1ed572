"""What is written is read again in every field, and a damaged file is told from a whole one."""

from __future__ import annotations

import contextlib
import dataclasses
import locale
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import shapely
from helpers.line_fields import two_sheets
from helpers.panels import pattern_of, striped
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

from toros_fem.base import errors
from toros_fem.base.errors import TorosError
from toros_fem.base.files import HEADER, Archive, read_archive, reason, write_archive
from toros_fem.base.keys import DIMENSIONS, read_quantity, write_quantity
from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files import read_scene, scene_text
from toros_fem.making.layout import CutSheet
from toros_fem.making.machine_files import cut_dxf, cut_svg, stl_of, threemf_of
from toros_fem.making.marks import Label
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import PanelDrawing, panel_drawings
from toros_fem.making.printability import (
    PrintLimits,
    StoredPrint,
    read_print_polygons,
    write_print_polygons,
)
from toros_fem.materials.library.files import read_library, read_materials, write_material
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.materials.sheet import Knit, Membrane
from toros_fem.meshes import (
    Pattern,
    files,
    from_mesh,
    moulded,
    read_pattern,
    read_surface,
    write_pattern,
)
from toros_fem.meshes.panels import Affine
from toros_fem.products.kinds import KINDS
from toros_fem.products.tiles.report import PrintedTile, read_tile, write_tile
from toros_fem.results.runs.frames import (
    Frame,
    ShownSkin,
    read_frames,
    read_skin,
    write_frame,
    write_skin,
)
from toros_fem.results.runs.open_run import open_run, read_record

ALONE, LIBRARY = MPI.COMM_SELF, read_library()
FEW = settings(
    max_examples=12, derandomize=True, deadline=None, database=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],  # a scene that is shrunk takes minutes
)  # fmt: skip
MANY = settings(FEW, max_examples=40)
POINTS = 0.01 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [1, 4, 3]])


# ------------------------------------------------------------------------ what is the same


def leaves(found: Any, *place: Any) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """All values in a result, by their place in it; numbers and arrays to the last bit."""
    if dataclasses.is_dataclass(found) and not isinstance(found, type):
        found = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
    if isinstance(found, Mapping):
        for name, value in found.items():
            yield from leaves(value, *place, name)
    elif isinstance(found, list | tuple):
        yield place, len(found)
        for number, value in enumerate(found):
            yield from leaves(value, *place, number)
    elif isinstance(found, np.ndarray):
        yield place, (found.dtype.kind, found.shape, found.tobytes())
    else:
        yield place, found.wkb if isinstance(found, shapely.Geometry) else repr(found)


def changed(one: Any, other: Any) -> set[Any]:
    """Fields or entries in which two results differ."""
    here, there = dict(leaves(one)), dict(leaves(other))
    return {key[:1] for key in here | there if here.get(key) != there.get(key)}


# --------------------------------------------------------------------------- what is drawn


def seeds() -> st.SearchStrategy[np.random.Generator]:
    return st.integers(0, 10**6).map(np.random.default_rng)


WORDS = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=8)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@st.composite
def patterns(draw: st.DrawFn) -> Pattern:
    """Two sheets sewn along a turned seam, or moulded into charts that do not fit."""
    pattern = two_sheets(draw(st.floats(-1, 1)))
    names = draw(st.lists(WORDS, min_size=2, max_size=2, unique=True))
    if draw(st.booleans()):
        pattern = moulded(POINTS * draw(st.floats(0.5, 2)), TRIANGLES)
        return dataclasses.replace(pattern, panel_names=tuple(names[: len(pattern.panel_names)]))
    tolerance = draw(st.floats(1e-6, 1e-2))
    return dataclasses.replace(pattern, panel_names=tuple(names), seam_tolerance=tolerance)


def region(rng: np.random.Generator) -> shapely.Geometry:
    spots = shapely.buffer(shapely.points(rng.uniform(0, 0.03, (9, 2))), 4e-3, quad_segs=3)
    return shapely.union_all(spots).difference(shapely.box(0.01, 0.01, 0.013, 0.012))


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    rng = draw(seeds())

    def single(*shape: int) -> Any:
        return rng.standard_normal(shape).astype(np.float32).astype(np.float64)

    return Frame(
        draw(st.sampled_from(["iteration", "pressure", "gait", "load"])),
        draw(st.integers(0, 999_999)), draw(WORDS), single(5, 3),
        draw(st.sampled_from([None, single(6)])),
        draw(st.dictionaries(WORDS, NUMBERS, max_size=3)), draw(st.just("") | WORDS),
    )  # fmt: skip


@st.composite
def skins(draw: st.DrawFn) -> ShownSkin:
    pattern, rng = draw(patterns()), draw(seeds())
    passive = np.where(rng.random(len(pattern.panel)) < 0.5, np.nan, 0.25).astype(np.float32)
    printed = [shapely.MultiPolygon(shapely.get_parts(region(rng)).tolist())]
    both: list[Any] = [
        (None, rng.standard_normal(pattern.points.shape)), (False, True), (None, passive),
        (None, printed * len(pattern.panel_names)), (None, (POINTS, TRIANGLES)),
    ]  # fmt: skip
    return ShownSkin(pattern, *(draw(st.sampled_from(pair)) for pair in both))


@st.composite
def prints(draw: st.DrawFn) -> StoredPrint:
    pattern, rng = draw(patterns()), draw(seeds())
    limits = PrintLimits(*draw(st.tuples(*[st.floats(1e-6, 1e-2)] * 3)))
    return StoredPrint(pattern, [region(rng) for _ in pattern.panel_names], limits)


@st.composite
def tiles(draw: st.DrawFn) -> PrintedTile:
    made = PrintedTile(region(draw(seeds())), (0.01, 0.01), 3e-3)
    young = draw(st.floats(1e3, 1e9))
    fabric = dataclasses.replace(
        made.composite.fabric, young=young, c1=draw(st.none() | st.just(1.7))
    )
    knit = draw(st.none() | st.builds(Knit, st.floats(1, 5), st.floats(-1, 1)))
    composite = dataclasses.replace(
        made.composite, knit=knit, fabric=fabric, c1=draw(st.floats(1.2, 3)), c2=3.5
    )
    if knit is None:
        membrane = draw(st.sampled_from([Membrane(), Membrane(wrinkling="tension-field")]))
        composite = dataclasses.replace(composite, membrane=membrane)
    size = draw(st.tuples(*[st.floats(1e-3, 1)] * 2))
    return dataclasses.replace(made, composite=composite, size=size)


@st.composite
def checkpoints(draw: st.DrawFn) -> Archive:
    rng = draw(seeds())
    arrays = {name: rng.standard_normal(20) ** 9 for name in ("density", "state")}
    values = NUMBERS | st.integers() | WORDS | st.none() | st.just(float("inf"))
    numbers = st.dictionaries(WORDS, values | st.lists(NUMBERS, max_size=3), max_size=4)
    return Archive("checkpoint", arrays, draw(numbers))


@st.composite
def scenes(draw: st.DrawFn) -> dict[str, Any]:
    """A kind's example with some other numbers."""
    name = draw(st.sampled_from(sorted(KINDS)))
    config = KINDS[name].example()
    numbers = [name for name, key in config.described().items() if key.kind is float]
    for key in draw(st.lists(st.sampled_from(numbers), max_size=3)):
        value = config.value(key) or 1.0
        try:
            config = config.updated(**{key: value * draw(st.floats(0.97, 1.03))})
        except TorosError:  # it does not fit the others
            assume(False)
    return fields_of(name, config)


@st.composite
def materials(draw: st.DrawFn) -> dict[str, LibraryMaterial]:
    found = {}
    for name in draw(
        st.lists(st.sampled_from(sorted(LIBRARY)), min_size=1, max_size=3, unique=True)
    ):
        entry, text = LIBRARY[name], st.text(st.characters(codec="utf-8", exclude_categories=["C"]))
        words = text.filter(lambda t: 0 < len(t) < 60 and t.isprintable() and bool(t.strip()))
        found[name] = dataclasses.replace(
            entry, young=draw(st.floats(1e3, 1e10)), thickness=draw(st.floats(1e-5, 1e-2)),
            title=draw(words), note=draw(st.none() | words),
        )  # fmt: skip
    return found


def quantities() -> st.SearchStrategy[tuple[float, str]]:
    numbers = st.floats(-1e12, 1e12).filter(lambda x: x == 0 or abs(x) > 1e-12)
    return st.tuples(numbers, st.sampled_from(sorted(DIMENSIONS)))


def inputs() -> st.SearchStrategy[dict[str, Any]]:
    values = NUMBERS | st.integers(-(2**40), 2**40) | WORDS | st.none() | st.booleans()
    return st.dictionaries(WORDS, values | st.lists(NUMBERS, max_size=3), max_size=5)


# ----------------------------------------------------------------- how it is written and read


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
        drawn: What is written.
        write: Writes it into a folder and returns the file.
        read: Reads it again.
        refused: Errors that name a damaged file.
        bare: What a good file holds that ends early; only a file that people write ever does.
    """

    drawn: st.SearchStrategy[Any]
    write: Callable[[Path, Any], Path]
    read: Callable[[Path], Any]
    refused: tuple[type[TorosError], ...]
    bare: Callable[[Any], Mapping[str, Any]] | None = None


def named(name: str, write: Callable[[Path, Any], Any]) -> Callable[[Path, Any], Path]:
    def written(folder: Path, x: Any) -> Path:
        write(folder / name, x)
        return folder / name

    return written


def write_frame_of(folder: Path, x: Frame) -> Path:
    write_frame(folder, x)
    return folder / f"{x.series}-{x.number:06d}.npz"


def write_tile_of(folder: Path, x: PrintedTile) -> Path:
    write_tile(folder, x)
    return folder / "tile.npz"


def fields_of(kind: str, config: Scene) -> dict[str, Any]:
    """A scene as one table."""
    names = (*config.tables(), *config.entries())
    return {"kind": kind, **{name: getattr(config, name) for name in names}}


def write_scene(path: Path, x: dict[str, Any]) -> None:
    numbers = {key: value for key, value in x.items() if key != "kind"}
    kind = KINDS[x["kind"]]
    path.write_text(scene_text(kind.example().updated(**numbers)), encoding="utf-8")


def read_scene_of(path: Path) -> dict[str, Any]:
    found = read_scene(path)
    return fields_of(found.kind.KIND, found.config)


def default_scene(x: dict[str, Any]) -> dict[str, Any]:
    return fields_of(x["kind"], KINDS[x["kind"]]())


def write_library(path: Path, x: dict[str, LibraryMaterial]) -> None:
    for entry in x.values():
        write_material(path, entry)


def write_stored(path: Path, x: StoredPrint) -> None:
    write_print_polygons(path, x.pattern, x.regions, x.limits)


def write_run(folder: Path, x: dict[str, Any]) -> Path:
    with open_run(ALONE, folder / "run", x):
        pass
    return folder / "run" / "state" / "run.json"


def read_inputs(path: Path) -> Any:
    return read_record(ALONE, path.parents[1])[0].inputs


def content_of(path: Path, kind: str) -> Archive:
    return read_archive(path, kind, lambda content: content, errors.CheckpointError, "Start anew.")


FORMATS = {
    "pattern": Format(
        patterns(), named("pattern.npz", write_pattern), partial(read_pattern, ALONE),
        (errors.FileError,),
    ),
    "print": Format(
        prints(), named("print.npz", write_stored),
        partial(read_print_polygons, ALONE), (errors.FileError,),
    ),
    "tile": Format(
        tiles(), write_tile_of, lambda p: read_tile(ALONE, p.parent), (errors.FileError,)
    ),
    "frame": Format(
        frames(), write_frame_of, lambda p: read_frames(p.parent, p.stem.split("-")[0])[0],
        (errors.OutputError,),
    ),
    "skin": Format(
        skins(), lambda f, x: f / write_skin(f, x), read_skin,
        (errors.OutputError, errors.PatternError),
    ),
    "checkpoint": Format(
        checkpoints(), named("loop.npz", partial(write_archive, compress=False)),
        partial(content_of, kind="checkpoint"), (errors.CheckpointError,),
    ),
    "run": Format(
        inputs(), write_run, read_inputs, (errors.OutputError, errors.CheckpointError), lambda x: {}
    ),
    "scene": Format(
        scenes(), named("scene.toml", write_scene), read_scene_of, (errors.FileError,),
        default_scene,
    ),
    "materials": Format(
        materials(), named("materials.toml", write_library), read_materials,
        (errors.FileError,), bare=lambda x: {},
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("files")


def empty(folder: Path) -> Path:
    """A new folder in the folder."""
    place = folder / str(len(list(folder.iterdir())))
    place.mkdir()
    return place


@pytest.mark.parametrize("name", FORMATS)
@FEW
@given(data=st.data())
def test_what_is_written_is_read_again(name: str, data: st.DataObject, folder: Path) -> None:
    form = FORMATS[name]
    x = data.draw(form.drawn)
    assert changed(form.read(form.write(empty(folder), x)), x) == set()


# ------------------------------------------------------------------------------- what is damaged

# Words that programs trip over.
STRANGE = [
    b"nan", b"inf", b"-1", b"0", b"1e400", b"99999999999999999999", b"", b"\0", b"x", b"1.5",
    "Ü".encode(), b"\xff\xfe", b"[", b"]", b'"', b"=", b"-0", b"1e-400", b"true", b"4294967295",
]  # fmt: skip
FAULTS = st.tuples(
    st.sampled_from(["byte", "cut", "word", "number", "drop"]), st.floats(0, 1),
    st.integers(0, 2**16),
)  # fmt: skip


def damaged(content: bytes, kind: str, place: float, what: int) -> bytes:
    """The content with one fault; `cut` takes its end away."""
    at = min(int(place * len(content)), len(content) - 1)
    if kind == "byte":
        return content[:at] + bytes([what % 256]) + content[at + 1 :]
    if kind == "cut":
        return content[:at]
    lines = content.split(b"\n")
    row = min(int(place * len(lines)), len(lines) - 1)
    words = lines[row].split(b" ")
    strange = STRANGE[what % len(STRANGE)] if kind == "word" else str(what % 9 - 2).encode()
    words[what % len(words)] = strange
    return b"\n".join([*lines[:row], *([b" ".join(words)] * (kind != "drop")), *lines[row + 1 :]])


@pytest.mark.parametrize("name", FORMATS)
@MANY
@given(data=st.data())
def test_damage_is_told(name: str, data: st.DataObject, folder: Path) -> None:
    """A file that people write may say another thing, in one entry and the name of another."""
    form, fault = FORMATS[name], data.draw(FAULTS)
    path = form.write(empty(folder), data.draw(form.drawn))
    x = form.read(path)
    path.write_bytes(damaged(path.read_bytes(), *fault))
    refusal, found = "", None
    try:
        found = form.read(path)
    except form.refused as error:
        refusal = str(error)
    if refusal:
        assert 10 < len(refusal) < 2000  # characters: all keys of a scene may be named
        return
    other = changed(found, x)
    if form.bare is not None and fault[0] == "cut":
        other &= changed(found, form.bare(x)) & {key[:1] for key, _ in leaves(found)}
    assert len(other) <= (0 if form.bare is None else 2)


def test_reasons_are_short() -> None:
    """The error of zipfile quotes the name in a damaged header, which may be half of the file."""
    assert len(reason(ValueError(4000 * "\\x00"))) < 200
    assert reason(ValueError("short")) == "short"


def fullest(name: str, folder: Path) -> Path:
    """The largest file of eight."""
    form, paths = FORMATS[name], []

    @settings(FEW, max_examples=8)
    @given(x=form.drawn)
    def draw(x: Any) -> None:
        paths.append(form.write(empty(folder), x))

    draw()
    return max(paths, key=lambda path: path.stat().st_size)


ARCHIVES = ("pattern", "print", "tile", "frame", "skin", "checkpoint")


@pytest.mark.parametrize("name", ARCHIVES)
def test_damage_of_directories(name: str, tmp_path: Path) -> None:
    """Each byte of an archive's directory, which no checksum of zip covers."""
    form, path = FORMATS[name], fullest(name, tmp_path)
    x, content = form.read(path), path.read_bytes()
    for at in range(content.index(b"PK\1\2"), len(content)):
        path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
        with contextlib.suppress(*form.refused):
            assert changed(form.read(path), x) == set(), f"byte {at} of {len(content)}"


@pytest.mark.parametrize("name", ARCHIVES)
def test_archives_say_what_they_are(name: str, tmp_path: Path) -> None:
    """Another kind, other formats, and entries that are lost or changed are told."""
    form, path = FORMATS[name], fullest(name, tmp_path)
    with np.load(path) as archive:
        entries = dict(archive)
    for entry in entries:
        np.savez(path, **{key: value for key, value in entries.items() if key != entry})
        older = "another kind of file, or was written before format 3"
        with pytest.raises(form.refused, match=older if entry == HEADER else "is damaged"):
            form.read(path)
        other = entries[entry][::-1]
        if other.tobytes() != entries[entry].tobytes():
            np.savez(path, **{**entries, entry: other})
            with pytest.raises(form.refused):
                form.read(path)
    np.savez(path, **{**entries, "another": np.zeros(3)})
    with pytest.raises(form.refused, match="is damaged"):
        form.read(path)
    other = entries[HEADER].tobytes().replace(b'"format": 3', b'"format": 2')
    np.savez(path, **{**entries, HEADER: np.frombuffer(other, np.uint8)})
    with pytest.raises(form.refused, match="has format 2, written by toros_fem .* reads format 3"):
        form.read(path)
    np.savez(path, flat_points=np.zeros(3))
    with pytest.raises(form.refused, match="another kind of file"):
        form.read(path)
    write_archive(path, Archive("something", {}, {}))
    with pytest.raises(form.refused, match="another kind of file"):
        form.read(path)


@pytest.mark.parametrize("name", [n for n in ARCHIVES if n != "checkpoint"])
@MANY
@given(data=st.data())
def test_other_entries(name: str, data: st.DataObject, folder: Path) -> None:
    """The archive is whole, and an entry in it is another: of its kind, or of none."""
    form = FORMATS[name]
    path = form.write(empty(folder), data.draw(form.drawn))
    x, content = form.read(path), content_of(path, name)
    values = NUMBERS | st.integers(-(2**40), 2**40) | st.text(max_size=5) | st.booleans()
    other = data.draw(values | st.lists(NUMBERS, max_size=5))
    arrays, numbers = dict(content.arrays), dict(content.numbers)
    entry = data.draw(st.sampled_from([*arrays, *numbers]))
    if entry in arrays:
        arrays[entry] = np.asarray(other)
    else:
        numbers[entry] = other
    write_archive(path, Archive(name, arrays, numbers))
    with contextlib.suppress(*form.refused):
        assert len(changed(form.read(path), x)) <= 1


@pytest.mark.parametrize(
    ("name", "entry", "value", "words"),
    [
        ("pattern", "sewn", None, "is not valid: it lacks 'sewn'"),
        ("pattern", "moulded", "yes", "moulded"),
        ("print", "region_sizes", [1, 2], "the polygons do not fit the panels"),
        ("print", "region_sizes", lambda old: [old.sum() + 1, -1], "the polygons do not fit"),
        ("print", "region_bytes", lambda old: old[:8], "the polygons do not fit the panels"),
        ("print", "region_bytes", lambda old: 0 * old, "is not valid: "),
        ("print", "limits", {"width": -1.0}, "width = -1.0"),
        ("print", "limits", None, "lacks 'limits'"),
        ("skin", "aligned", None, "lacks 'aligned'"),
        ("frame", "positions", None, "positions"),
    ],
)
def test_wrong_entries(name: str, entry: str, value: Any, words: str, tmp_path: Path) -> None:
    path = fullest(name, tmp_path)
    content = content_of(path, name)
    arrays, numbers = dict(content.arrays), dict(content.numbers)
    for part in (arrays, numbers):
        if entry in part:
            part[entry] = value(part[entry]) if callable(value) else value
            if value is None:
                del part[entry]
            elif part is arrays:
                part[entry] = np.asarray(part[entry])
    write_archive(path, Archive(name, arrays, numbers))
    with pytest.raises(FORMATS[name].refused, match=words):
        FORMATS[name].read(path)


# ------------------------------------------------------------------------ meshes of other programs

MESHES: dict[str, dict[str, Any]] = {
    "ascii.stl": {"binary": False}, "binary.stl": {"binary": True}, "ascii.ply": {"binary": False},
    "binary.ply": {"binary": True}, "skin.obj": {}, "skin.off": {}, "skin.mesh": {},
    "old.msh": {"file_format": "gmsh22", "binary": False},
    "new.msh": {"file_format": "gmsh", "binary": False}, "skin.vtu": {"binary": False},
    "skin.xdmf": {"data_format": "XML"}, "skin.vtk": {"binary": False},
}  # fmt: skip


@pytest.fixture
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files here are small: what hangs in meshio shall not last."""
    monkeypatch.setattr(files, "SECONDS", 1.0)


@pytest.mark.usefixtures("_impatient")
@pytest.mark.parametrize("name", MESHES)
@settings(MANY, max_examples=12)
@given(faults=st.lists(FAULTS, min_size=1, max_size=3))
def test_damaged_meshes(name: str, faults: list[tuple[str, float, int]], folder: Path) -> None:
    """As a skin, or as the shape that a skin shall take, a mesh is sound or refused."""
    path, skin = empty(folder) / name, moulded(POINTS, TRIANGLES)
    meshio.write_points_cells(path, POINTS, [("triangle", TRIANGLES)], **MESHES[name])
    assert len(read_surface(ALONE, path).triangles) == len(TRIANGLES)
    content = path.read_bytes()
    for fault in faults:
        content = damaged(content, *fault) or b"\n"
    path.write_bytes(content)
    with contextlib.suppress(errors.SurfaceError, errors.PatternError):
        found = read_surface(ALONE, path)
        assert np.isfinite(found.points).all()
        assert np.array_equal(np.unique(found.triangles), np.arange(len(found.points)))
    with contextlib.suppress(errors.ParameterError):
        target = from_mesh(ALONE, path, skin)
        assert target.shape == skin.points.shape
        assert np.isfinite(target).all()


# --------------------------------------------------------------------------------- other numbers


@MANY
@given(pair=quantities())
def test_units(pair: tuple[float, str]) -> None:
    value, unit = pair
    assert read_quantity(write_quantity(value, unit), unit) == value


# -------------------------------------------------------------------------------- machine files

SHEET = 0.45, 0.3
SVG = "{http://www.w3.org/2000/svg}"
Drawn = dict[str, list[tuple[np.ndarray, bool]]]


@st.composite
def sheets(draw: st.DrawFn) -> list[PanelDrawing]:
    """All panels of a skin, turned, side by side on a sheet."""
    pattern = pattern_of(draw(st.sampled_from(["tube", "gripper", "sphere"])))
    x, placed = 0.02, []
    for drawing in panel_drawings(pattern, striped(pattern), ManufactureOptions()):
        turned = drawing.moved(Affine.turn(draw(st.sampled_from([0.0, 1.0, np.pi / 2]))))
        left, low, right, _ = turned.footprint.bounds
        placed.append(turned.moved(Affine.shift([x - left, 0.02 - low])))
        x += right - left + 5e-3
    return placed


def wanted_lines(drawings: list[PanelDrawing]) -> tuple[Drawn, list[Label]]:
    """What each layer shows in mm: lines, and whether they are closed; and all texts."""
    lines: Drawn = {}
    labels: list[Label] = []
    for name, layers in CutSheet(SHEET, drawings).layers.items():
        lines[name] = []
        for layer in layers:
            parts = shapely.get_parts(shapely.orient_polygons(layer.region))
            rings = [shapely.get_coordinates(r) for r in shapely.get_rings(parts)]
            for line in [*rings, *layer.lines]:
                closed = len(line) > 2 and bool(np.allclose(line[0], line[-1], rtol=0, atol=1e-6))
                lines[name].append((1e3 * np.asarray(line)[: len(line) - closed], closed))
            labels += layer.labels
    return lines, labels


def read_dxf(path: Path) -> tuple[Drawn, list[Label]]:
    ezdxf = pytest.importorskip("ezdxf", reason="ezdxf is not installed")
    document = ezdxf.readfile(path)
    assert not document.audit().errors
    assert (document.header["$INSUNITS"], document.header["$MEASUREMENT"]) == (4, 1)  # mm
    lines: Drawn = {}
    for line in document.modelspace().query("LWPOLYLINE"):
        points = np.array(line.get_points("xy"))
        lines.setdefault(line.dxf.layer, []).append((points, line.closed))
    texts = document.modelspace().query("TEXT")
    assert {text.get_placement()[0].name for text in texts} == {"MIDDLE_CENTER"}
    labels = [
        Label(
            text.dxf.text, np.array(text.get_placement()[1])[:2] / 1e3,
            np.radians(text.dxf.rotation), text.dxf.height / 1e3,
        )
        for text in texts
    ]  # fmt: skip
    return lines, labels


def read_svg(path: Path) -> tuple[Drawn, list[Label]]:
    root = ET.parse(path).getroot()
    assert root.get("viewBox") == "0 0 450.000 300.000"
    assert (root.get("width"), root.get("height")) == ("450.000mm", "300.000mm")
    lines: Drawn = {}
    labels = []
    for group in root.findall(f"{SVG}g"):
        for path_ in group.iter(f"{SVG}path"):
            for ring in path_.get("d", "").split("M")[1:]:
                pairs = [pair.split(",") for pair in ring.strip(" Z").split(" L")]
                points = np.array(pairs, dtype=float) * [1, -1] + [0, 1e3 * SHEET[1]]
                lines.setdefault(group.get("id", ""), []).append((points, "Z" in ring))
        for text in group.iter(f"{SVG}text"):
            words = re.findall(r"-?[\d.]+", text.get("transform", ""))
            x, y, turn = map(float, words)
            height = 0.72 * float(text.get("font-size", "")) / 1e3
            angle = -np.radians(turn)
            up = np.array([-np.sin(angle), np.cos(angle)]) * height / 2
            place = np.array([x, 1e3 * SHEET[1] - y]) / 1e3 + up
            labels.append(Label(text.text or "", place, angle, height))
    return lines, labels


@pytest.mark.parametrize(
    ("name", "write", "read", "off"),
    [("cut.dxf", cut_dxf, read_dxf, 1e-6), ("cut.svg", cut_svg, read_svg, 2e-3)],
)
@settings(FEW, max_examples=6)
@given(drawings=sheets())
def test_cut_files(
    name: str, write: Any, read: Any, off: float, drawings: list[PanelDrawing], folder: Path
) -> None:
    """Each line and text of each layer, in mm, in its order; rings run as on the sheet."""
    path = empty(folder) / name
    path.write_bytes(write(CutSheet(SHEET, drawings)))
    (lines, labels), (wanted, texts) = read(path), wanted_lines(drawings)
    assert {key: len(rows) for key, rows in lines.items()} == {
        key: len(rows) for key, rows in wanted.items() if rows
    }
    for key, rows in lines.items():
        for (points, closed), (expected, ends) in zip(rows, wanted[key], strict=True):
            assert closed == ends
            if (
                name == "cut.svg" and closed and key in ("print", "cut")
            ):  # filled by the even-odd rule
                one, other = map(shapely.Polygon, (points, expected))
                assert one.symmetric_difference(other).area < off * other.length
            else:
                assert points == pytest.approx(expected, abs=off)
    for found, label in zip(labels, texts, strict=True):
        assert found.text == label.text
        assert found.place == pytest.approx(label.place, abs=off)
        assert np.exp(1j * found.angle) == pytest.approx(np.exp(1j * label.angle), abs=1e-4)
        assert found.height == pytest.approx(label.height, abs=2e-6)


@settings(FEW, max_examples=6)
@given(rng=seeds(), names=st.lists(WORDS, min_size=1, max_size=3, unique=True))
def test_bodies(rng: np.random.Generator, names: list[str], folder: Path) -> None:
    """Corners in single precision in mm; triangles, names and the locale stay."""
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    pytest.importorskip("lib3mf", reason="lib3mf is not installed")
    bodies = [(name, POINTS + rng.uniform(0, 0.1, 3), TRIANGLES) for name in names]
    place, before = empty(folder), locale.setlocale(locale.LC_ALL)
    (place / "print.3mf").write_bytes(threemf_of(bodies))
    assert locale.setlocale(locale.LC_ALL) == before
    scene = trimesh.load(place / "print.3mf", process=False)
    assert scene.units == "millimeter"
    assert set(scene.geometry) == set(names)
    (place / "print.stl").write_bytes(stl_of(bodies))
    corners = trimesh.load_mesh(place / "print.stl", process=False).triangles
    for number, (called, vertices, _) in enumerate(bodies):
        matrix, name = scene.graph[called]
        mesh = scene.geometry[name]
        assert np.array_equal(matrix, np.eye(4))
        assert mesh.vertices == pytest.approx(1e3 * vertices, rel=1e-6, abs=1e-5)
        assert np.array_equal(mesh.faces, TRIANGLES)
        own = corners[number * len(TRIANGLES) : (number + 1) * len(TRIANGLES)]
        assert own == pytest.approx(1e3 * vertices[TRIANGLES], rel=1e-6, abs=1e-5)
