"""Machine files: folder, sheets to cut, bodies to print."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import sys
import time
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path
from typing import Any

import ezdxf
import meshio
import numpy as np
import pytest
import shapely
from ezdxf import bbox
from ezdxf.entitydb import EntityDB
from helpers.machine_files import read_regions
from helpers.panels import pattern_of, striped
from helpers.runs import SUMMARY, regions_of, tube
from mpi4py import MPI
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError, OutlineError
from toros_fem.base.files import if_possible
from toros_fem.making.layout import CutSheet
from toros_fem.making.machine_files import (
    cut_dxf,
    cut_svg,
    made_as,
    outlines,
    print_bodies,
    print_body,
    stl_of,
    write_manufacture,
)
from toros_fem.making.marks import Label
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import panel_drawings
from toros_fem.meshes import Pattern
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.sheets import rectangle

SMALL = ManufactureOptions(bed_width=0.1, bed_depth=0.19, layer_height=0.5e-3)
SVG = "{http://www.w3.org/2000/svg}"
trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
HEIGHT, BASE = 0.4e-3, 0.3e-3
SPOTS = np.random.default_rng(3)


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    return tube()


def test_files_and_manifest_agree(pattern: Pattern, tmp_path: Path) -> None:
    regions = regions_of(pattern)
    made = write_manufacture(tmp_path, pattern, regions, SMALL, summary=SUMMARY, title="finger")
    assert json.loads((tmp_path / "manufacture.json").read_text("utf-8")) == made
    names = {file["name"] for file in made["files"]}
    assert names | {"manufacture.json", "make_it.html"} == {p.name for p in tmp_path.iterdir()}
    assert {sheet["panels"][0] for sheet in made["sheets"]} == {"wall", "base"}, "two sheets"
    area = sum(region.area for region in regions)
    assert made["print"]["print_area_mm2"] == pytest.approx(1e6 * area)
    assert made["print"]["print_volume_mm3"] == pytest.approx(1e9 * area * 0.5e-3)
    assert made["print"]["print_mass_g"] == pytest.approx(1e3 * area * 0.5e-3 * 1220)
    for kind in ("beds", "sheets", "panels"):
        assert sum(part["print_area_mm2"] for part in made[kind]) == pytest.approx(1e6 * area)
    assert sum(panel["area_mm2"] for panel in made["panels"]) == pytest.approx(
        1e6 * pattern.areas.sum()
    )
    assert [seam["panels"] for seam in made["seams"]] == [
        ["wall", "wall"],
        ["wall", "base"],
        ["wall", "tip"],
    ]
    notches = {panel["name"]: panel["notches"] for panel in made["panels"]}
    wall, base, tip = (len(seam["notches_mm"]) for seam in made["seams"])
    assert notches == {"wall": 2 * wall + base + tip, "base": base, "tip": tip}
    assert made["pressure_pa"] == 5e3
    assert made["metrics"] == {"angle_deg": 88.25}


def test_printer_and_cutter_have_the_same_places(pattern: Pattern, tmp_path: Path) -> None:
    regions = regions_of(pattern)
    made = write_manufacture(tmp_path, pattern, regions, SMALL)
    for one, other in zip(read_regions(tmp_path, pattern), regions, strict=True):
        assert one.symmetric_difference(other).area < 1e-4 * other.area
    for number in (1, 2):
        found = [place for place in made["placements"] if place["bed"] == number]
        assert {place["sheet"] for place in found} == {number}
        body = meshio.read(tmp_path / f"print_{number}.stl", file_format="stl")
        corners = body.points[body.cells_dict["triangle"]]
        upper = corners[np.all(corners[..., 2] > 0.4999, axis=1)][..., :2]
        printed = shapely.union_all(shapely.polygons(upper))
        drawn = shapely.Polygon()
        for line in ezdxf.readfile(tmp_path / f"cut_{number}.dxf").modelspace():
            if line.dxf.layer == "print":  # the even-odd rule
                drawn = drawn.symmetric_difference(shapely.Polygon(line.get_points("xy")))
        assert drawn.difference(printed).area < 1e-4 * drawn.area
        crosses = printed.difference(drawn.buffer(0.01))
        assert 0 < crosses.area < 0.1 * drawn.area


def test_a_print_on_the_inside_is_read_back_mirrored(pattern: Pattern, tmp_path: Path) -> None:
    regions = regions_of(pattern)
    write_manufacture(tmp_path, pattern, regions, SMALL.updated(print_side="inside"))
    for one, other in zip(read_regions(tmp_path, pattern), regions, strict=True):
        assert one.symmetric_difference(other).area < 1e-4 * other.area


def test_several_beds_lie_on_a_larger_sheet(pattern: Pattern, tmp_path: Path) -> None:
    wide = SMALL.updated(sheet_width=0.21, sheet_depth=0.2)
    made = write_manufacture(tmp_path, pattern, regions_of(pattern), wide)
    assert [len(made[kind]) for kind in ("beds", "sheets")] == [2, 1]
    for place in made["placements"]:
        moved = np.subtract(place["offset_on_sheet_mm"], place["offset_on_bed_mm"])
        assert moved == pytest.approx([100.0 * (place["bed"] - 1), 0.0])
    names = {file["name"] for file in made["files"]}
    assert {"print_2.3mf", "cut_1.dxf"} <= names
    assert "cut_2.dxf" not in names


def test_copies_are_placed_like_panels_of_their_own(pattern: Pattern, tmp_path: Path) -> None:
    regions = regions_of(pattern)
    made = write_manufacture(tmp_path, pattern, regions, SMALL.updated(copies=3))
    names = [place["panel"] for place in made["placements"]]
    assert names == [n + c for c in ("", " (2)", " (3)") for n in pattern.panel_names]
    area = 3 * sum(region.area for region in regions)
    assert made["print"]["print_area_mm2"] == pytest.approx(1e6 * area)
    assert len(made["seams"]) == 3
    assert sum(len(sheet["panels"]) for sheet in made["sheets"]) == 9
    for one, other in zip(read_regions(tmp_path, pattern), regions, strict=True):
        assert one.symmetric_difference(other).area < 1e-4 * other.area


def test_files_of_an_earlier_call_go(pattern: Pattern, tmp_path: Path) -> None:
    write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    (tmp_path / "cut_by_me.svg").write_text("mine")
    made = write_manufacture(tmp_path, pattern, regions_of(pattern))
    names = {file["name"] for file in made["files"]} | {"cut_by_me.svg"}
    assert names | {"manufacture.json", "make_it.html"} == {p.name for p in tmp_path.iterdir()}


def test_only_files_of_an_earlier_call_go(pattern: Pattern, tmp_path: Path) -> None:
    """A slicer's file stays; a second sheet that the new skin does not have goes."""
    write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    own = {"print_1.gcode", "print_2024.pdf", "cut_photo3.jpg", "cut_9.svg"}
    for name in own:
        (tmp_path / name).write_text("mine")
    flat = rectangle(MPI.COMM_SELF, 0.05, 0.05, 0.01, "left")
    made = write_manufacture(tmp_path, flat, [flat.outline(0).buffer(-0.01)])
    names = {file["name"] for file in made["files"]}
    assert "cut_2.svg" not in names
    kept = names | own | {"manufacture.json", "make_it.html"}
    assert kept == {p.name for p in tmp_path.iterdir()}
    assert {(tmp_path / name).read_text() for name in own} == {"mine"}


@pytest.mark.parametrize("name", ["cut_1.svg", "make_it.html", "manufacture.json", "notes.txt"])
def test_a_file_of_somebody_else_is_never_overwritten(
    name: str, pattern: Pattern, tmp_path: Path
) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(FileError, match=name):
        write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL, others=["notes.txt"])
    assert [p.name for p in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_a_file_that_was_changed_is_its_owners(pattern: Pattern, tmp_path: Path) -> None:
    """It bars the way of a new one of its name, and stays where the new skin has none."""
    write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    (tmp_path / "cut_2.svg").write_text("mine")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(FileError, match=r"has cut_2\.svg, which"):
        write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    made = write_manufacture(tmp_path, pattern, regions_of(pattern))
    names = {file["name"] for file in made["files"]} | {"manufacture.json", "make_it.html"}
    assert {p.name for p in tmp_path.iterdir()} == names | {"cut_2.svg"}
    assert (tmp_path / "cut_2.svg").read_text() == "mine"


def test_a_call_that_was_cut_short_is_made_good(
    pattern: Pattern, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its files are known to be the package's own."""
    swapped: list[str] = []
    swap = Path.replace

    def killed(path: Path, to: Path) -> Path:
        if len(swapped) == 4:
            raise KeyboardInterrupt
        swapped.append(to.name)
        return swap(path, to)

    write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            write_manufacture(tmp_path, pattern, regions_of(pattern))
    assert swapped[0] == "manufacture.next.json"
    made = write_manufacture(tmp_path, pattern, regions_of(pattern))
    names = {file["name"] for file in made["files"]} | {"manufacture.json", "make_it.html"}
    assert {p.name for p in tmp_path.iterdir()} == names


def test_a_full_disk_leaves_the_files_of_an_earlier_call(
    pattern: Pattern, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    flushed: list[int] = []
    flush = os.fsync

    def full(file: int) -> None:
        flushed.append(file)
        if len(flushed) > 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        flush(file)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            write_manufacture(tmp_path, pattern, regions_of(pattern))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_equal_skins_have_equal_files(pattern: Pattern, tmp_path: Path) -> None:
    """Files hold neither a time nor random identifiers."""
    contents = []
    for k in range(2):
        write_manufacture(tmp_path, pattern, regions_of(pattern), SMALL, title="finger")
        contents.append({p.name: p.read_bytes() for p in tmp_path.iterdir()})
        if k == 0:
            time.sleep(1.1)
    assert contents[0] == contents[1]


def test_a_print_is_as_thick_as_it_was_designed() -> None:
    assert made_as({"inputs": {"thickness": 0.7e-3}}).layer_height == 0.7e-3
    thicker = {"thickness": 0.7e-3, "reinforcement_thickness": 0.8e-3}
    assert made_as({"inputs": thicker}).layer_height == 0.8e-3
    laid = {**thicker, "print_height": 0.5e-3}
    assert made_as({"inputs": laid}).layer_height == 0.5e-3, "of the layer, not of the laminate"
    assert made_as({"inputs": {"print_side": "inside"}}).print_side == "inside"
    assert made_as({"inputs": {"print_side": None}}) == ManufactureOptions()
    assert made_as(None) == made_as({}) == ManufactureOptions()


def test_wales_of_a_knit_lie_along_the_sheet(pattern: Pattern, tmp_path: Path) -> None:
    knit = {"inputs": {"knit_ratio": 2.0, "grain_angle": 90.0}}
    options = made_as(knit).updated(bed_width=0.2, bed_depth=0.2)
    assert made_as({"inputs": {**knit["inputs"], "knit_ratio": None}}).grain == 90
    made = write_manufacture(tmp_path, pattern, regions_of(pattern), options)
    assert {place["angle_deg"] % 180 for place in made["placements"]} == {90.0}


def test_what_cannot_be_made_is_said_in_a_line(
    pattern: Pattern,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def write(options: ManufactureOptions) -> None:
        write_manufacture(tmp_path, pattern, regions_of(pattern), options)

    narrow = SMALL.updated(bed_width=0.05)
    with pytest.raises(OutlineError, match="'wall'"):
        write(narrow)
    if_possible("machine files", lambda: write(narrow))
    assert "no machine files: panel 'wall'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "u_nesting", None)
    if_possible("machine files", lambda: write(SMALL))
    assert "pip install '.[manufacture]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def full() -> CutSheet:
    pattern = pattern_of("finger")
    drawing = panel_drawings(pattern, striped(pattern))[0]
    left, low, right, high = drawing.footprint.bounds
    return CutSheet((right - left, high - low), [drawing.moved(Affine.shift([-left, -low]))])


def test_a_full_sheet_has_its_ruler_below(full: CutSheet) -> None:
    size, root = full.size, ET.fromstring(cut_svg(full))
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    heights = re.findall(r",(-?[\d.]+)", ruler.findall(f"{SVG}path")[0].get("d", ""))
    assert all(1e3 * size[1] < float(y) < height for y in heights)
    assert heights


def test_equal_cuts_have_equal_bytes(full: CutSheet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where sets have another order, as in each process."""
    made, kinds = [], EntityDB.dxf_types_in_use
    for turned in (False, True):
        order = partial(sorted, reverse=turned)
        monkeypatch.setattr(EntityDB, "dxf_types_in_use", lambda of, to=order: to(kinds(of)))
        made.append(cut_dxf(full))
    assert made[0] == made[1]


@pytest.mark.parametrize("version", ["R12", "R2010"])
@pytest.mark.parametrize("letters", ["text", "outlines"])
def test_versions_letters_and_extents_of_dxf(full: CutSheet, version: str, letters: str) -> None:
    """R12 knows no light polylines; the extents are those of all lines."""
    written = cut_dxf(full, ManufactureOptions(dxf_version=version, letters=letters)).decode()
    document = ezdxf.read(io.StringIO(written))
    assert not document.audit().errors
    kinds = {entity.dxftype() for entity in document.modelspace()}
    lines = "POLYLINE" if version == "R12" else "LWPOLYLINE"
    assert kinds == ({lines, "TEXT"} if letters == "text" else {lines})
    seen = bbox.extents(document.modelspace())
    assert np.allclose(document.header["$EXTMIN"], seen.extmin)
    assert np.allclose(document.header["$EXTMAX"], seen.extmax)
    layers = {entity.dxf.layer for entity in document.modelspace()}
    assert layers == {"print", "seam", "marks", "labels", "cut"}


def test_outlines_in_svg(full: CutSheet) -> None:
    """No text is left, and the lettering is where the text was."""
    root = ET.fromstring(cut_svg(full, ManufactureOptions(letters="outlines")))
    assert not list(root.iter(f"{SVG}text"))
    assert list(ET.fromstring(cut_svg(full)).iter(f"{SVG}text"))


def test_letters_have_the_place_and_height_of_their_label() -> None:
    for turn in (0.0, np.pi / 2):
        (ring, *_) = outlines(Label("H", np.array([0.1, 0.2]), turn, 4e-3))
        wide, high = np.ptp(ring, axis=0)[:: 1 if turn == 0 else -1]
        assert high == pytest.approx(4e-3, rel=5e-3)
        assert 2e-3 < wide < 4e-3
        assert (ring.min(axis=0) + ring.max(axis=0)) / 2 == pytest.approx([0.1, 0.2], abs=5e-5)


def random_spots(count: int) -> BaseGeometry:
    places, radii = SPOTS.uniform(0, 0.1, (count, 2)), SPOTS.uniform(1e-3, 4e-3, count)
    spots = [Point(*place).buffer(radius, 8) for place, radius in zip(places, radii, strict=True)]
    return shapely.union_all(spots)


FRAME = box(0, 0, 0.1, 0.05).difference(box(0.02, 0.02, 0.04, 0.03))
REGIONS = {
    "a square": box(0, 0, 0.01, 0.01),
    "holes": FRAME.difference(Point(0.07, 0.025).buffer(0.01)),
    "holes that touch at a point": FRAME.difference(box(0.04, 0.03, 0.05, 0.04)),
    "a hole that touches the border": FRAME.difference(
        Polygon([(0.06, 0.0), (0.065, 0.01), (0.055, 0.01)])
    ),
    "parts that touch at a point": shapely.union_all([FRAME, box(0.1, 0.05, 0.12, 0.06)]),
    "a corner on an edge": shapely.union_all(
        [FRAME, Polygon([(0.1, 0.025), (0.12, 0.02), (0.12, 0.04)])]
    ),
    "an island in a hole": shapely.union_all([FRAME, box(0.025, 0.022, 0.035, 0.028)]),
    "200 spots": random_spots(200),
}


def checked(mesh: Any) -> None:
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0  # outward
    # Each edge belongs to two faces: no two bodies share one.
    assert (np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("name", REGIONS)
def test_bodies_are_watertight_and_of_the_right_volume(name: str, tmp_path: Path) -> None:
    region = REGIONS[name]
    body = print_body(region, HEIGHT, BASE)
    (tmp_path / "body.stl").write_bytes(stl_of([("body", *body)]))
    mesh = trimesh.load_mesh(tmp_path / "body.stl")  # single precision, corners found by place
    checked(mesh)
    assert mesh.volume == pytest.approx(1e9 * region.area * HEIGHT, rel=1e-3)
    low, high = mesh.bounds
    assert (low[2], high[2]) == pytest.approx((1e3 * BASE, 1e3 * (BASE + HEIGHT)), abs=1e-6)
    assert (low[0], low[1], high[0], high[1]) == pytest.approx(
        np.array(region.bounds) * 1e3, abs=2e-3
    )
    number = len(shapely.get_parts(region))
    assert mesh.body_count == number


def test_panels_without_print_have_no_body() -> None:
    pattern = pattern_of("finger")
    regions = striped(pattern)
    drawings = panel_drawings(pattern, [regions[0], Polygon()])
    names = [name for name, *_ in print_bodies(drawings)]
    assert names == ["top", "top registration"]
