"""Lines, prints, panels and machine files of given designs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.panels import pattern_of as shared_pattern
from helpers.panels import striped
from helpers.prints import flawed_tube, regions_of
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.design.lines.field import LineField, LineOptions
from toros_fem.design.lines.laid_lines import LaidLines, LineChange, changed
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.making.cleaning import MirroredPanels, Panels, clean, thickened
from toros_fem.making.layout import CutSheet, manufacture
from toros_fem.making.machine_files import cut_dxf, print_bodies
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import PanelDrawing, panel_drawings, printed_face
from toros_fem.making.printability import PrintLimits, printability, printed_cells
from toros_fem.meshes import cylinder, mirrored
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.sheets import disc, rectangle

pytestmark = [pytest.mark.usefixtures("kept_meshes")]
ALONE = MPI.COMM_SELF
# Made anew: other tests share those of gmsh.
pattern_of = shared_pattern.__wrapped__


def lines_of(laid: LaidLines) -> dict[str, Any]:
    """Quantities of laid lines."""
    return {
        "lines by family": [len(family.lines) for family in laid.families],
        "corners by line": [
            [len(line.points) for line in family.lines] for family in laid.families
        ],
        "places in m": np.concatenate(
            [line.points.reshape(-1) for family in laid.families for line in family.lines]
        ),
        "regions": list(laid.regions),
        "area in m2": laid.area,
        "families": [
            {
                "width in m": family.width,
                "length in m": family.length,
                "share": family.share,
                "laid share": family.laid,
                **{f"ends: {kind}": count for kind, count in sorted(family.ends.items())},
            }
            for family in laid.families
        ],
    }


def fields() -> dict[str, LineField]:
    """Fields of families: with fading shares, rays, and around a tube."""
    sheet = rectangle(ALONE, 0.06, 0.04, 2.5e-3, "unstructured")
    round_ = disc(ALONE, 0.025, 2.5e-3)
    tube = cylinder(ALONE, 0.06, 0.02, 4.5e-3)
    fading = np.clip(0.3 - 0.3 * sheet.centroids[:, 0] / 0.04, 0, 1)
    even = np.full(len(sheet.panel), 0.15)
    x, y = round_.centroids.T
    rays, near = np.arctan2(y, x), np.full((len(x), 1), 0.2)
    ones = np.ones((len(tube.panel), 2))
    return {
        "fading": LineField(
            sheet, np.stack([fading, even], 1), np.ones((len(even), 2)) * [0.4, 1.7]
        ),
        "rays": LineField(round_, near, rays[:, None]),
        "turned rays": LineField(round_, near, rays[:, None] + 0.7),
        "half turns": LineField(round_, near, rays[:, None] / 2),
        "tube": LineField(tube, ones * [0.2, 0.15], ones * [0.5, 1.4]),
    }


@pytest.mark.parametrize("name", ["fading", "rays", "turned rays", "half turns", "tube"])
def test_lines(name: str, pinned: Callable[..., None]) -> None:
    """Lines are found by solves and joined by rules: places agree to a micrometre or so."""
    laid = lay_lines(fields()[name], LineOptions(even=5e-3) if name == "fading" else None)
    figures = lines_of(laid)
    if name == "tube":
        widths = np.repeat(np.log([[1.2], [0.9]]), laid.mesh.size, axis=1)
        wider = changed(laid, LineChange(widths, np.zeros(laid.mesh.size, complex)))
        figures["other widths: area in m2"] = wider.area
    pinned(f"lines/{name}", figures, rel=1e-5, small=1e-8)


def cleaned(found: Any) -> dict[str, Any]:
    return {
        "regions": found.regions,
        "smooth contours": found.contours,
        "dropped areas in m2": sorted(piece.area for piece in found.dropped),
        "bridged areas in m2": sorted(piece.area for piece in found.bridged),
        "filled areas in m2": sorted(hole.area for hole in found.filled),
    }


def spots(points: np.ndarray) -> np.ndarray:
    """Two discs and a ring."""
    middles, radii = np.array([[4, 4], [16, 4], [16, 16]]) * 1e-3, np.array([2, 1, 3]) * 1e-3
    away = np.linalg.norm(points[:, None] - middles, axis=2) - radii
    away[:, 2] = np.abs(away[:, 2] + 1e-3) - 1e-3
    return np.asarray(0.5 - 50 * away.min(axis=1))


@pytest.mark.parametrize("island", [0.5, 4.0, 20.0])
def test_cleaning(island: float, pinned: Callable[..., None]) -> None:
    """Islands of some mm² are dropped, bridged or kept, a hole is filled."""
    pattern = square(n=80)
    limits = PrintLimits(hole_area=4e-6)
    found = clean(Panels(pattern), regions_of(pattern, spots), limits, island * 1e-6)
    pinned(f"print/cleaned_{island:g}", cleaned(found), small=1e-11)


def test_flawed_print(pinned: Callable[..., None]) -> None:
    """Flaws of each kind are found and mended, on the whole tube and on half of it."""
    tube = cylinder(ALONE, 0.06, 0.02, 2.5e-3)
    flawed = flawed_tube(tube, 60)
    half = cylinder(ALONE, 0.06, 0.02, 2.5e-3, planes=(1,))
    whole = mirrored(half, (1,))
    found = {
        "cleaned": cleaned(clean(Panels(tube), flawed)),
        "cleaned half": cleaned(clean(MirroredPanels(half, whole), flawed_tube(whole.pattern, 60))),
        "printed triangles": printed_cells(tube, flawed),
        "wider": thickened(flawed[0], shapely.box(0, 0, 0.063, 0.06), 8e-4, 6e-4, 5e-7),
    }
    judged = printability(tube, flawed)
    for name, place in (("line", judged.lines.smallest), ("gap", judged.gaps.smallest)):
        found[f"smallest {name} in m"] = place.width
        found[f"place of the smallest {name} in m"] = np.array(place.centre)
    found |= {
        "narrow lines in m": sorted(place.width for place in judged.lines.narrow),
        "narrow gaps in m": sorted(place.width for place in judged.gaps.narrow),
        "islands in m2": sorted(piece.area for piece in judged.islands),
        "holes in m2": sorted(hole.area for hole in judged.holes),
        "border in m": judged.border_length,
    }
    # Joining the mirrored half goes by rules that see rounding.
    pinned("print/flawed", found, rel=2e-5, small=1e-10)


def drawing_of(drawing: PanelDrawing, drawings: Sequence[PanelDrawing]) -> dict[str, Any]:
    sewn = defaultdict[int, list[str]](list)
    for one in drawings:
        for seam in one.seams:
            sewn[seam.number].append(one.name)

    def partner(number: int) -> str:
        one, other = sewn[number]
        return one if other == drawing.name else other

    return {
        "outline": drawing.outline,
        "cut": drawing.cut,
        "printed": drawing.printed,
        "seams": ", ".join(f"{seam.number} to {partner(seam.number)}" for seam in drawing.seams),
        "seam lines in m": np.concatenate([np.asarray(seam.line) for seam in drawing.seams]),
        "notches in m": np.asarray(drawing.notches),
        "grain in m": [np.asarray(line) for line in drawing.grain],
        "crosses in m": np.asarray(drawing.crosses),
        "labels": " / ".join(label.text for label in drawing.labels),
    }


def named(drawings: Sequence[PanelDrawing]) -> dict[str, Any]:
    return {drawing.name: drawing_of(drawing, drawings) for drawing in drawings}


@pytest.mark.parametrize("kind", ["tube", "walker"])
def test_panels(kind: str, tmp_path: Path, pinned: Callable[..., None]) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    pattern, options = pattern_of(kind), ManufactureOptions()
    stripes = striped(pattern)
    drawings = panel_drawings(pattern, stripes, options)
    pinned(f"machine_files/panels_of_{kind}", named(drawings), rel=1e-7, small=1e-10)
    moved = drawings[0].moved(Affine.turn(0.7, [0.1, 0.1]))
    (tmp_path / "cut.dxf").write_bytes(cut_dxf(CutSheet((0.45, 0.3), [moved])))
    words: dict[str, list[str]] = {}
    places: dict[str, list[np.ndarray]] = {}
    for entity in ezdxf.readfile(tmp_path / "cut.dxf").modelspace():
        layer, dxf = entity.dxf.layer, entity.dxf
        if entity.dxftype() == "TEXT":
            words.setdefault(layer, []).append(dxf.text)
            at = entity.get_placement()[1]
            place = np.array([at.x, at.y, dxf.rotation, dxf.height])
        else:
            place = np.array(entity.get_points("xy")).ravel()
        places.setdefault(layer, []).append(place)
    file = {"texts": words, "count": {layer: len(found) for layer, found in places.items()}}
    file |= {"places": {layer: np.concatenate(found) for layer, found in places.items()}}
    pinned(f"machine_files/dxf_of_{kind}", file, small=1e-6)
    bodies = print_bodies(drawings, options)
    pinned(
        f"machine_files/bodies_of_{kind}",
        {
            name: {
                "corners": len(vertices),
                "bounds in m": np.array([vertices.min(axis=0), vertices.max(axis=0)]),
                "volume in m3": _volume(vertices[triangles]),
            }
            for name, vertices, triangles in bodies
        },
        rel=1e-7,
    )
    other = ManufactureOptions(print_side="inside")
    face, regions = printed_face(pattern, stripes, other)
    figures: dict[str, Any] = {"flat in m": face.flat_points, "places in m": face.points}
    figures |= {"triangles": face.flat_triangles, "regions": regions}
    pinned(f"machine_files/inside_of_{kind}", figures, rel=1e-9)


def test_sheets(pinned: Callable[..., None]) -> None:
    """Places on beds and sheets."""
    pytest.importorskip("u_nesting")
    pattern = pattern_of("tube")
    placed = manufacture(pattern, striped(pattern))
    places = {
        place.panel: [float(place.sheet), np.degrees(place.angle), *place.offset]
        for place in placed.placements
    }
    pinned("machine_files/sheets", {"places": places}, rel=1e-6, small=1e-9)


def _volume(corners: np.ndarray) -> float:
    return float(np.linalg.det(corners).sum() / 6)


def test_stripes(pinned: Callable[..., None]) -> None:
    """A print on the outlines of each kind of panel."""
    found: dict[str, Sequence[BaseGeometry]] = {
        kind: striped(pattern_of(kind)) for kind in ("sheet", "gripper", "finger")
    }
    pinned("print/striped", found, rel=1e-9, small=1e-12)
