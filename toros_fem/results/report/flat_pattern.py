"""The flat pattern of a run in a page, with its scale."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

SVG = "{http://www.w3.org/2000/svg}"


def flat_pattern(path: Path) -> str:
    """Return the drawing in pattern.svg with its print above the fabric, and a bar of 10 mm.

    It keeps its size in mm, so that it is true to scale where the browser shows millimetres; "" if
    there is no drawing. Names of panels are no ids, which the page has of its own.
    """
    try:
        drawing = ET.parse(path).getroot()
    except (OSError, ET.ParseError):
        return ""
    for group in drawing.iter(f"{SVG}g"):
        # The border is filled in the page, and so it comes first.
        group[:] = sorted(group, key=lambda part: part.get("class") == "print")
    for part in drawing.iter():
        part.tag = part.tag.removeprefix(SVG)
        for name in ("id", "fill", "stroke", "stroke-width"):
            part.attrib.pop(name, None)
    _, _, width, height = (float(value) for value in drawing.get("viewBox", "").split())
    added = 8.0
    drawing.set("viewBox", f"0 0 {width:.3f} {height + added:.3f}")
    drawing.set("width", f"{width:.3f}mm")
    drawing.set("height", f"{height + added:.3f}mm")
    bar = ET.SubElement(drawing, "g", {"class": "bar"})
    ET.SubElement(bar, "path", d=f"M5,{height + 1.5} v2 h10 v-2")
    label = ET.SubElement(bar, "text", x="16.5", y=f"{height + 4.2}")
    label.text = "10 mm"
    return ET.tostring(drawing, encoding="unicode")
