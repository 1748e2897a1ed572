"""A printed tile on other meshes, as a sheet to print, and in the demo."""

import csv
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.scenes import printed_tile, shared
from mpi4py import MPI

from demos import sample as demo
from toros_fem import errors
from toros_fem.tiles.printed_tile import write_tile
from toros_fem.tiles.sheet import print_layout, region_of_triangles, resampled, sheet_of

SIZE = 0.01
STRAIN = 0.1
SMALL: dict[str, Any] = {"along": 3, "across": 1, "levels": 2, "edge_length": SIZE / 14}


def test_resampled_keeps_what_is_printed(comm: MPI.Comm) -> None:
    made = printed_tile(comm)
    same = resampled(comm, made, made.edge_length)
    assert (same.printed == made.printed).all()
    plain = [{**asdict(one), "printed": None} for one in (same, made)]
    assert plain[0] == plain[1]
    finer = resampled(comm, made, made.edge_length / 6)
    areas = [one.tile(comm).pattern.areas[one.printed].sum() for one in (made, finer)]
    assert areas[1] == pytest.approx(areas[0], rel=2e-2)
    for all_or_none in (np.ones_like, np.zeros_like):
        whole = resampled(comm, replace(made, printed=all_or_none(made.printed)), 2e-3)
        assert (whole.printed == all_or_none(whole.printed)).all()


@pytest.mark.parametrize("name", ["x", "y"])
def test_print_is_joined_across_tiles(comm: MPI.Comm, name: str) -> None:
    made = printed_tile(comm)
    mesh = made.tile(comm)
    sheet = sheet_of(mesh, name, 4, 3)
    area = mesh.pattern.areas[made.printed].sum()
    cloth, (region,) = print_layout([sheet], made.printed, 0.015)
    assert region.area == pytest.approx(12 * area, rel=1e-9)
    axis = sheet.axis
    size = np.array(made.size) * ((4, 3) if axis == 0 else (3, 4))
    size[axis] += 0.03
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(size)
    bounds = np.reshape(region.bounds, (2, 2))
    assert bounds[0, axis] == pytest.approx(0.015)
    assert bounds[1, axis] == pytest.approx(size[axis] - 0.015)
    # Wholly printed it is one rectangle: no border between tiles is left.
    _, (whole,) = print_layout([sheet], np.ones_like(made.printed), 0.015)
    assert whole.geom_type == "Polygon"
    assert len(whole.interiors) == 0
    assert len(whole.exterior.coords) == 5
    assert whole.area == pytest.approx(12 * np.prod(made.size), rel=1e-9)
    assert print_layout([sheet], np.zeros_like(made.printed), 0.0)[1][0].is_empty
    with pytest.raises(errors.ParameterError, match="margin = -0.01"):
        print_layout([sheet], made.printed, -0.01)


def test_lines_of_neighbours_are_one_piece(comm: MPI.Comm) -> None:
    made = demo.cross_lines(comm)
    mesh = made.tile(comm)
    _, (region,) = print_layout([sheet_of(mesh, "x", 3, 2)], made.printed, 0.0)
    assert len(shapely.get_parts(region)) == 1
    single = region_of_triangles(mesh.pattern.corners[made.printed])
    assert region.area == pytest.approx(6 * single.area, rel=1e-9)


def svg_area(path: Path, name: str) -> tuple[float, float]:
    """What a panel's path "print" encloses by the even-odd rule, and its "cut", in mm²."""
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


def test_demo(comm: MPI.Comm, tmp_path: Path) -> None:
    """The hand-drawn tile, both directions; then one that is read, of its own mesh."""
    folder = shared(comm, tmp_path)
    summary = demo.run(comm, folder / "drawn", **SMALL)
    comm.barrier()
    drawn = demo.cross_lines(comm)
    share = drawn.tile(comm).pattern.areas[drawn.printed].sum()
    for name in "xy":
        printed, cut = svg_area(folder / "drawn" / "pattern.svg", f"along_{name}")
        assert printed == pytest.approx(3 * 1e6 * share, rel=1e-4)
        assert cut == pytest.approx(10 * (30 + 2 * 20), rel=1e-6)
    written = json.loads((folder / "drawn" / "summary.json").read_text(encoding="utf-8"))
    assert written["directions"] == summary["directions"]
    assert written["printed_share"] == pytest.approx(share / SIZE**2)
    assert written["printed_share_simulated"] == pytest.approx(share / SIZE**2)
    assert written["triangles"] == 3 * 4 * 14**2
    assert written["inputs"]["along"] == 3
    with (folder / "drawn" / "curve.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["direction"] for row in rows] == ["x", "x", "y", "y"]
    assert [float(row["strain"]) for row in rows] == pytest.approx([0.05, 0.1] * 2)
    metrics = written["directions"]["y"]
    assert float(rows[3]["stress_n_per_m"]) == pytest.approx(STRAIN * metrics["stiffness_n_per_m"])
    for name in ("sheet_x.png", "sheet_y.png", "curve.png"):
        assert (folder / "drawn" / name).read_bytes().startswith(b"\x89PNG")
    assert "along x at 10 %" in demo.sentence(summary)

    made = printed_tile(comm)
    if comm.rank == 0:
        write_tile(folder, made)
    comm.barrier()
    inputs = {**SMALL, "edge_length": 0.0, "direction": "y", "levels": 1, "margin": 0.0}
    summary = demo.run(comm, folder / "read", tile_folder=folder, **inputs)
    assert list(summary["directions"]) == ["y"]
    assert summary["triangles"] == 3 * len(made.printed)
    assert summary["tile_m"] == made.size
    assert summary["inputs"]["tile"] == str(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"direction": "z"}, "direction = 'z' must be one of 'x', 'y', 'both'"),
        ({"strain": 0.0}, r"strain = 0.0 must be"),
        ({"levels": 0}, "levels = 0 must be a whole number, at least 1"),
        ({"along": 0}, "along = 0 must be a whole number, at least 1"),
        ({"margin": -1e-3}, "margin = -0.001"),
        ({"edge_length": -1e-3}, "edge_length = -0.001"),
        ({"edge_length": 0.009}, "edge_length = 0.009"),
        ({"edge_lenght": 0.001}, "'edge_lenght' is no parameter"),
    ],
)
def test_bad_demo_input(
    comm: MPI.Comm, tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        demo.run(comm, tmp_path / "out", **{**SMALL, **changes})
