"""What mesh files hold: STL, OBJ and PLY in all spellings, MSH by gmsh, XDMF with tags, others.

STL, OBJ and PLY are read here, since libraries refuse or change what programs write: they stop at
a wrong facet count or an `end loop`, drop lines and groups, or sort vertices anew.
"""

from __future__ import annotations

import codecs
import io
import itertools
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from toros_fem.base.validation import Floats, Ints

# Names of the cell data that hold the part of each triangle; the first one found counts.
PARTS = ("gmsh:physical", "gmsh:geometrical", "obj:group_ids", "medit:ref", "cell_tags", "part")
# Cells that are no faces: volumes are told by their faces.
NO_FACES = ("vertex", "line", "tetra", "hexahedron", "wedge", "pyramid")
# Bytes before the facets of a binary STL, and of a facet.
HEADER, FACET = 84, 50
# What lies beyond the median facet of a binary STL by this factor is no facet.
FAR = 1e3
# Time in s in which gmsh reads a file.
SECONDS, SECONDS_PER_MEGABYTE = 20.0, 10.0
EARLY = "it ends before all that its header tells"
# Types of numbers in a PLY file.
PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip


@dataclass(eq=False)
class Content:
    """Points, faces and lines of a mesh file, in its order and in its unit.

    Attributes:
        points: Vertices, (n, 3), or (n, 2) of a flat mesh.
        faces: Corners of triangles and quadrilaterals, (f, 4), with −1 as fourth corner of
            a triangle. A face of several groups stands here once for each.
        tags: Group of each face, (f,).
        lines: Ends of line elements, (k, 2).
        names: Names of groups by their tags.
        other: Numbers of faces that are neither triangles nor quadrilaterals, in words.
        notes: What was odd about the file, a sentence each.
    """

    points: npt.NDArray[Any]
    faces: Ints
    tags: Ints
    lines: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    names: Mapping[int, str] = field(default_factory=dict)
    other: Sequence[str] = ()
    notes: Sequence[str] = ()

    @property
    def triangles(self) -> Ints:
        """The triangles, without quadrilaterals, each once, (t, 3)."""
        triangles = self.faces[self.faces[:, 3] == NONE, :3]
        return triangles[np.sort(np.unique(triangles, axis=0, return_index=True)[1])]


# Fourth corner of a triangle: no vertex, not even one that counts from the end.
NONE = np.iinfo(np.int64).min


def content_of(path: Path) -> Content:
    """Read a mesh file by the reader of its ending (one rank).

    Raises:
        ValueError: The file is damaged, in words for people; others have those of libraries.
    """
    reader = READERS.get(path.suffix.lower(), _other)
    return reader(path)


# ------------------------------------------------------------------------------------------ STL


def _stl(path: Path) -> Content:
    content = path.read_bytes()
    # Some binary files begin with "solid" too; their length tells them.
    told = HEADER + FACET * int.from_bytes(content[80:HEADER], "little")
    text = "" if len(content) == told else _text(content)
    corners = re.findall(
        r"^[ \t]*(?:(facet)\b|vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+))", text, re.I | re.M
    )
    if re.match(r"\s*(solid|facet)\b", text, re.I) and any(one[1] for one in corners):
        facets = sum(1 for one in corners if one[0])
        points = _numbers([word for one in corners if one[1] for word in one[1:]]).reshape(-1, 3)
        if len(points) % 3 or facets not in (0, len(points) // 3):
            raise ValueError(
                f"its {facets} facets have {len(points)} corners and not three each: it is cut "
                "off, or damaged"
            )
        return _loose(points)
    return _binary_stl(content)


def _binary_stl(content: bytes) -> Content:
    there, rest = divmod(len(content) - HEADER, FACET)
    if there < 1 or b"\0" not in content:  # as there is in a facet's attribute
        raise ValueError("it has no line 'vertex' with three numbers, and no binary facets")
    count = int.from_bytes(content[80:HEADER], "little")
    facet = np.dtype([("floats", "<f4", (4, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(content, facet, there, HEADER)["floats"][:, 1:].astype(np.float64)
    largest = np.abs(corners).max(axis=(1, 2))
    # Beyond a number that may be right there are facets, or anything: what is nowhere is none.
    with np.errstate(invalid="ignore"):
        apart = (corners != corners[:, :1]).any(axis=(1, 2))
        usual = np.sort(largest[apart & np.isfinite(largest)])
        sound = apart & (largest <= FAR * usual[len(usual) // 2 :].min(initial=np.inf))
    taken = sound | (np.arange(there) < count * (count <= there))
    notes = []
    if taken.sum() != count:
        notes.append(f"Its header says {count} facets, and it holds {taken.sum()}, which are read.")
    elif there > count or rest:
        notes.append(f"{len(content) - HEADER - FACET * count} bytes after its facets are ignored.")
    return _loose(corners[taken].reshape(-1, 3), notes)


def _loose(points: Floats, notes: Sequence[str] = ()) -> Content:
    """Return triangles that have corners of their own, (3 t, 3)."""
    triangles = np.arange(len(points)).reshape(-1, 3)
    return Content(points, _faces(triangles), np.zeros(len(triangles), np.int64), notes=notes)


# ------------------------------------------------------------------------------------------ OBJ


def _obj(path: Path) -> Content:
    """Read vertices, faces, lines and groups; normals, textures, curves and materials are left."""
    points: list[list[float]] = []
    weighted = 0
    corners: list[list[int]] = []
    tags: list[int] = []
    ends: list[tuple[int, int]] = []
    groups = {"default": 0}
    current, begun = [0], _Groups()
    more: dict[int, int] = {}
    for place, line in _obj_lines(_text(path.read_bytes())):
        word = line.split()
        try:
            match word[0].lower():
                case "v":
                    x, y, z, *weight = map(float, word[1:])
                    points.append([x, y, z])
                    weighted += len(weight) == 1 and weight[0] != 1
                case "f" | "fo":
                    ring = _corners(word, len(points))
                    if len(ring) in (3, 4):
                        begun.use(current)
                        for group in current:
                            corners.append([*ring, NONE][:4])
                            tags.append(group)
                    else:
                        more[len(ring)] = more.get(len(ring), 0) + 1
                case "l":
                    ends += itertools.pairwise(_corners(word, len(points)))
                case "g":
                    named = dict.fromkeys(word[1:] or ["default"])
                    current = [groups.setdefault(name, len(groups)) for name in named]
        except ValueError as error:
            shown = " ".join(word)
            raise ValueError(
                f"line {place} of it, {shown[:60]!r}, does not give "
                f"{'three coordinates' if word[0] == 'v' else 'vertices'} as numbers"
            ) from error
    if not points:
        raise ValueError("it has no line 'v' with three coordinates")
    known = {tag: name for name, tag in groups.items()}
    notes = [f"Its group {known[one]!r} comes {k} times, and is one." for one, k in begun.twice]
    if weighted:
        notes.append(f"The weights of {weighted} vertices, which are not 1, are ignored.")
    return Content(
        np.array(points, dtype=np.float64).reshape(-1, 3),
        np.array(corners, dtype=np.int64).reshape(-1, 4), np.array(tags, dtype=np.int64),
        np.array(ends, dtype=np.int64).reshape(-1, 2),
        known if len(groups) > 1 else {},
        [f"{k} of {size} corners" for size, k in sorted(more.items())],
        notes,
    )  # fmt: skip


def _obj_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield lines that are not empty with their numbers, without comments, continued ones whole."""
    begun, begin = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        said = re.split(r"(?:^|\s)#", line, maxsplit=1)[0].rstrip()
        if not begun:
            begin = number
        # A path in a comment may end with such a sign.
        if said.endswith("\\"):
            begun += said[:-1] + " "
        elif (begun + said).strip():
            yield begin, begun + said
            begun = ""
    if begun.strip():
        yield begin, begun


class _Groups:
    """How often each group of an OBJ file begins anew, after faces of other groups."""

    def __init__(self) -> None:
        self._last: set[int] = set()
        self._times: dict[int, int] = {}

    def use(self, current: Sequence[int]) -> None:
        """Take note of a face in groups."""
        if self._last != (now := set(current)):
            for one in now - self._last:
                self._times[one] = self._times.get(one, 0) + 1
            self._last = now

    @property
    def twice(self) -> list[tuple[int, int]]:
        """Groups that come several times, but for faces outside of all, and how often."""
        return [(one, k) for one, k in self._times.items() if k > 1 and one]


def _corners(word: Sequence[str], count: int) -> list[int]:
    """Return the vertices that a line names; negative ones count back from the last so far."""
    given = [int(one.split("/")[0]) for one in word[1:]]
    return [k - 1 if k >= 0 else count + k for k in given]


# ------------------------------------------------------------------------------------------ PLY


def _ply(path: Path) -> Content:
    content = path.read_bytes()
    head = re.match(rb"\s*ply\b(.*?)^[ \t]*end_header[ \t]*(\r\n|\n|\r)", content, re.S | re.M)
    if head is None:
        # A lone carriage return ends no line for `re`.
        head = re.match(rb"\s*ply\b(.*?)[\r\n]end_header[ \t]*(\r\n|\n|\r)", content, re.S)
    if head is None:
        raise ValueError("it does not begin with 'ply' and a header up to 'end_header'")
    order, elements = _ply_header(_text(head[1]))
    body = content[head.end() :]
    if order is None:  # text: the same rows of numbers, all of one type
        body, order = _numbers(_text(body).split()).tobytes(), "="
        as_text = True
    else:
        as_text = False
    found: dict[str, dict[str, Any]] = {}
    at = 0
    for name, count, properties in elements:
        kinds = [
            (one, "f8" if as_text else kind, size and ("f8" if as_text else size))
            for one, kind, size in properties
        ]
        columns, at = _ply_rows(body, at, count, kinds, order)
        found.setdefault(name, columns)
    vertex, face, edge = (found.get(name, {}) for name in ("vertex", "face", "edge"))
    if not {"x", "y", "z"} <= vertex.keys():
        raise ValueError("its vertices have no x, y and z")
    points = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float64)
    rings = next((face[one] for one in ("vertex_indices", "vertex_index") if one in face), ())
    sizes = np.array([len(ring) for ring in rings], dtype=np.int64)
    faces: Ints = np.full((len(sizes), 4), NONE, dtype=np.int64)
    for size in (3, 4):
        rows = np.flatnonzero(sizes == size)
        if len(rows):
            faces[rows, :size] = np.stack([rings[row] for row in rows])
    odd, counts = np.unique(sizes[(sizes < 3) | (sizes > 4)], return_counts=True)
    ends = [edge[one] for one in ("vertex1", "vertex2") if one in edge]
    lines = np.stack(ends, axis=1) if len(ends) == 2 else np.zeros((0, 2))
    faces = faces[(sizes == 3) | (sizes == 4)]
    return Content(
        points, faces, np.zeros(len(faces), dtype=np.int64), lines.astype(np.int64),
        other=[f"{k} of {size} corners" for size, k in zip(odd, counts, strict=True)],
    )  # fmt: skip


Property = tuple[str, str, str | None]
"""Name and type of a property, and the type of its length if it is a list."""


def _ply_header(text: str) -> tuple[str | None, list[tuple[str, int, list[Property]]]]:
    """Return the order of bytes, None for text, and name, count and properties of elements."""
    order: str | None = None
    elements: list[tuple[str, int, list[Property]]] = []
    for line in text.split("\n"):
        match line.split():
            case ["format", "ascii", *_]:
                order = None
            case ["format", "binary_little_endian", *_]:
                order = "<"
            case ["format", "binary_big_endian", *_]:
                order = ">"
            case ["element", name, count] if count.isdecimal():
                elements.append((name, int(count), []))
            case ["property", "list", size, kind, name] if elements:
                elements[-1][2].append((name, PLY_TYPES[kind], PLY_TYPES[size]))
            case ["property", kind, name] if elements and kind in PLY_TYPES:
                elements[-1][2].append((name, PLY_TYPES[kind], None))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header holds {line.strip()[:60]!r}")
    return order, elements


def _ply_rows(
    body: bytes, at: int, count: int, properties: Sequence[Property], order: str
) -> tuple[dict[str, Any], int]:
    """Return the columns of an element, whose rows begin at a byte, and where they end."""
    if not count or not properties:
        return {}, at
    sizes: list[int] = []
    row = _ply_row(body, at, properties, order, sizes)
    lists = [name for name, _, size in properties if size]
    if at + count * row.itemsize <= len(body):  # if all lists are as long as the first
        rows = np.frombuffer(body, row, count, at)
        same = (rows[f"{name} size"] == size for name, size in zip(lists, sizes, strict=True))
        if all(one.all() for one in same):
            return {name: rows[name] for name, *_ in properties}, at + count * row.itemsize
    columns: dict[str, list[Any]] = {name: [] for name, *_ in properties}
    for _ in range(count):
        row = _ply_row(body, at, properties, order, [])
        if at + row.itemsize > len(body):
            raise ValueError(EARLY)
        one = np.frombuffer(body, row, 1, at)[0]
        for name in columns:
            columns[name].append(one[name])
        at += row.itemsize
    return {
        name: values if name in lists else np.array(values) for name, values in columns.items()
    }, at


def _ply_row(
    body: bytes, at: int, properties: Sequence[Property], order: str, sizes: list[int]
) -> np.dtype[Any]:
    """Return the type of the row that begins at a byte; add the lengths of its lists to sizes."""
    fields: list[tuple[Any, ...]] = []
    for name, kind, size in properties:
        if size is None:
            fields.append((name, order + kind))
            continue
        begin = at + np.dtype(fields).itemsize
        fields.append((f"{name} size", order + size))
        if at + np.dtype(fields).itemsize > len(body):
            raise ValueError(EARLY)
        length = float(np.frombuffer(body, order + size, 1, begin)[0])
        if not 0 <= length <= len(body) - begin:
            raise ValueError(f"a list {name!r} of {length:g} numbers does not fit into it")
        sizes.append(int(length))
        fields.append((name, order + kind, (int(length),)))
    return np.dtype(fields)


# ------------------------------------------------------------------------------------------ MSH


def _msh(path: Path) -> Content:
    """Read a file by gmsh, but for groups of version 2, which stand at each triangle there."""
    content = path.read_bytes()
    # gmsh would run any other file as its script.
    if not content.startswith((b"$MeshFormat", b"$Comments", b"$NOD")):
        return _other(path)
    old = re.search(rb"\$MeshFormat\s+2", content[:1000]) is not None
    if not old or b"$ParametricNodes" in content:
        return _by_gmsh(path)
    found = _other(path, "gmsh")
    # For meshio groups of one name are a single one.
    section = re.search(rb"\$PhysicalNames(.*?)\$EndPhysicalNames", content, re.S)
    named = re.findall(rb'^\s*2\s+(\d+)\s+"([^"]*)"', section[1] if section else b"", re.M)
    found.names = {int(tag): _text(name) for tag, name in named}
    return found


def _by_gmsh(path: Path) -> Content:
    """Read a file by gmsh in another process, since damaged files break its memory."""
    command = [sys.executable, "-P", str(Path(__file__).with_name("msh_process.py")), str(path)]
    # A gmsh that was built with MPI must not take part in ours.
    apart = {key: of for key, of in os.environ.items() if not key.startswith(("OMPI", "PMI"))}
    seconds = SECONDS + SECONDS_PER_MEGABYTE * path.stat().st_size / 1e6
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=seconds, check=False, stdin=subprocess.DEVNULL,
            env=apart,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise TimeoutError from None
    if done.returncode:
        said = _text(done.stderr).strip().split("\n")
        raise ValueError(said[-1] if done.returncode == 1 and said[-1] else "it is damaged")
    with np.load(io.BytesIO(done.stdout)) as found:
        sizes = [size for size in ("3", "4") if size in found]
        named = zip(found["physical"].tolist(), found["names"].tolist(), strict=True)
        return _told_rest(
            Content(
                found["points"],
                _stacked([_faces(found[size]) for size in sizes], 4),
                _stacked([found[f"group {size}"] for size in sizes], 0),
                _stacked([found["line"]] if "line" in found else [], 2),
                {tag: name for tag, name in named if name},
                found["other"].tolist(),
            ),
            grouped=bool(len(found["physical"])),
        )


def _told_rest(found: Content, *, grouped: bool) -> Content:
    """Tell the faces outside of all groups, where there are groups."""
    rest = int(np.sum(found.tags == 0))
    if grouped and 0 < rest < len(found.tags):
        found.notes = [f"{rest} faces are in no physical group; they are the part 'part-0'."]
    return found


# ----------------------------------------------------------------------------------------- XDMF


def _xdmf(path: Path) -> Content:
    """Read a mesh with tags beside it, as dolfinx writes them; a single grid is read by meshio."""
    everything = list(ElementTree.parse(path).iter("Grid"))
    if len(everything) < 2:
        return _other(path)
    # Others are fields, or collections of them.
    grids = [grid for grid in everything if grid.find("Topology") is not None]
    meshes = [grid for grid in grids if grid.find("Geometry/DataItem") is not None]
    if len(meshes) != 1:
        raise ValueError(f"it holds {len(meshes)} meshes and not one grid with tags beside it")
    points = _xdmf_data(path, meshes[0].find("Geometry"))
    faces, lines = [_faces(_xdmf_cells(path, meshes[0]))], []
    tags = [np.full(len(faces[0]), -1)]
    names: dict[int, str] = {}
    of_faces = 0
    for grid in grids:
        name, values = grid.get("Name", "tags"), _xdmf_tags(path, grid)
        cells = _xdmf_cells(path, grid)
        if grid is meshes[0] or values is None or len(values) != len(cells):
            continue
        if cells.shape[1] == 2:
            lines.append(cells[values != 0])  # edges without a mark have 0
            continue
        of_faces += 1
        for value in np.unique(values):
            label = f"part-{value}" if of_faces == 1 else f"{name}-{value}"
            names[len(names)] = label
            faces.append(_faces(cells[values == value]))
            tags.append(np.full(np.sum(values == value), len(names) - 1))
    return _without_untagged(
        Content(points, _stacked(faces, 4), _stacked(tags, 0), _stacked(lines, 2), names)
    )


def _without_untagged(found: Content) -> Content:
    """Drop the faces without a tag, −1, that stand there with one too."""
    if not found.names:
        found.tags = found.tags + 1
        return found
    corners = np.sort(found.faces, axis=1)
    number = np.unique(corners, axis=0, return_inverse=True)[1].ravel()
    tagged = np.bincount(number, found.tags >= 0) > 0
    kept = (found.tags >= 0) | ~tagged[number]
    found.faces, found.tags = found.faces[kept], found.tags[kept]
    rest = int(np.sum(found.tags < 0))
    if rest:
        found.names = {**found.names, -1: "untagged"}
        found.notes = [f"{rest} faces have no tag; they are the part 'untagged'."]
    return found


def _xdmf_cells(path: Path, grid: ElementTree.Element) -> Ints:
    """Return the cells of a grid, (k, corners)."""
    topology = grid.find("Topology")
    kind = "" if topology is None else topology.get("TopologyType", "").lower()
    corners = {"triangle": 3, "quadrilateral": 4, "polyline": 2}.get(kind)
    if corners is None:
        raise ValueError(f"it holds cells of type {kind!r}, not triangles or quadrilaterals")
    return _xdmf_data(path, topology).astype(np.int64).reshape(-1, corners)


def _xdmf_tags(path: Path, grid: ElementTree.Element) -> Ints | None:
    for one in grid.iter("Attribute"):
        if one.get("Center", "Node") == "Cell":
            return _xdmf_data(path, one).astype(np.int64).ravel()
    return None


def _xdmf_data(path: Path, parent: ElementTree.Element | None) -> npt.NDArray[Any]:
    """Return the array in the data item of an element."""
    item = None if parent is None else parent.find("DataItem")
    if item is None or not item.text:
        raise ValueError("an array is missing in it")
    if item.get("Format") == "XML":
        shape = [int(one) for one in item.get("Dimensions", "").split()]
        return _numbers(item.text.split()).reshape(shape)
    if item.get("Format") != "HDF":
        raise ValueError(f"it holds arrays in the format {item.get('Format')!r}")
    import h5py

    file, _, place = item.text.strip().partition(":")
    with h5py.File(path.parent / file, "r") as opened:
        return np.asarray(opened[place])


# --------------------------------------------------------------------------------------- others


def _other(path: Path, file_format: str | None = None) -> Content:
    """Read a file by meshio."""
    import meshio

    mesh = meshio.read(path, file_format)
    named = (mesh.cell_data[one] for one in PARTS if _tagged(mesh, one))
    data = next(named, None)
    faces, tags, lines, other = [], [], [], []
    for number, block in enumerate(mesh.cells):
        if block.type in ("triangle", "quad"):
            faces.append(_faces(np.asarray(block.data, dtype=np.int64)))
            none = np.zeros(len(block.data))
            tags.append(none if data is None else np.asarray(data[number]).ravel())
        elif block.type == "line":
            lines.append(block.data)
        elif block.type not in NO_FACES:
            other.append(f"{len(block.data)} of type {block.type}")
    names = {int(tag): name for name, (tag, dim) in mesh.field_data.items() if dim == 2}
    found = Content(
        np.asarray(mesh.points), _stacked(faces, 4), _stacked(tags, 0), _stacked(lines, 2),
        names, other,
    )  # fmt: skip
    return _told_rest(found, grouped=_tagged(mesh, "gmsh:physical"))


def _tagged(mesh: Any, name: str) -> bool:
    """Return whether a mesh has cell data of this name that are not all 0."""
    return any(np.any(np.asarray(values) != 0) for values in mesh.cell_data.get(name, ()))


# ------------------------------------------------------------------------------- words and arrays


def _text(content: bytes) -> str:
    """Decode a text file of any program, whose lines end as those of Unix do."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\0", "")


def _numbers(words: Sequence[str]) -> Floats:
    """Return words as numbers; some programs write decimal commas, or exponents of Fortran."""
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        joined = " ".join(words)
    if "." not in joined:
        joined = joined.replace(",", ".")
    found = []
    for word in re.sub(r"(?<=\d)[dD](?=[-+\d])|(?<=\.)[dD](?=[-+\d])", "e", joined).split(" "):
        try:
            found.append(float(word))
        except ValueError as error:
            raise ValueError(f"{word[:60]!r} stands in place of a number") from error
    return np.array(found)


def _faces(corners: Ints) -> Ints:
    """Return triangles (t, 3) or quadrilaterals (q, 4) as faces."""
    fill: Any = ((0, 0), (0, 4 - corners.shape[1]))
    return np.pad(corners.astype(np.int64), fill, constant_values=NONE)


def _stacked(arrays: Sequence[Any], width: int) -> Ints:
    """Return whole numbers one after the other; 0 is the width of a single column."""
    empty = np.zeros((0, width) if width else 0, dtype=np.int64)
    return np.concatenate([empty, *arrays]).astype(np.int64)


READERS: Mapping[str, Callable[[Path], Content]] = {
    ".stl": _stl, ".obj": _obj, ".ply": _ply, ".msh": _msh, ".xdmf": _xdmf, ".xmf": _xdmf,
}  # fmt: skip
