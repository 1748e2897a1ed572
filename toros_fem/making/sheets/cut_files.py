"""Cut files of a sheet, SVG and DXF, with layers for print, cut, seam, marks and labels."""

from __future__ import annotations

import io
import logging
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import shapely

from toros_fem.base.array_types import Floats
from toros_fem.base.packages import required
from toros_fem.making.options import DEFAULT, OUTLINES, R12, ManufactureOptions
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.svg import Layer, Svg, open_line
from toros_fem.making.sheets.layout import LAYERS, Sheet

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


def cut_svg(sheet: Sheet, options: ManufactureOptions = DEFAULT) -> bytes:
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


def cut_dxf(sheet: Sheet, options: ManufactureOptions = DEFAULT) -> bytes:
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


def _layers(sheet: Sheet, options: ManufactureOptions) -> dict[str, list[Layer]]:
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
