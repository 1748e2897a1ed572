"""All machine files: the same places everywhere, figures that agree, and no files left over."""

import errno
import json
import os
import sys
import time
from pathlib import Path

import ezdxf
import meshio
import numpy as np
import pytest
import shapely
from helpers.machine_files import read_regions
from helpers.runs import SUMMARY, regions_of, tube
from mpi4py import MPI

from toros_fem.base.errors import FileError, OutlineError
from toros_fem.base.files import if_possible
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.sheets.write import made_as, write_manufacture
from toros_fem.meshes import Pattern
from toros_fem.meshes.sheets import rectangle

SMALL = ManufactureOptions(bed_width=0.1, bed_depth=0.19, layer_height=0.5e-3)


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
