"""SVG drawings in true scale: the writer, and the drawing of a flat pattern."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.files import replace_file
from toros_fem.making.panels.panel_labels import Label
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.panels import panel_places
from toros_fem.meshes.pattern import Pattern, Regions

# Left, lower, right and upper end in m.
Box = tuple[float, float, float, float]

# Gap between panels that are packed here, and margin, in m.
GAP, MARGIN = 10e-3, 5e-3
# Height of capitals over the size of a font without serifs.
CAPITAL = 0.72
# Ends of a line that are closer than this, in m, are the same.
CLOSED = 1e-6
NOTHING = shapely.Polygon()


@dataclass(frozen=True, eq=False)
class Layer:
    """What a layer of a drawing shows, in m, of one panel or, "sheet", of the sheet itself."""

    of: str
    region: BaseGeometry = NOTHING
    lines: Sequence[Floats] = ()
    labels: Sequence[Label] = ()


class Svg:
    """A drawing in true scale: one user unit is 1 mm.

    It takes lengths in m with the y axis up; in the file y points down.

    Args:
        box: What the drawing shows, in m.
        top: The height in m that has y = 0 in the file.
        digits: Decimals of coordinates in mm.
        about: What is shown, for readers that do not see it. Such a drawing is as large as its
            page gives it room; without these words its width and height are those of the box.
    """

    def __init__(self, box: Box, top: float, *, digits: int = 4, about: str = "") -> None:
        self._place = Affine(np.diag([1e3, -1e3]), np.array([0.0, 1e3 * top]))
        self._digits = digits
        left, low, right, high = box
        x, y = self._place.points([left, high]) + 0.0
        width, height = 1e3 * (right - left), 1e3 * (high - low)
        size = {"width": f"{width:.3f}mm", "height": f"{height:.3f}mm"}
        if about:
            size = {"role": "img", "aria-label": about}
        view = f"{round(x, 3):g} {round(y, 3):g} {width:.3f} {height:.3f}"
        space = "http://www.w3.org/2000/svg"
        self.root = ET.Element("svg", {"xmlns": space, **size, "viewBox": view})

    def group(self, attributes: Mapping[str, str], parent: ET.Element | None = None) -> ET.Element:
        """Return a new group in another one, or in the drawing."""
        return ET.SubElement(self.root if parent is None else parent, "g", dict(attributes))

    def region(
        self, parent: ET.Element, region: BaseGeometry, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add polygons as one path, for a group that is filled by the even-odd rule."""
        if data := region_data(self._place.region(region), self._digits):
            ET.SubElement(parent, "path", {**(attributes or {}), "d": data})

    def line(
        self, parent: ET.Element, line: Floats, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add a line through points (n, 2), closed where it ends at its first point."""
        data = line_data(self._place.points(line), self._digits)
        ET.SubElement(parent, "path", {**(attributes or {}), "d": data})

    def disc(self, parent: ET.Element, centre: Floats, radius: float, fill: str) -> None:
        """Add a disc; its fill is a colour of CSS."""
        x, y = self._place.points(centre)
        place = {"cx": f"{x:.3f}", "cy": f"{y:.3f}", "r": f"{1e3 * radius:.3f}"}
        ET.SubElement(parent, "circle", {**place, "style": f"fill:{fill}"})

    def text(
        self, parent: ET.Element, label: Label, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add a text; its group must have `text-anchor` in the middle."""
        # The place is that of the baseline, so down from the middle by half of the capitals.
        down = np.array([np.sin(label.angle), -np.cos(label.angle)]) * label.height / 2
        x, y = self._place.points(label.place + down)
        turn = f"translate({x:.3f} {y:.3f}) rotate({round(-np.degrees(label.angle), 3) + 0:.3f})"
        look = {"transform": turn, "font-size": f"{1e3 * label.height / CAPITAL:.3f}"}
        ET.SubElement(parent, "text", {**(attributes or {}), **look}).text = label.text

    def add(self, layer: Layer, parent: ET.Element) -> None:
        """Add the region, the lines and the texts of a layer."""
        self.region(parent, layer.region)
        for line in layer.lines:
            self.line(parent, line)
        for label in layer.labels:
            self.text(parent, label)

    def __str__(self) -> str:
        """Return the drawing as a part of a page."""
        return ET.tostring(self.root, encoding="unicode")

    def encoded(self) -> bytes:
        """Return the drawing as a file."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="utf-8", xml_declaration=True)


def region_data(region: BaseGeometry, digits: int = 4) -> str:
    """Return the path data of polygons in mm, to be filled by the even-odd rule."""
    rings = shapely.get_rings(shapely.get_parts(region))
    return " ".join(line_data(shapely.get_coordinates(ring), digits) for ring in rings)


def line_data(line: Floats, digits: int = 4) -> str:
    """Return the path data of a line through points in mm, (n, 2)."""
    points, closed = open_line(line, 1e3 * CLOSED)
    return "M" + " L".join(f"{x:.{digits}f},{y:.{digits}f}" for x, y in points) + " Z" * closed


def open_line(line: Floats, near: float = CLOSED) -> tuple[Floats, bool]:
    """Return a line without the point that repeats its first, and whether there is one."""
    closed = len(line) > 2 and bool(np.abs(line[0] - line[-1]).max() <= near)
    return (line[:-1] if closed else line), closed


def write_svg(path: Path, pattern: Pattern, regions: Regions) -> None:
    """Write the panels and their print as an SVG drawing in true scale (one rank).

    One user unit is 1 mm. Each panel is a group with the path "cut" (its border, red, unfilled)
    and the path "print" (the print, black, filled by the even-odd rule). Panels keep the places of
    the flat pattern where they do not overlap there.
    """
    inward = Affine.shift([MARGIN, MARGIN])
    places = [inward @ place for place in panel_places(pattern, GAP)]
    outlines = [place.region(one) for place, one in zip(places, pattern.outlines, strict=True)]
    width, height = shapely.total_bounds(outlines)[2:] + MARGIN
    svg = Svg((0.0, 0.0, width, height), height)
    filled = {"class": "print", "fill": "black", "fill-rule": "evenodd", "stroke": "none"}
    bare = {"class": "cut", "fill": "none", "stroke": "red", "stroke-width": "0.1"}
    for name, place, outline, printed in zip(
        pattern.panel_names, places, outlines, regions, strict=True
    ):
        group = svg.group({"id": name})
        ET.SubElement(group, "title").text = name
        svg.region(group, place.region(printed), filled)
        svg.region(group, outline, bare)
    replace_file(path, svg.encoded())
