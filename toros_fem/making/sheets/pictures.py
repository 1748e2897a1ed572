"""Pictures of beds, sheets and seams for a page, as SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.panels.panel_drawing import PanelDrawing
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.svg import path_data
from toros_fem.making.sheets.cut_files import LAYERS, room_below, sheet_layers

# Corners closer than this to a line between others are left out of pictures, in m.
SEEN = 0.02e-3
# Height of capitals over the size of a font without serifs.
CAPITAL = 0.72
# Diameter of the discs with the numbers of seams, over the width of the picture.
DISC = 0.028
# Turn of the hue from one seam to the next, in degrees: neighbours differ, none comes twice.
HUE = 137.5


def sheet_picture(drawings: Sequence[PanelDrawing], size: tuple[float, float], about: str) -> str:
    """Return a bed or a sheet with all that its files hold, one class for each layer.

    Args:
        drawings: Panels at their places.
        size: Width and depth of the sheet in m.
        about: What is shown, for readers that do not see it.
    """
    svg = _canvas((size[0], size[1] + room_below(drawings, size)), about)
    ET.SubElement(svg, "rect", {"class": "sheet", **_box(size)})
    layers = sheet_layers(drawings, size)
    fabric = ET.SubElement(svg, "g", {"class": "fabric"})
    for one in drawings:
        _region(fabric, one.cut, size)
    for name in LAYERS:
        group = ET.SubElement(svg, "g", {"class": name})
        for layer in layers[name]:
            if not layer.region.is_empty:
                _region(group, layer.region, size)
            for line in layer.lines:
                _line(group, line, size)
            for label in layer.labels:
                _text(group, label, size)
    return ET.tostring(svg, encoding="unicode")


def seam_picture(drawings: Sequence[PanelDrawing], size: tuple[float, float], about: str) -> str:
    """Return panels whose seams are coloured and numbered, both edges of a seam alike.

    Args:
        drawings: Panels at their places.
        size: Width and depth of the sheet in m.
        about: What is shown, for readers that do not see it.
    """
    svg = _canvas(size, about)
    low, high = np.reshape(shapely.total_bounds([one.cut for one in drawings]), (2, 2))
    (left, bottom), (right, top) = _place(np.stack([low, high]), size)
    wide, deep = right - left, bottom - top
    svg.set("viewBox", f"{left - 2:.2f} {top - 2:.2f} {wide + 4:.2f} {deep + 4:.2f}")
    fabric, printed, lines, marks = (
        ET.SubElement(svg, "g", {"class": name}) for name in ("fabric", "print", "sewn", "numbers")
    )
    radius = DISC * max(wide, deep) / 2
    for one in drawings:
        _region(fabric, one.cut, size)
        if not one.printed.is_empty:
            _region(printed, one.printed, size)
        for seam in one.seams:
            colour = seam_colour(seam.number)
            _line(lines, seam.line, size).set("style", f"stroke:{colour}")
            middle = shapely.LineString(seam.line).interpolate(0.5, normalized=True)
            x, y = _place(np.array([middle.x, middle.y]), size)
            disc = {"cx": f"{x:.2f}", "cy": f"{y:.2f}", "r": f"{radius:.2f}"}
            ET.SubElement(marks, "circle", disc).set("style", f"fill:{colour}")
            text = {"x": f"{x:.2f}", "y": f"{y:.2f}", "font-size": f"{1.2 * radius:.2f}"}
            ET.SubElement(marks, "text", text).text = str(seam.number)
        x, y = _place(np.array(one.outline.representative_point().coords[0]), size)
        name = {"class": "name", "x": f"{x:.2f}", "y": f"{y:.2f}", "font-size": f"{radius:.2f}"}
        ET.SubElement(marks, "text", name).text = one.name
    return ET.tostring(svg, encoding="unicode")


def seam_colour(number: int) -> str:
    """Return the colour of a seam by its number, as CSS has it."""
    return f"hsl({HUE * (number - 1) % 360:.0f} 75% 38%)"


def _canvas(size: tuple[float, float], about: str) -> ET.Element:
    width, height = 1e3 * size[0], 1e3 * size[1]
    box = f"-2 -2 {width + 4:.2f} {height + 4:.2f}"
    return ET.Element("svg", {"viewBox": box, "role": "img", "aria-label": about})


def _box(size: tuple[float, float]) -> dict[str, str]:
    return {"width": f"{1e3 * size[0]:.2f}", "height": f"{1e3 * size[1]:.2f}"}


def _place(points: Floats, size: tuple[float, float]) -> Floats:
    """Return points in mm, with the y axis down."""
    return np.asarray(1e3 * (points * [1, -1] + [0, size[1]]))


def _region(group: ET.Element, region: BaseGeometry, size: tuple[float, float]) -> None:
    drawn = affine_transform(region.simplify(SEEN), [1e3, 0, 0, -1e3, 0, 1e3 * size[1]])
    ET.SubElement(group, "path", d=path_data(drawn))


def _line(group: ET.Element, line: Floats, size: tuple[float, float]) -> ET.Element:
    points = " ".join(f"{x:.2f},{y:.2f}" for x, y in _place(np.asarray(line), size))
    return ET.SubElement(group, "polyline", points=points)


def _text(group: ET.Element, label: Label, size: tuple[float, float]) -> None:
    down = np.array([np.sin(label.angle), -np.cos(label.angle)]) * label.height / 2
    x, y = _place(label.place + down, size)
    turn = f"translate({x:.2f} {y:.2f}) rotate({-np.degrees(label.angle):.1f})"
    size_mm = f"{1e3 * label.height / CAPITAL:.2f}"
    ET.SubElement(group, "text", {"transform": turn, "font-size": size_mm}).text = label.text
