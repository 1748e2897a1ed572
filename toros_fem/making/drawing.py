"""A print that somebody has drawn, SVG, DXF or GeoJSON in mm; and templates to draw it in.

Each panel is a group of an SVG, a layer of a DXF or a property of a GeoJSON, by its name. Its
border is there too, so that the drawing may lie anywhere on its sheet. What is filled is printed,
by the even-odd rule, and lines are as wide as their strokes.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError, ParameterError, TorosError
from toros_fem.base.files import naming, replace_file
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import required
from toros_fem.base.validation import Floats
from toros_fem.making.panel_drawing import write_svg
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.pattern import Pattern

FORMATS = (".svg", ".dxf", ".geojson")
CUT, PRINT = "cut", "print"
# Longest chord of a curve, in mm, and largest distance of a chord from it.
CHORD, SAGITTA = 0.2, 0.01
# Sizes of a border in the drawing and of its panel differ by this part at most.
SAME_SIZE = 5e-3
# Millimetres in a user unit of an SVG without a size, by CSS.
PIXEL = 25.4 / 96
UNITS = {"mm": 1.0, "cm": 10, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "px": PIXEL, "": PIXEL}
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
GROUP = "{http://www.w3.org/2000/svg}g"


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """A shape of a drawing in mm, y upwards: what it belongs to, "cut" or "print", and its area."""

    panel: str | None
    role: str
    region: BaseGeometry


def read_drawing(comm: MPI.Comm, path: Path | str, pattern: Pattern) -> list[BaseGeometry]:
    """Return the print on each panel of a pattern, polygons in m, from a drawing (collective).

    Args:
        path: A file that `write_template` has begun, .svg, .dxf or .geojson.
        pattern: The whole skin.

    Raises:
        FileError: It cannot be read, or draws nothing on the panels of this pattern; a border is
            missing or has another size than its panel.
    """
    file = Path(path)

    def read() -> list[BaseGeometry]:
        readers = {".svg": _svg_shapes, ".dxf": _dxf_shapes, ".geojson": _geojson_shapes}
        _require_format(file)
        try:
            shapes = [*readers[file.suffix.lower()](file, pattern.panel_names)]
        except TorosError:
            raise
        except OSError as caught:
            raise FileError(f"{file} cannot be read: {caught.strerror or caught}.") from caught
        except Exception as caught:
            raise FileError(
                f"{file} cannot be read as a drawing: {caught}. Begin with a template: "
                "`toros check SCENE --drawing FILE`."
            ) from caught
        return _on_panels(file, pattern, shapes)

    return on_first_rank(comm, read)


def write_template(comm: MPI.Comm, path: Path | str, pattern: Pattern) -> None:
    """Write the panels of a pattern, without a print, to draw one in (collective).

    Raises:
        ParameterError: The name ends in none of .svg, .dxf and .geojson.
        OutputError: It cannot be written.
    """
    file = Path(path)

    def write() -> None:
        _require_format(file)
        with naming(file):
            if file.suffix.lower() == ".svg":
                write_svg(file, pattern, [shapely.Polygon()] * len(pattern.panel_names))
            elif file.suffix.lower() == ".dxf":
                _write_dxf(file, pattern)
            else:
                _write_geojson(file, pattern)

    on_first_rank(comm, write)


def is_drawing(file: Path) -> bool:
    """Return whether a file is a drawing, by its name."""
    return file.suffix.lower() in FORMATS


def _require_format(file: Path) -> None:
    if not is_drawing(file):
        raise ParameterError(
            f"{file} ends in {file.suffix or 'nothing'}; a drawing ends in {', '.join(FORMATS)}."
        )


def _on_panels(file: Path, pattern: Pattern, shapes: Sequence[DrawnShape]) -> list[BaseGeometry]:
    """Return what is printed on each panel, from shapes that lie anywhere."""
    lost = [one for one in shapes if one.panel is None and one.role == PRINT]
    names = ", ".join(map(repr, pattern.panel_names[:8]))
    if lost:
        x, y = lost[0].region.representative_point().coords[0]
        raise FileError(
            f"{file}: {len(lost)} shapes belong to no panel, the first at ({x:.4g}, {y:.4g}) mm. "
            f"Move them into the group or layer of a panel: {names}."
        )
    regions = []
    for number, name in enumerate(pattern.panel_names):
        own = [one for one in shapes if one.panel == name]
        printed = [one.region for one in own if one.role == PRINT]
        outline = pattern.outline(number)
        if not printed:
            regions.append(shapely.Polygon())
            continue
        borders = [one.region for one in own if one.role == CUT]
        if not borders:
            raise FileError(
                f"{file}: the border of panel {name!r} is missing, so that the place of its print "
                "is not known. Keep the borders of the template."
            )
        here, there = shapely.total_bounds(borders), 1e3 * np.array(outline.bounds)
        sizes, wanted = here[2:] - here[:2], there[2:] - there[:2]
        if np.abs(sizes - wanted).max() > SAME_SIZE * wanted.max():
            raise FileError(
                f"{file}: the border of panel {name!r} is {sizes[0]:.4g} mm by {sizes[1]:.4g} mm, "
                f"and the panel {wanted[0]:.4g} mm by {wanted[1]:.4g} mm. Draw in the template of "
                "this scene, and export it in true scale, in mm."
            )
        place = Affine(1e-3 * np.eye(2), 1e-3 * (there[:2] - here[:2]))
        regions.append(shapely.union_all([place.region(one) for one in printed]) & outline)
    if all(region.is_empty for region in regions):
        raise FileError(
            f"{file} prints nothing. Fill shapes, or draw lines with a width, in the group or "
            f"layer of a panel: {names}."
        )
    return regions


def _even_odd(rings: Sequence[Floats]) -> BaseGeometry:
    """Return the region between rings (n, 2) by the even-odd rule."""
    polygons = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) > 2]
    return reduce(shapely.symmetric_difference, polygons, shapely.Polygon())


def _svg_shapes(file: Path, panels: Sequence[str]) -> Iterator[DrawnShape]:
    document = required("svgpathtools").Document(str(file))
    root = document.tree.getroot()
    parents = {child: parent for parent in root.iter() for child in parent}
    scale, height = _svg_scale(root)
    upright = Affine(np.diag([scale, -scale]), np.array([0.0, scale * height]))
    for path in document.paths():
        above = [path.element]
        while above[-1] in parents:
            above.append(parents[above[-1]])
        named = (one.get(key) for one in above if one.tag == GROUP for key in (LABEL, "id"))
        panel = next((name for name in named if name in panels), None)
        cut = any(CUT in (one.get("class") or "").split() for one in above)
        chord = CHORD / scale
        rings = [_sampled(part, chord) for part in path.continuous_subpaths()]
        parts = []
        if cut or _style(above, "fill", "black") != "none":
            parts.append(_even_odd(rings))
        if not cut and _style(above, "stroke", "none") != "none":
            stretched = float(np.sqrt(abs(np.linalg.det(path.transform[:2, :2]))))
            width = stretched * float(_style(above, "stroke-width", "1").removesuffix("px"))
            lines = [shapely.LineString(ring) for ring in rings if len(ring) > 1]
            parts += [line.buffer(width / 2, cap_style="flat") for line in lines]
        region = upright.region(shapely.union_all(parts))
        if not region.is_empty:
            yield DrawnShape(panel, CUT if cut else PRINT, region)


def _svg_scale(root: ET.Element) -> tuple[float, float]:
    """Return the millimetres of a user unit, and the height of the drawing in user units."""
    words = root.get("height", "").strip()
    number = words.rstrip("abcdefghijklmnopqrstuvwxyz%")
    unit = words[len(number) :]
    box = [float(word) for word in (root.get("viewBox") or "").replace(",", " ").split()]
    if len(box) == 4 and number and unit in UNITS:
        return float(number) * UNITS[unit] / box[3], box[1] + box[3]
    height = box[1] + box[3] if len(box) == 4 else float(number or 0.0)
    return UNITS.get(unit, PIXEL), height


def _style(above: Sequence[ET.Element], name: str, default: str) -> str:
    """Return a property of an element, from its style or those that it is in."""
    for one in above:
        pairs = (pair.partition(":") for pair in (one.get("style") or "").split(";"))
        styles = {key.strip(): value.strip() for key, _, value in pairs}
        if (value := styles.get(name, one.get(name))) is not None:
            return value
    return default


def _sampled(path: Any, chord: float) -> Floats:
    """Return points along a path, (n, 2): ends of lines, and points on curves."""
    points: list[complex] = [path[0].start]
    for segment in path:
        straight = type(segment).__name__ == "Line"
        count = 1 if straight else max(2, int(np.ceil(segment.length(error=1e-4) / chord)))
        points += [segment.point(t) for t in np.linspace(0, 1, count + 1)[1:]]
    return np.column_stack([np.real(points), np.imag(points)])


def _dxf_shapes(file: Path, panels: Sequence[str]) -> Iterator[DrawnShape]:
    reader = required("ezdxf")
    from ezdxf.path import from_hatch, make_path
    from ezdxf.units import MM, conversion_factor

    document = reader.readfile(file)
    scale = conversion_factor(document.units or MM, MM)
    for entity in document.modelspace():
        layer = entity.dxf.layer
        cut = layer.endswith(f" {CUT}")
        name = layer.removesuffix(f" {CUT}")
        panel = name if name in panels else None
        hatched = entity.dxftype() in ("HATCH", "MPOLYGON")
        try:
            paths = [*from_hatch(entity)] if hatched else [make_path(entity)]
        except TypeError:  # a text or a dimension
            continue
        rings = [
            scale * np.array([(v.x, v.y) for v in one.flattening(SAGITTA / scale)]) for one in paths
        ]
        closed = hatched or all(one.is_closed for one in paths)
        flat = entity.dxftype() == "LWPOLYLINE"
        width = scale * float(entity.dxf.get("const_width", 0.0)) if flat else 0.0
        parts = [_even_odd(rings)] if closed and not width else []
        if width and not cut:
            parts += [shapely.LineString(ring).buffer(width / 2) for ring in rings]
        region = shapely.union_all(parts)
        if not region.is_empty:
            yield DrawnShape(panel, CUT if cut else PRINT, region)


def _write_dxf(file: Path, pattern: Pattern) -> None:
    writer = required("ezdxf")
    document = writer.new(units=writer.units.MM)
    for name, outline in zip(pattern.panel_names, pattern.outlines, strict=True):
        document.layers.add(name)
        document.layers.add(f"{name} {CUT}", color=1)
        for ring in shapely.get_rings(outline):
            points = 1e3 * shapely.get_coordinates(ring)[:-1]
            document.modelspace().add_lwpolyline(
                points.tolist(), close=True, dxfattribs={"layer": f"{name} {CUT}"}
            )
    document.saveas(file)


def _geojson_shapes(file: Path, panels: Sequence[str]) -> Iterator[DrawnShape]:
    features = json.loads(file.read_text(encoding="utf-8"))["features"]
    for feature in features:
        told = feature.get("properties") or {}
        region = shape(feature["geometry"])
        if width := float(told.get("width_mm", 0.0)):
            region = region.buffer(width / 2)
        panel = told.get("panel")
        yield DrawnShape(
            panel if panel in panels else None, told.get("role", PRINT), shapely.make_valid(region)
        )


def _write_geojson(file: Path, pattern: Pattern) -> None:
    enlarged = Affine(1e3 * np.eye(2), np.zeros(2))
    features = [
        {
            "type": "Feature",
            "properties": {"panel": name, "role": CUT},
            "geometry": json.loads(shapely.to_geojson(enlarged.region(outline))),
        }
        for name, outline in zip(pattern.panel_names, pattern.outlines, strict=True)
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features}, indent=1)
    replace_file(file, f"{text}\n".encode())
