"""The drawing is true to scale, and panels keep their places."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from shapely.geometry import Point, Polygon, box

from toros_fem.making.panels.panel_drawing import write_svg
from toros_fem.meshes import cylinder

SPACE = "{http://www.w3.org/2000/svg}"


def drawn(path: Path) -> tuple[ET.Element, dict[str, dict[str, list[np.ndarray]]]]:
    """The root, and the rings of each path of each panel, in mm from the upper left corner."""
    root = ET.parse(path).getroot()
    panels = {}
    for group in root.iter(SPACE + "g"):
        panels[group.get("id", "")] = {
            path.get("class", ""): [
                np.array([[float(v) for v in pair.split(",")] for pair in ring.split("L")])
                for ring in path.get("d", "").replace("Z", "").split("M")[1:]
            ]
            for path in group.iter(SPACE + "path")
        }
    return root, panels


def test_scale_and_places(alone: MPI.Comm, tmp_path: Path) -> None:
    """A millimetre is a millimetre, y points up on the panel, and no two panels overlap."""
    folder = tmp_path
    pattern = cylinder(alone, 0.04, 0.02, 4e-3)
    outlines = [pattern.outline(k) for k in range(3)]
    regions = [Polygon()] * 3
    wall = pattern.panel_index("wall")
    regions[wall] = box(0.01, 0.03, 0.02, 0.035) - Point(0.015, 0.0325).buffer(1e-3)
    (folder / "before").write_text("whole")
    (folder / "pattern.svg").hardlink_to(folder / "before")
    write_svg(folder / "pattern.svg", pattern, regions)
    assert (folder / "before").read_text() == "whole", "a file is replaced, never half written"
    root, panels = drawn(folder / "pattern.svg")
    width, height = (float(root.get(name, "").removesuffix("mm")) for name in ("width", "height"))
    assert root.get("viewBox") == f"0 0 {width:.3f} {height:.3f}"
    assert set(panels) == {"wall", "base", "tip"}
    cuts = {name: Polygon(paths["cut"][0]) for name, paths in panels.items()}
    for name, cut in cuts.items():
        assert cut.area == pytest.approx(1e6 * outlines[pattern.panel_index(name)].area, rel=1e-5)
        assert box(0, 0, width, height).contains(cut)
        assert all(not cut.intersects(other) for at, other in cuts.items() if at != name)
    assert "print" not in panels["tip"]
    outer, hole = panels["wall"]["print"]
    assert Polygon(outer, [hole]).area == pytest.approx(1e6 * regions[wall].area, rel=1e-4)
    # 5 mm below the upper edge of a wall that is 40 mm high, 10 mm from its left edge.
    left, top, _, _ = cuts["wall"].bounds
    assert Polygon(outer).bounds[:2] == pytest.approx((left + 10, top + 5), abs=1e-3)
