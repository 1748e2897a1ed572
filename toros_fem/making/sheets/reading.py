"""The print read back from the machine files, as polygons on the panels."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ManufactureFileError
from toros_fem.making.options import INSIDE
from toros_fem.making.panels.printed_face import mirrored_region
from toros_fem.making.sheets.manifest import FORMAT, NAME, VERSION
from toros_fem.making.sheets.placement import Placement
from toros_fem.meshes.pattern import Pattern

SVG = "{http://www.w3.org/2000/svg}"


def read_regions(folder: Path | str, pattern: Pattern) -> list[BaseGeometry]:
    """Return the print on each panel as the cut files show it, polygons in m (one rank).

    Each sheet is read from its SVG drawing, and moved back by the places in the manifest.

    Args:
        folder: Folder of the machine files.
        pattern: The pattern that they were made of.

    Raises:
        ManufactureFileError: A file is missing, cannot be read, or is not of this pattern.
    """
    folder = Path(folder)
    try:
        made = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if made["format"] != FORMAT or made["version"] > VERSION:
            raise ValueError("it is no manifest, or one of a newer version")
        places = {}
        for place in made["placements"]:
            angle, offset = np.radians(place["angle_deg"]), np.array(place["offset_on_sheet_mm"])
            on = Placement(place["panel"], place["sheet"], float(angle), tuple(1e-3 * offset))
            places[on.panel] = on
        drawings = {
            file["sheet"]: ET.parse(folder / file["name"]).getroot()
            for file in made["files"]
            if file["kind"] == "cut" and file["name"].endswith(".svg")
        }
        depth = {k: 1e-3 * sheet["size_mm"][1] for k, sheet in enumerate(made["sheets"], 1)}
        found = [
            places[name].region_on_panel(
                _printed(drawings[places[name].sheet], name, depth[places[name].sheet])
            )
            for name in pattern.panel_names
        ]
        inside = made["options"]["print_side"] == INSIDE
        return [mirrored_region(region) for region in found] if inside else found
    except (OSError, ValueError, KeyError, TypeError, ET.ParseError) as caught:
        raise ManufactureFileError(
            f"{folder} holds no machine files of this pattern: {type(caught).__name__}: "
            f"{caught}. Write them again by toros export."
        ) from None


def _printed(svg: ET.Element, panel: str, depth: float) -> BaseGeometry:
    """Return the print of a panel in a drawing, in m, y upwards."""
    rings = [
        np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", ring), dtype=np.float64)
        for layer in svg.iter(f"{SVG}g")
        if layer.get("id") == "print"
        for group in layer.iter(f"{SVG}g")
        if group.get("class") == panel
        for path in group.iter(f"{SVG}path")
        for ring in path.get("d", "").split("Z")
        if ring.strip()
    ]
    points = [1e-3 * ring * [1, -1] + [0, depth] for ring in rings]
    region: BaseGeometry = shapely.Polygon()
    for ring in points:  # the even-odd rule
        region = region.symmetric_difference(shapely.Polygon(ring).buffer(0))
    return region
