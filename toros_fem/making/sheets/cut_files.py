"""Cut files of a sheet, SVG and DXF, with layers for print, cut, seam, marks and labels."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import shapely

from toros_fem.making.packages import required
from toros_fem.making.panels.svg import Svg, open_line
from toros_fem.making.sheets.layout import LAYERS, Sheet

# Width of lines in mm.
LINE = 0.1
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
MILLIMETRES = 4


def cut_svg(sheet: Sheet) -> bytes:
    """Return a sheet as an SVG drawing in true scale, one user unit is 1 mm.

    Each layer is a group that Inkscape opens as a layer. Its groups are the panels. The print is
    filled by the even-odd rule; all else are lines of 0.1 mm without a filling.
    """
    ET.register_namespace("inkscape", INKSCAPE)
    svg = Svg(sheet.box, sheet.size[1])
    for name, layers in sheet.layers.items():
        colour, _ = LAYERS[name]
        look = {"fill": "none", "stroke": colour, "stroke-width": f"{LINE}"}
        if name == "print":
            look = {"fill": colour, "fill-rule": "evenodd", "stroke": "none"}
        if name == "labels":
            look = {"fill": colour, "font-family": "sans-serif", "text-anchor": "middle"}
        layer_of = {f"{{{INKSCAPE}}}groupmode": "layer", f"{{{INKSCAPE}}}label": name}
        group = svg.group({"id": name, **layer_of, **look})
        for layer in layers:
            svg.add(layer, svg.group({"class": layer.of}, group))
    return svg.encoded()


def cut_dxf(sheet: Sheet) -> bytes:
    """Return a sheet as a DXF drawing in mm.

    Borders of cut and print are closed polylines, counter-clockwise, and clockwise around holes.
    """
    ezdxf = required("ezdxf")
    document = ezdxf.new("R2010", setup=True)
    document.units = MILLIMETRES
    document.header["$MEASUREMENT"] = 1
    for name, (_, colour) in LAYERS.items():
        document.layers.add(name, color=colour)
        _draw(document.modelspace(), name, sheet)
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


def _draw(space: Any, name: str, sheet: Sheet) -> None:
    """Add a layer of a sheet to the space of a DXF drawing."""
    from ezdxf.enums import TextEntityAlignment

    look = {"layer": name}
    for layer in sheet.layers[name]:
        rings = shapely.get_rings(shapely.get_parts(shapely.orient_polygons(layer.region)))
        for line in (*map(shapely.get_coordinates, rings), *layer.lines):
            points, closed = open_line(line)
            space.add_lwpolyline((1e3 * points).tolist(), close=closed, dxfattribs=look)
        for label in layer.labels:
            text = space.add_text(
                label.text,
                height=1e3 * label.height,
                rotation=float(np.degrees(label.angle)),
                dxfattribs=look,
            )
            place = (1e3 * label.place).tolist()
            text.set_placement(place, align=TextEntityAlignment.MIDDLE_CENTER)
