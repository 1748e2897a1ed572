"""Cut files of a sheet, SVG and DXF, with layers for print, cut, seam, marks and labels."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MissingPackageError
from toros_fem.making.panels.marks import CLEAR, HEIGHT, ruler
from toros_fem.making.panels.panel_drawing import PanelDrawing
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.svg import path_data

# Layers from the lowest to the highest: the order in which most machines work, the cut at last.
LAYERS = ("print", "seam", "marks", "labels", "cut")
# Colours of the layers as cutters tell them apart: in SVG, and by number in DXF.
COLOURS = {
    "print": ("#808080", 8),
    "seam": ("#0000ff", 5),
    "marks": ("#00a000", 3),
    "labels": ("#000000", 7),
    "cut": ("#ff0000", 1),
}
# Width of lines in mm.
LINE = 0.1
# Height of capitals over the size of a font without serifs.
CAPITAL = 0.72
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
MILLIMETRES = 4


@dataclass(frozen=True, eq=False)
class Layer:
    """What one layer shows of one panel, or of the sheet itself.

    Attributes:
        of: Name of the panel; "sheet" for the ruler.
        region: Polygons in m.
        lines: Lines, (n, 2) in m each.
        labels: Texts.
    """

    of: str
    region: BaseGeometry
    lines: Sequence[Floats]
    labels: Sequence[Label]


def sheet_layers(
    drawings: Sequence[PanelDrawing], sheet: tuple[float, float]
) -> dict[str, list[Layer]]:
    """Return what each layer of a sheet shows, by its name.

    Notches are cut, so they belong to the layer of the cut.

    Args:
        drawings: Panels at their places on the sheet.
        sheet: Width and height of the sheet in m.
    """
    none = shapely.Polygon()
    lines, label, _ = ruler(_taken(drawings), sheet)
    layers: dict[str, list[Layer]] = {name: [] for name in LAYERS}
    for one in drawings:
        seams = [seam.line for seam in one.seams]
        layers["print"].append(Layer(one.name, one.printed, (), ()))
        layers["seam"].append(Layer(one.name, none, seams, ()))
        layers["marks"].append(Layer(one.name, none, one.marks, ()))
        layers["labels"].append(Layer(one.name, none, (), one.labels))
        layers["cut"].append(Layer(one.name, one.cut, list(one.notches), ()))
    layers["marks"].append(Layer("sheet", none, lines, ()))
    layers["labels"].append(Layer("sheet", none, (), (label,)))
    return layers


def room_below(drawings: Sequence[PanelDrawing], sheet: tuple[float, float]) -> float:
    """Return the height in m that the ruler takes below a sheet, 0 where it lies on the sheet."""
    _, _, inside = ruler(_taken(drawings), sheet)
    return 0.0 if inside else HEIGHT + 4 * CLEAR


def _taken(drawings: Sequence[PanelDrawing]) -> BaseGeometry:
    return shapely.union_all([drawing.footprint for drawing in drawings])


def cut_svg(drawings: Sequence[PanelDrawing], sheet: tuple[float, float]) -> bytes:
    """Return a sheet as an SVG drawing in true scale, one user unit is 1 mm.

    Each layer is a group that Inkscape opens as a layer. Its groups are the panels. The print is
    filled by the even-odd rule; all else are lines of 0.1 mm without a filling.

    Args:
        drawings: Panels at their places on the sheet.
        sheet: Width and height of the sheet in m.
    """
    layers = sheet_layers(drawings, sheet)
    width, height = 1e3 * sheet[0], 1e3 * (sheet[1] + room_below(drawings, sheet))
    ET.register_namespace("inkscape", INKSCAPE)
    svg = ET.Element(
        "svg",
        xmlns="http://www.w3.org/2000/svg",
        width=f"{width:.3f}mm",
        height=f"{height:.3f}mm",
        viewBox=f"0 0 {width:.3f} {height:.3f}",
    )
    # The y axis points down in the drawing and up on the sheet.
    map_to = [1e3, 0, 0, -1e3, 0, 1e3 * sheet[1]]
    for name in LAYERS:
        colour = COLOURS[name][0]
        group = ET.SubElement(
            svg,
            "g",
            {"id": name, f"{{{INKSCAPE}}}groupmode": "layer", f"{{{INKSCAPE}}}label": name},
        )
        look = {"fill": "none", "stroke": colour, "stroke-width": f"{LINE}"}
        if name == "print":
            look = {"fill": colour, "fill-rule": "evenodd", "stroke": "none"}
        if name == "labels":
            look = {"fill": colour, "font-family": "sans-serif", "text-anchor": "middle"}
        group.attrib.update(look)
        for layer in layers[name]:
            part = ET.SubElement(group, "g", {"class": layer.of})
            if not layer.region.is_empty:
                ET.SubElement(part, "path", d=path_data(affine_transform(layer.region, map_to)))
            for line in layer.lines:
                ET.SubElement(part, "path", d=_line_data(1e3 * (line * [1, -1] + [0, sheet[1]])))
            for label in layer.labels:
                _add_text(part, label, sheet[1])
    ET.indent(svg)
    return ET.tostring(svg, encoding="utf-8", xml_declaration=True)


def _line_data(points: Floats) -> str:
    """Return the path data of a line, closed where it ends at its first point."""
    closed = len(points) > 2 and np.allclose(points[0], points[-1], rtol=0, atol=1e-6)
    texts = [f"{x:.4f},{y:.4f}" for x, y in (points[:-1] if closed else points)]
    return "M" + " L".join(texts) + (" Z" if closed else "")


def _add_text(parent: ET.Element, label: Label, top: float) -> None:
    """Add a text whose capitals have their middle at its place."""
    down = np.array([np.sin(label.angle), -np.cos(label.angle)]) * label.height / 2
    x, y = label.place + down
    place = f"{1e3 * x:.3f} {1e3 * (top - y):.3f}"
    turn = f"translate({place}) rotate({-np.degrees(label.angle) + 0:.3f})"
    size = f"{1e3 * label.height / CAPITAL:.3f}"
    ET.SubElement(parent, "text", {"transform": turn, "font-size": size}).text = label.text


def cut_dxf(drawings: Sequence[PanelDrawing], sheet: tuple[float, float]) -> bytes:
    """Return a sheet as a DXF drawing in mm.

    Borders of cut and print are closed polylines, counter-clockwise, and clockwise around holes.

    Args:
        drawings: Panels at their places on the sheet.
        sheet: Width and height of the sheet in m.

    Raises:
        MissingPackageError: ezdxf is not installed.
    """
    try:
        import ezdxf
        from ezdxf.enums import TextEntityAlignment
    except ImportError as missing:
        raise MissingPackageError(f"{missing}; pip install toros_fem[manufacture]") from None
    document = ezdxf.new("R2010", setup=True)
    document.units = MILLIMETRES
    document.header["$MEASUREMENT"] = 1
    space = document.modelspace()
    layers = sheet_layers(drawings, sheet)
    for name in LAYERS:
        document.layers.add(name, color=COLOURS[name][1])
        look = {"layer": name}
        for layer in layers[name]:
            region = shapely.get_parts(shapely.orient_polygons(layer.region))
            for ring in shapely.get_rings(region):
                points = 1e3 * shapely.get_coordinates(ring)[:-1]
                space.add_lwpolyline(points.tolist(), close=True, dxfattribs=look)
            for line in layer.lines:
                points = 1e3 * line
                closed = len(points) > 2 and np.allclose(points[0], points[-1], rtol=0, atol=1e-6)
                kept = points[:-1] if closed else points
                space.add_lwpolyline(kept.tolist(), close=bool(closed), dxfattribs=look)
            for label in layer.labels:
                text = space.add_text(
                    label.text,
                    height=1e3 * label.height,
                    rotation=float(np.degrees(label.angle)),
                    dxfattribs=look,
                )
                place = (1e3 * label.place).tolist()
                text.set_placement(place, align=TextEntityAlignment.MIDDLE_CENTER)
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
