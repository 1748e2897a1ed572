"""The print read back from the cut files, as polygons on the panels."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.making.manifest import NAME
from toros_fem.making.options import INSIDE
from toros_fem.meshes import Pattern
from toros_fem.meshes.panels import Affine

SVG = "{http://www.w3.org/2000/svg}"


def read_regions(folder: Path, pattern: Pattern) -> list[BaseGeometry]:
    """The print on each panel as the cut files show it, in m, moved back by the manifest."""
    made = json.loads((folder / NAME).read_text(encoding="utf-8"))
    drawings = {
        file["sheet"]: ET.parse(folder / file["name"]).getroot()
        for file in made["files"]
        if file["kind"] == "cut" and file["name"].endswith(".svg")
    }
    found = {}
    for place in made["placements"]:
        number, offset = place["sheet"], 1e-3 * np.array(place["offset_on_sheet_mm"])
        depth = 1e-3 * made["sheets"][number - 1]["size_mm"][1]
        to_sheet = Affine.turn(np.radians(place["angle_deg"]), offset)
        printed = drawn_print(drawings[number], place["panel"], depth)
        found[place["panel"]] = to_sheet.inverse.region(printed)
    regions = [found[name] for name in pattern.panel_names]
    inside = made["options"]["print_side"] == INSIDE
    return [Affine.mirror().region(region) for region in regions] if inside else regions


def drawn_print(svg: ET.Element, panel: str, depth: float) -> BaseGeometry:
    """The print of a panel in the drawing of a sheet, in m, y upwards."""
    region: BaseGeometry = shapely.Polygon()
    for layer in svg.findall(f"{SVG}g[@id='print']"):
        for path in layer.findall(f"{SVG}g[@class='{panel}']/{SVG}path"):
            for ring in filter(str.strip, path.get("d", "").split("Z")):
                pairs = re.findall(r"(-?[\d.]+),(-?[\d.]+)", ring)
                points = 1e-3 * np.array(pairs, dtype=np.float64) * [1, -1] + [0, depth]
                # The even-odd rule.
                region = region.symmetric_difference(shapely.Polygon(points).buffer(0))
    return region
