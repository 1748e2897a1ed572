"""The demo of a sheet of tiles: print file, pull test, files."""

import csv
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import shapely
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem.products.tiles import pulled_sheet as demo
from toros_fem.products.tiles.printed_tile import write_tile

SIZE = 0.01
STRAIN = 0.1
SMALL = demo.TileSheetConfig(along=3, across=1, strain_steps=2, edge_length=SIZE / 14)


def svg_area(path: Path, name: str) -> tuple[float, float]:
    """Return the areas inside a panel's paths "print" and "cut", even-odd rule, in mm²."""
    space = "{http://www.w3.org/2000/svg}"
    (group,) = [g for g in ET.parse(path).getroot().iter(space + "g") if g.get("id") == name]
    areas = {}
    for shape in group.iter(space + "path"):
        inside = shapely.Polygon()
        for ring in re.findall("M([^Z]*)Z", shape.get("d", "")):
            points = [[float(v) for v in pair.split(",")] for pair in ring.split(" L")]
            inside = inside.symmetric_difference(shapely.Polygon(points))
        areas[shape.get("class")] = inside.area
    return areas["print"], areas["cut"]


def test_demo(alone: MPI.Comm, tmp_path: Path) -> None:
    """The simple tile in both directions; then a tile from a file, on its own mesh."""
    summary = demo.run(alone, tmp_path / "drawn", SMALL)
    drawn = demo.cross_tile(alone)
    share = drawn.tile(alone).pattern.areas[drawn.printed].sum()
    for name in "xy":
        printed, cut = svg_area(tmp_path / "drawn" / "pattern.svg", f"along_{name}")
        assert printed == pytest.approx(3 * 1e6 * share, rel=1e-4)
        assert cut == pytest.approx(10 * (30 + 2 * 20), rel=1e-6)
    written = json.loads((tmp_path / "drawn" / "summary.json").read_text(encoding="utf-8"))
    assert written["directions"] == summary["directions"]
    assert written["printed_share"] == pytest.approx(share / SIZE**2)
    assert written["printed_share_simulated"] == pytest.approx(share / SIZE**2)
    assert written["triangles"] == 3 * 4 * 14**2
    assert written["inputs"]["along"] == 3
    with (tmp_path / "drawn" / "curve.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["direction"] for row in rows] == ["x", "x", "y", "y"]
    assert [float(row["strain"]) for row in rows] == pytest.approx([0.05, 0.1] * 2)
    values = written["directions"]["y"]
    assert float(rows[3]["stress_n_per_m"]) == pytest.approx(STRAIN * values["stiffness_n_per_m"])
    for name in ("sheet_x.png", "sheet_y.png", "curve.png"):
        assert (tmp_path / "drawn" / name).read_bytes().startswith(b"\x89PNG")
    assert "along x at 10 %" in demo.sentence(summary)

    made = printed_tile(alone)
    write_tile(tmp_path, made)
    config = SMALL.updated(edge_length=None, direction="y", strain_steps=1, margin=0.0)
    summary = demo.run(alone, tmp_path / "read", config, tile=tmp_path)
    assert list(summary["directions"]) == ["y"]
    assert summary["triangles"] == 3 * len(made.printed)
    assert summary["tile_m"] == made.size
    assert summary["inputs"]["tile"] == str(tmp_path)
