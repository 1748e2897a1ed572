"""Panels have allowance, matching notches, numbers on both edges, and marks off the skin."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import batched, combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.panels import KINDS, pattern_of, striped
from mpi4py import MPI
from shapely.geometry import LineString, Point, Polygon, box

from toros_fem.making.marks import sewn_seams
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import (
    PanelDrawing,
    cut_outline,
    panel_drawings,
    printed_face,
    write_svg,
)
from toros_fem.meshes import cylinder

OPTIONS = ManufactureOptions()
INSIDE = ManufactureOptions(print_side="inside", grain=60.0)
ALLOWANCE = 5e-3
_KNOWN: dict[str, list[PanelDrawing]] = {}
MM = 1e-3
CORNERS = np.array([[0, 0], [100, 0], [100, 50], [0, 50], [0, 0]]) * MM
SQUARE = Polygon(CORNERS)
SPACE = "{http://www.w3.org/2000/svg}"


def drawings_of(kind: str) -> list[PanelDrawing]:
    if kind not in _KNOWN:
        pattern = pattern_of(kind)
        _KNOWN[kind] = panel_drawings(pattern, striped(pattern), OPTIONS)
    return _KNOWN[kind]


def test_free_edges_have_none_unless_wanted() -> None:
    pattern = pattern_of("open tube")
    wall = drawings_of("open tube")[0]
    low, high = wall.outline.bounds[1], wall.outline.bounds[3]
    assert wall.cut.bounds[1] == pytest.approx(low - ALLOWANCE, abs=1e-6)
    assert wall.cut.bounds[3] == pytest.approx(high, abs=1e-5)
    around = OPTIONS.updated(allowance_at="all")
    whole = panel_drawings(pattern, striped(pattern), around)[0]
    assert whole.cut.bounds[3] == pytest.approx(high + ALLOWANCE, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_stand_on_both_edges(kind: str) -> None:
    drawings = drawings_of(kind)
    every = [seam.number for drawing in drawings for seam in drawing.seams]
    for drawing in drawings:
        texts = [label.text for label in drawing.labels]
        assert drawing.name in texts
        assert {"outside up", "up"} & set(texts)
        for seam in drawing.seams:
            assert texts.count(str(seam.number)) >= sum(
                s.number == seam.number for s in drawing.seams
            )
            assert every.count(seam.number) == 2
            nearest = min(
                LineString(seam.line).distance(shapely.Point(label.place))
                for label in drawing.labels
                if label.text == str(seam.number)
            )
            assert nearest == pytest.approx(ALLOWANCE / 2, rel=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_texts_and_marks_leave_the_skin_alone(kind: str) -> None:
    for drawing in drawings_of(kind):
        frames = [label.frame for label in drawing.labels]
        for one, other in combinations(frames, 2):
            assert one.intersection(other).area < 1e-12
        for label in drawing.labels:
            assert label.frame.intersection(drawing.printed).area < 1e-12
            assert label.height >= 1.5e-3
            assert drawing.cut.buffer(1e-9).contains(label.frame)
            # Upright from below or from the right.
            assert -np.pi / 2 < label.angle < 1.6
        assert drawing.crosses.shape == (3, 2)
        half = drawing.cross_size / 2
        for centre in drawing.crosses:
            square = shapely.box(*(centre - half), *(centre + half))
            assert square.intersection(drawing.outline).area == 0
            assert drawing.cut.contains(square) or not drawing.cut.intersects(square)
        shaft, head = drawing.grain
        assert np.linalg.norm(shaft[1] - shaft[0]) >= 5e-3 - 1e-12
        assert shaft[1] - shaft[0] == pytest.approx([0, shaft[1, 1] - shaft[0, 1]], abs=1e-12)
        assert shaft[1] == pytest.approx(head[1])
        if kind != "sheet":  # its stripes leave no room for an arrow
            assert not any(frame.intersects(LineString(shaft)) for frame in frames)
            assert not drawing.printed.intersects(LineString(shaft))


def test_without_allowance_the_cut_is_the_seam_line() -> None:
    pattern = pattern_of("finger")
    for drawing in panel_drawings(
        pattern, striped(pattern), OPTIONS.updated(seam_allowance=None, grain=None)
    ):
        assert drawing.cut.equals(drawing.outline)
        assert drawing.notches.shape == (0, 2, 2)
        assert drawing.grain == ()
        assert {label.text for label in drawing.labels} == {drawing.name, "outside up"}


def test_a_fully_printed_panel_is_marked_beside_its_print(alone: MPI.Comm) -> None:
    """The allowance of a cap of 20 mm has room for the shorter text only."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3)
    regions = [pattern.outline(panel) for panel in range(3)]
    for drawing in panel_drawings(pattern, regions)[1:]:
        assert {"up", drawing.name} <= {label.text for label in drawing.labels}
        for label in drawing.labels:
            assert label.frame.intersection(drawing.printed).area < 1e-12


def mirrored(shape: shapely.Geometry) -> shapely.Geometry:
    return shapely.transform(shape, lambda points: points * [-1, 1])


@pytest.mark.parametrize("kind", ["tube", "finger", "sphere"])
def test_an_inside_print_is_mirrored(kind: str) -> None:
    """Print, cut and notches are mirrored; texts are not, and the same panels are sewn together."""

    def sewn(drawings: Sequence[PanelDrawing]) -> list[list[str]]:
        edges = sorted((seam.number, one.name) for one in drawings for seam in one.seams)
        return sorted(sorted([one, other]) for (_, one), (_, other) in batched(edges, 2))

    pattern = pattern_of(kind)
    regions = striped(pattern)
    outside = panel_drawings(pattern, regions)
    inside = panel_drawings(*printed_face(pattern, regions, INSIDE), INSIDE)
    assert sewn(inside) == sewn(outside)
    for one, other in zip(outside, inside, strict=True):
        assert mirrored(one.printed).symmetric_difference(other.printed).area < 1e-12
        assert mirrored(one.cut).symmetric_difference(other.cut).area < 1e-9
        assert "inside up" in [label.text for label in other.labels]
        shaft = other.grain[0][1] - other.grain[0][0]
        assert np.degrees(np.arctan2(shaft[1], shaft[0])) == pytest.approx(120.0)
    lengths = [
        sorted(seam.length for seam in sewn_seams(each))
        for each in (pattern, printed_face(pattern, regions, INSIDE)[0])
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)


@pytest.mark.parametrize(
    ("lines", "bounds", "area"),
    [
        ([CORNERS[:2]], (0, -5, 100, 50), 100 * 5),
        ([CORNERS[:2], CORNERS[2:4]], (0, -5, 100, 55), 2 * 100 * 5),
        ([CORNERS[:3]], (0, -5, 105, 50), 100 * 5 + 50 * 5 + 25),
        ([], (0, 0, 100, 50), 0),
    ],
)
def test_only_along_seams(lines: list[np.ndarray], bounds: tuple, area: float) -> None:
    """Two seams that meet share a mitred corner; at its ends an allowance is cut off square."""
    cut = cut_outline(SQUARE, lines, 5 * MM)
    assert np.array(cut.bounds) / MM == pytest.approx(bounds, abs=1e-5)
    assert (cut.area - SQUARE.area) / MM**2 == pytest.approx(area, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("degrees", [20, 45, 70, 110, 160])
def test_corners_are_mitred_and_sharp_ones_cut_off(degrees: float) -> None:
    half = np.radians(degrees) / 2
    tip = np.array([[0, 0], [-np.cos(half), np.sin(half)], [-np.cos(half), -np.sin(half)]]) * 0.1
    wedge = Polygon(tip)
    cut = cut_outline(wedge, [np.append(tip, tip[:1], axis=0)], 5 * MM)
    reach = max(x for x, _ in cut.exterior.coords)
    mitre = 5 * MM / np.sin(half)
    assert reach == pytest.approx(min(mitre, 10 * MM), rel=0.02)


@pytest.mark.parametrize("angle", [30, 60, 120, 150])
def test_no_allowance_beyond_a_free_edge(angle: float) -> None:
    """An edge with an allowance meets a free one at any angle."""
    slope = 0.1 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    corners = np.array([[0, 0], [0.2, 0], [0.2, 0] + slope * [-1, 1], slope, [0, 0]])
    panel = Polygon(corners)
    cut = cut_outline(panel, [corners[:2]], 5 * MM)
    assert cut.geom_type == "Polygon"
    assert cut.area == pytest.approx(panel.area + 0.2 * 5 * MM, rel=1e-4)
    assert cut.bounds[1] == pytest.approx(-5 * MM, abs=1e-8)


def test_a_slit_keeps_its_fabric() -> None:
    """Both sides of a slit that ends inside of a panel are sewn together: a dart."""
    slit = np.array([[48, 0], [50, 30], [52, 0]]) * MM
    panel = SQUARE.difference(Polygon(slit))
    cut = cut_outline(panel, [slit], 5 * MM)
    assert not cut.interiors
    assert cut.contains(Polygon(slit).buffer(-1e-6))


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
