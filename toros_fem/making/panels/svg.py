"""SVG drawing of the pattern in true scale, for printer and cutter."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.files import replace_file
from toros_fem.meshes.panels import panel_places
from toros_fem.meshes.pattern import Pattern

# Gap in m between panels that are packed here.
GAP = 10e-3
# Margin in mm.
MARGIN = 5.0


def write_svg(path: Path, pattern: Pattern, regions: Sequence[BaseGeometry]) -> None:
    """Write the panels and their print as an SVG drawing in true scale (one rank).

    One user unit is 1 mm. Each panel is a group with the path "cut" (its border, red, unfilled)
    and the path "print" (the print, black, filled by the even-odd rule). Panels keep the places of
    the flat pattern where they do not overlap there.

    Args:
        path: File to write.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
    """
    offsets = [place.offset for place in panel_places(pattern, GAP)]
    groups = []
    high: Floats = np.zeros(2)
    for panel, (offset, printed) in enumerate(zip(offsets, regions, strict=True)):
        outline = pattern.outline(panel)
        high = np.maximum(high, np.array(outline.bounds[2:]) + offset)
        groups.append((pattern.panel_names[panel], outline, printed, offset))
    width, height = 1e3 * high + 2 * MARGIN
    svg = ET.Element(
        "svg",
        xmlns="http://www.w3.org/2000/svg",
        width=f"{width:.3f}mm",
        height=f"{height:.3f}mm",
        viewBox=f"0 0 {width:.3f} {height:.3f}",
    )
    for name, outline, printed, offset in groups:
        group = ET.SubElement(svg, "g", id=name)
        ET.SubElement(group, "title").text = name
        # The y axis points down in the drawing and up on the panel.
        map_to = [1e3, 0, 0, -1e3, MARGIN + 1e3 * offset[0], height - MARGIN - 1e3 * offset[1]]
        style = {"fill": "black", "fill-rule": "evenodd", "stroke": "none"}
        for kind, shape, look in (
            ("print", printed, style),
            ("cut", outline, {"fill": "none", "stroke": "red", "stroke-width": "0.1"}),
        ):
            if not shape.is_empty:
                d = path_data(affine_transform(shape, map_to))
                ET.SubElement(group, "path", {"class": kind, "d": d, **look})
    ET.indent(svg)
    replace_file(path, ET.tostring(svg, encoding="utf-8", xml_declaration=True))


def path_data(shape: BaseGeometry) -> str:
    """Return the path data of a region whose coordinates are in mm."""
    rings = []
    for polygon in shapely.get_parts(shape):
        for ring in (polygon.exterior, *polygon.interiors):
            points = shapely.get_coordinates(ring)[:-1]
            rings.append("M" + " L".join(f"{x:.4f},{y:.4f}" for x, y in points) + " Z")
    return " ".join(rings)
