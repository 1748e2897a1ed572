"""All machine files of a design, with their manifest and a page that shows how to make it."""

from __future__ import annotations

import ctypes
import io
import locale
import logging
import os
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError
from toros_fem.base.files import read_json, replacing, write_json
from toros_fem.base.packages import required
from toros_fem.base.validation import Floats, Ints
from toros_fem.making.layout import LAYERS, CutSheet, Manufacture, manufacture
from toros_fem.making.manifest import FORMAT, NAME, PAGE, MadeFile, manifest, page, print_height
from toros_fem.making.marks import Label, cross_shapes
from toros_fem.making.options import DEFAULT, OUTLINES, R12, ManufactureOptions
from toros_fem.making.panel_drawing import Layer, PanelDrawing, Svg, open_line
from toros_fem.meshes.pattern import Pattern, Regions

# Folder of the machine files in that of a run.
FOLDER = "manufacture"
# The manifest of the call that is writing.
NEXT = "manufacture.next.json"


def write_manufacture(
    folder: Path | str,
    pattern: Pattern,
    regions: Regions,
    options: ManufactureOptions | None = None,
    *,
    summary: Mapping[str, Any] | None = None,
    title: str = "",
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Write print files, cut files, manifest and page of a whole pattern (one rank).

    The files are print_1.stl and print_1.3mf for the first bed, cut_1.svg and cut_1.dxf for the
    first sheet, and so on; manufacture.json and make_it.html.
    All are written beside before the first one takes its place, so that a full disk leaves those of
    an earlier call whole; these, which its manufacture.json lists, go at the end if they are as
    they were written. All others stay. Returned is the manifest.

    Args:
        options: Settings; None takes those of `made_as`.
        summary: The run's summary, for materials, pressure and metrics; None knows none.
        title: Name of the design on the page; by default that of the folder above.
        others: Names of files that the caller writes into the folder afterwards.

    Raises:
        FileError: A file of somebody else, or one that was changed, has the name of one
            that would be written.
        OutlineError, PatternError, MissingPackageError: As of `manufacture`, or a package of the
            extra `manufacture` is not installed.
    """
    folder = Path(folder)
    options = options or made_as(summary)
    made = manufacture(pattern, regions, options)
    files = list(machine_files(made))
    about = manifest(made, files, summary, others)
    shown = page(made, about, title or folder.resolve().parent.name, summary)
    contents = {**{file.name: file.content for file in files}, PAGE: shown.encode()}
    folder.mkdir(parents=True, exist_ok=True)
    earlier = _earlier(folder)
    _require_room(folder, [NAME, NEXT, *contents, *others], earlier)
    # With it the files are known as those of this package, also after a kill between two of them.
    write_json(folder / NEXT, about)
    with ExitStack() as swapped:
        try:
            for name, content in contents.items():
                beside = swapped.enter_context(replacing(folder / name))
                with beside.open("wb") as file:
                    file.write(content)
                    os.fsync(file.fileno())  # what does not fit on the disk is told here
        except BaseException:
            (folder / NEXT).unlink()
            raise
    write_json(folder / NAME, about)
    there = {path.name for path in folder.iterdir()}
    for name in sorted(there & (earlier.keys() - {NAME, NEXT, *contents, *others})):
        if _is_ours(folder / name, earlier):
            (folder / name).unlink()
    (folder / NEXT).unlink()
    return about


def made_before(folder: Path) -> list[Path]:
    """Return the files that earlier calls wrote into a folder, and that are there (one rank).

    Raises:
        FileError: One of them was changed since.
    """
    earlier = _earlier(folder)
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    names = sorted(name for name in earlier.keys() & there if (folder / name).is_file())
    if names:
        _require_room(folder, names, earlier)
    return [folder / name for name in names]


def machine_files(made: Manufacture) -> Iterator[MadeFile]:
    """Yield each file for printer and cutter."""
    for bed, sheet in enumerate(made.beds, 1):
        bodies = print_bodies(sheet.drawings, made.options)
        for end, written in PRINTS.items() if bodies else ():
            shows = f"print of bed {bed}, in mm"
            yield MadeFile(f"print_{bed}.{end}", "print", shows, written(bodies), bed=bed)
    for number, sheet in enumerate(made.sheets, 1):
        for end, cut in CUTS.items():
            shows = f"cut of sheet {number}, in mm, in layers"
            yield MadeFile(
                f"cut_{number}.{end}", "cut", shows, cut(sheet, made.options), sheet=number
            )


def made_as(summary: Mapping[str, Any] | None) -> ManufactureOptions:
    """Return the settings that fit a run's summary: height and face of the print, grain.

    The height is that of `print_height`. The grain is that of the wales, across the courses of a
    knit. Without a summary they are the defaults.
    """
    inputs = (summary or {}).get("inputs") or {}
    known: dict[str, Any] = {"layer_height": print_height(inputs)[0]}
    known["print_side"] = inputs.get("print_side")
    if inputs.get("knit_ratio") is not None:
        known["grain"] = 90.0 + inputs["grain_angle"]
    return ManufactureOptions(**{name: value for name, value in known.items() if value is not None})


def _earlier(folder: Path) -> dict[str, set[str] | None]:
    """Return the files of earlier calls, by name with their digests; None where none is known."""
    found: dict[str, set[str] | None] = {}
    for name in (NAME, NEXT):
        with suppress(Exception):  # anybody's file may have this name
            last = read_json(folder / name)
            if last["format"] == FORMAT:
                found |= dict.fromkeys([NAME, NEXT, PAGE, *last.get("others", ())])
                for file in last["files"]:
                    digests = found.setdefault(Path(file["name"]).name, set())
                    if digests is not None:
                        digests.add(file.get("sha256"))
    return found


def _is_ours(path: Path, earlier: Mapping[str, set[str] | None]) -> bool:
    """Return whether a file is as an earlier call wrote it, or of one without a digest."""
    digests = earlier.get(path.name, set())
    return digests is None or sha256(path.read_bytes()).hexdigest() in digests


def _require_room(
    folder: Path, names: Sequence[str], earlier: Mapping[str, set[str] | None]
) -> None:
    """Raise where somebody else's files have the names of new ones."""
    there = {path.name for path in folder.iterdir()}
    barred = [name for name in names if name in there and not _is_ours(folder / name, earlier)]
    if barred:
        raise FileError(
            f"{folder} has {', '.join(barred)}, which {NAME} there does not list as made by "
            "toros, or which changed since. Move such files, or choose another folder; nothing "
            "was done to them."
        )


# It warns that R12 has no units, which would be printed.
logging.getLogger("ezdxf").addHandler(logging.NullHandler())
# Width of lines in mm.
LINE = 0.1
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
MILLIMETRES = 4
# The font of outlines, which comes with matplotlib, and the height of its capitals over its size.
FONT, CAPITAL = "DejaVu Sans", 0.729
# Size at which its curves become polygons, in units of which one is the largest error.
FINE = 200.0


def cut_svg(sheet: CutSheet, options: ManufactureOptions = DEFAULT) -> bytes:
    """Return a sheet as an SVG drawing in true scale, one user unit is 1 mm.

    Each layer is a group that Inkscape opens as a layer. Its groups are the panels. The print is
    filled by the even-odd rule; all else are lines of 0.1 mm without a filling.
    """
    ET.register_namespace("inkscape", INKSCAPE)
    svg = Svg(sheet.box, sheet.size[1])
    for name, layers in _layers(sheet, options).items():
        colour, _ = LAYERS[name]
        look = {"fill": "none", "stroke": colour, "stroke-width": f"{LINE}"}
        if name == "print":
            look = {"fill": colour, "fill-rule": "evenodd", "stroke": "none"}
        if name == "labels" and options.letters != OUTLINES:
            look = {"fill": colour, "font-family": "sans-serif", "text-anchor": "middle"}
        layer_of = {f"{{{INKSCAPE}}}groupmode": "layer", f"{{{INKSCAPE}}}label": name}
        group = svg.group({"id": name, **layer_of, **look})
        for layer in layers:
            svg.add(layer, svg.group({"class": layer.of}, group))
    return svg.encoded()


def cut_dxf(sheet: CutSheet, options: ManufactureOptions = DEFAULT) -> bytes:
    """Return a sheet as a DXF drawing in mm.

    Borders of cut and print are closed polylines, counter-clockwise, and clockwise around holes.
    """
    ezdxf = required("ezdxf")
    document = ezdxf.new(options.dxf_version, setup=True, units=MILLIMETRES)
    space, corners = document.modelspace(), []
    add = space.add_polyline2d if options.dxf_version == R12 else space.add_lwpolyline
    for name, layers in _layers(sheet, options).items():
        document.layers.add(name, color=LAYERS[name][1])
        corners += [_draw(space, add, {"layer": name}, layer) for layer in layers]
    left, low, right, high = shapely.total_bounds(corners)
    space.reset_extents((left, low, 0), (right, high, 0))
    space.reset_limits((left, low), (right, high))
    # They are a set, whose order differs between processes.
    for kind in sorted(document.entitydb.dxf_types_in_use()):
        document.classes.add_class(kind)
    content = io.StringIO()
    # Without times and random identifiers, which would tell equal cuts apart.
    document.ezdxf_metadata()["CREATED_BY_EZDXF"] = "toros_fem"
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document.write(content)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    return content.getvalue().encode(document.output_encoding, "dxfreplace")


def _layers(sheet: CutSheet, options: ManufactureOptions) -> dict[str, list[Layer]]:
    """Return the layers of a sheet, with texts as the options have them."""
    layers = dict(sheet.layers)
    if options.letters == OUTLINES:
        layers["labels"] = [
            Layer(one.of, lines=[line for label in one.labels for line in outlines(label)])
            for one in layers["labels"]
        ]
    return layers


def outlines(label: Label) -> list[Floats]:
    """Return the outlines of a text's letters as closed lines in m, (n, 2) each."""
    required("matplotlib", "plot")
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0, 0), label.text, size=FINE, prop=FontProperties(family=FONT))
    rings = [np.asarray(ring) for ring in path.to_polygons()]
    x = np.concatenate([ring[:, 0] for ring in rings])
    middle = np.array([(x.min() + x.max()) / 2, CAPITAL * FINE / 2])
    c, s = np.cos(label.angle), np.sin(label.angle)
    turn = np.array([[c, s], [-s, c]]) * label.height / (CAPITAL * FINE)
    return [label.place + (ring - middle) @ turn for ring in rings]


def _draw(space: Any, add: Any, look: dict[str, str], layer: Layer) -> shapely.MultiPoint:
    """Add a layer to the space of a DXF drawing, and return its corners in mm."""
    from ezdxf.enums import TextEntityAlignment

    corners: list[Floats] = [np.empty((0, 2))]
    rings = shapely.get_rings(shapely.get_parts(shapely.orient_polygons(layer.region)))
    for line in (*map(shapely.get_coordinates, rings), *layer.lines):
        points, closed = open_line(line)
        add((1e3 * points).tolist(), close=closed, dxfattribs=look)
        corners.append(1e3 * points)
    for label in layer.labels:
        text = space.add_text(
            label.text,
            height=1e3 * label.height,
            rotation=float(np.degrees(label.angle)),
            dxfattribs=look,
        )
        place = 1e3 * label.place
        text.set_placement(place.tolist(), align=TextEntityAlignment.MIDDLE_CENTER)
        corners.append(place[None])
    return shapely.MultiPoint(np.concatenate(corners))


# Corners lie on a grid of 0.1 µm, which single precision in mm resolves on beds of 1 m.
GRID = 1e-7
# Half the width in m of the cut that separates parts which touch at a point.
NICK = 5e-6
# Width of the lines of a printed cross, over its size.
CROSS_LINE = 0.2
# Name of the material of a print, and the colour it is shown in.
PRINT, COLOUR = "print", (30, 30, 30, 255)


PrintBody = tuple[str, Floats, Ints]
"""Name of a closed body, its vertices (n, 3) in m, and its triangles (t, 3), counter-clockwise seen
from outside."""


def print_bodies(
    drawings: Sequence[PanelDrawing], options: ManufactureOptions = DEFAULT
) -> list[PrintBody]:
    """Return the bodies to print on a bed: one for each panel with print, and one for its crosses.

    The crosses are bodies of their own, named "… registration", which a slicer can leave out. They
    show a cutter with a camera where the print lies.
    """
    height, base = options.layer_height, options.fabric_offset or 0.0
    found: list[PrintBody] = []
    for drawing in drawings:
        if drawing.printed.is_empty:
            continue
        found.append((drawing.name, *print_body(drawing.printed, height, base)))
        if len(drawing.crosses):
            bars = shapely.linestrings(cross_shapes(drawing.crosses, drawing.cross_size))
            wide = CROSS_LINE * drawing.cross_size / 2
            region = shapely.union_all(shapely.buffer(bars, wide, cap_style="flat"))
            marks = print_body(region, height, base)
            found.append((f"{drawing.name} registration", *marks))
    return found


def print_body(region: BaseGeometry, height: float, base: float = 0.0) -> tuple[Floats, Ints]:
    """Return the body over a region, from a base in m: vertices (n, 3) in m, and triangles (t, 3).

    Corners are rounded to 0.1 µm. Parts that touch at a point only are separated by a cut of 10 µm,
    since four faces would meet at the edge above it.
    """
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(separated(region)))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    # Corners are found again by their places on the grid.
    places, number = np.unique(
        np.rint(corners.reshape(-1, 2) / GRID).astype(np.int64), axis=0, return_inverse=True
    )
    top = number.reshape(-1, 3)
    u, v = places[top[:, 1]] - places[top[:, 0]], places[top[:, 2]] - places[top[:, 0]]
    left = u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]
    top = np.where(left[:, None], top, top[:, ::-1])
    half = np.stack([top, np.roll(top, -1, axis=1)], axis=2).reshape(-1, 2)
    count = len(places)
    border = ~np.isin(half[:, 0] * count + half[:, 1], half[:, 1] * count + half[:, 0])
    i, j = half[border].T
    walls = [np.stack([i, j, j + count], axis=1), np.stack([i, j + count, i + count], axis=1)]
    triangles = np.concatenate([top + count, top[:, ::-1], *walls])
    level = np.repeat([base, base + height], count)
    return np.column_stack([np.tile(places * GRID, (2, 1)), level]), triangles


def separated(region: BaseGeometry) -> BaseGeometry:
    """Return a region with its corners on a grid of 0.1 µm, and no two borders that touch."""
    shape = shapely.set_precision(region, GRID)
    while True:
        rings = shapely.get_rings(shapely.get_parts(shape))
        points = [shapely.get_coordinates(ring)[:-1] for ring in rings]
        places, count = np.unique(
            np.concatenate([np.empty((0, 2)), *points]), axis=0, return_counts=True
        )
        touching = places[count > 1]
        if not len(touching):
            return shape
        nicks = shapely.box(*(touching - NICK).T, *(touching + NICK).T)
        shape = shapely.set_precision(shape.difference(shapely.union_all(nicks)), GRID)


def stl_of(bodies: Sequence[PrintBody]) -> bytes:
    """Return bodies as one binary STL file; its numbers are in mm."""
    corners = np.concatenate([1e3 * vertices[triangles] for _, vertices, triangles in bodies])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = np.zeros(
        len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("further", "<u2")]
    )
    faces["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    faces["corners"] = corners
    return b"toros_fem".ljust(80) + np.array(len(faces), "<u4").tobytes() + faces.tobytes()


def threemf_of(bodies: Sequence[PrintBody]) -> bytes:
    """Return bodies as the objects of a 3MF file in mm, at their places on the bed."""
    lib3mf = required("lib3mf")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    group = model.AddBaseMaterialGroup()
    material = group.AddMaterial(PRINT, wrapper.RGBAToColor(*COLOUR))
    point: Any = ctypes.c_float * 3
    corners: Any = ctypes.c_uint32 * 3
    for number, (name, vertices, triangles) in enumerate(bodies):
        item = model.AddMeshObject()
        item.SetName(name)
        places = [lib3mf.Position(point(*corner)) for corner in 1e3 * vertices]
        item.SetGeometry(places, [lib3mf.Triangle(corners(*ends.tolist())) for ends in triangles])
        item.SetObjectLevelProperty(group.GetResourceID(), material)
        # By default identifiers are random, and equal prints would differ.
        item.SetUUID(_identifier(f"object {number}"))
        placed = model.AddBuildItem(item, wrapper.GetIdentityTransform())
        placed.SetUUID(_identifier(f"item {number}"))
    model.SetBuildUUID(_identifier("build"))
    # lib3mf leaves the process in the locale "C", where text has no signs but those of ASCII.
    before = locale.setlocale(locale.LC_ALL)
    try:
        return bytes(model.QueryWriter("3mf").WriteToBuffer())
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _identifier(name: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, name))


# Files of what is printed and of what is cut, by their endings.
PRINTS = {"3mf": threemf_of, "stl": stl_of}
CUTS = {"svg": cut_svg, "dxf": cut_dxf}
