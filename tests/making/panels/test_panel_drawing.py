"""Panels have allowance, matching notches, numbers on both edges, and marks off the skin."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
import shapely
from helpers.panels import CLOSED, KINDS, pattern_of, striped
from mpi4py import MPI
from shapely.geometry import LineString, Polygon

from toros_fem.base.errors import PanelError, ParameterError
from toros_fem.making.panels import ManufactureOptions, PanelDrawing, panel_drawings
from toros_fem.making.print.contours import panel_outline
from toros_fem.meshes import cylinder

OPTIONS = ManufactureOptions()
ALLOWANCE = 5e-3
_KNOWN: dict[str, list[PanelDrawing]] = {}


def drawings_of(kind: str) -> list[PanelDrawing]:
    if kind not in _KNOWN:
        pattern = pattern_of(kind)
        _KNOWN[kind] = panel_drawings(pattern, striped(pattern), OPTIONS)
    return _KNOWN[kind]


@pytest.mark.parametrize("kind", CLOSED)
def test_the_cut_is_an_allowance_away(kind: str) -> None:
    for one in drawings_of(kind):
        assert one.cut.geom_type == "Polygon"
        assert one.cut.is_valid
        assert one.cut.contains(one.outline)
        distance = one.outline.distance(one.cut.boundary)
        assert distance == pytest.approx(ALLOWANCE, rel=2e-3)
        # Mitres reach at most twice as far, but for the fabric that stays in darts.
        assert one.outline.buffer(2.01 * ALLOWANCE).contains(one.cut)


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
def test_notches_are_cut_into_the_allowance(kind: str) -> None:
    """From the cut inwards by half of it; both edges of a seam have as many."""
    count = Counter[str]()
    for drawing in drawings_of(kind):
        for outer, inner in drawing.notches:
            assert drawing.cut.boundary.distance(shapely.Point(outer)) < 1e-5
            assert np.linalg.norm(inner - outer) == pytest.approx(ALLOWANCE / 2, rel=1e-6)
            assert drawing.outline.distance(shapely.Point(inner)) > 0.3 * ALLOWANCE
        count[drawing.name] += len(drawing.notches)
    assert sum(count.values()) % 2 == 0
    assert all(count[drawing.name] >= 2 * bool(drawing.seams) for drawing in drawings_of(kind))


def test_notches_are_across_from_each_other() -> None:
    """On straight edges the arc length of a notch can be measured from the drawing itself."""
    wall, base, _ = drawings_of("tube")
    left, right = np.array(wall.outline.bounds)[[0, 2]]
    middles = wall.notches.mean(axis=1)
    sides = [np.sort(middles[np.abs(middles[:, 0] - x) < ALLOWANCE, 1]) for x in (left, right)]
    assert sides[0] == pytest.approx([0.025, 0.05, 0.075, 0.09, 0.0925])  # from the far end
    assert sides[0] == pytest.approx(sides[1], abs=1e-9)
    # Along the base, from the wall's left corner, and around the cap from where the seam begins.
    seam = next(seam for seam in base.seams)
    ring = LineString(seam.line)
    around = [ring.project(shapely.Point(*notch.mean(axis=0))) for notch in base.notches]
    line = LineString(next(s.line for s in wall.seams if s.number == seam.number))
    low = middles[np.abs(middles[:, 1] + 0.75 * ALLOWANCE) < 1e-6]
    along = [line.project(shapely.Point(*place)) for place in low]
    assert len(along) == len(around)
    assert np.sort(along) == pytest.approx(np.sort(around), abs=0.5e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_stand_on_both_edges(kind: str) -> None:
    drawings = drawings_of(kind)
    names = {drawing.name: drawing for drawing in drawings}
    for drawing in drawings:
        texts = [label.text for label in drawing.labels]
        assert drawing.name in texts
        assert {"outside up", "up"} & set(texts)
        for seam in drawing.seams:
            assert texts.count(str(seam.number)) >= sum(
                s.number == seam.number for s in drawing.seams
            )
            assert seam.number in [other.number for other in names[seam.partner].seams]
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


def test_moved_drawings_keep_their_lengths() -> None:
    drawing = drawings_of("tube")[1]
    moved = drawing.moved(np.pi / 2, np.array([0.1, 0.2]))
    assert moved.cut.area == pytest.approx(drawing.cut.area, rel=1e-12)
    x, y = drawing.notches.reshape(-1, 2).T
    assert moved.notches.reshape(-1, 2) == pytest.approx(np.column_stack([0.1 - y, 0.2 + x]))
    for one, other in zip(moved.labels, drawing.labels, strict=True):
        assert np.sin(2 * (one.angle - other.angle)) == pytest.approx(0, abs=1e-9)
        assert -np.pi / 2 < one.angle < 1.6  # still upright
        assert one.height == other.height
    assert moved.footprint.area == pytest.approx(drawing.footprint.area, rel=1e-12)
    for lines in zip(moved.marks, drawing.marks, strict=True):
        sizes = [LineString(line).length for line in lines]
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)
    # Crosses stay upright: they are what is drawn at their centres.
    assert moved.footprint.contains(Polygon(moved.cut.exterior).buffer(-1e-9))


def test_without_allowance_the_cut_is_the_seam_line() -> None:
    pattern = pattern_of("finger")
    for drawing in panel_drawings(
        pattern, striped(pattern), OPTIONS.updated(seam_allowance=None, grain=None)
    ):
        assert drawing.cut.equals(drawing.outline)
        assert drawing.notches.shape == (0, 2, 2)
        assert drawing.grain == ()
        assert {label.text for label in drawing.labels} == {drawing.name, "outside up"}


def test_one_region_for_each_panel() -> None:
    with pytest.raises(PanelError, match="1 regions for 2 panels"):
        panel_drawings(pattern_of("finger"), [Polygon()])


def test_a_fully_printed_panel_is_marked_beside_its_print(alone: MPI.Comm) -> None:
    """The allowance of a cap of 20 mm has room for the shorter text only."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3)
    regions = [panel_outline(pattern, panel) for panel in range(3)]
    for drawing in panel_drawings(pattern, regions)[1:]:
        assert {"up", drawing.name} <= {label.text for label in drawing.labels}
        for label in drawing.labels:
            assert label.frame.intersection(drawing.printed).area < 1e-12


def test_wrong_kinds() -> None:
    pattern = pattern_of("finger")
    with pytest.raises(ParameterError, match="options = 5 must be"):
        panel_drawings(pattern, striped(pattern), 5)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="pattern = 'finger' must be"):
        panel_drawings("finger", [])  # type: ignore[arg-type]
