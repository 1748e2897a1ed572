"""Panels have allowance, matching notches, numbers on both edges, and marks off the skin."""

from collections.abc import Sequence
from itertools import batched, combinations

import numpy as np
import pytest
import shapely
from helpers.panels import KINDS, pattern_of, striped
from mpi4py import MPI
from shapely.geometry import LineString

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.marks import sewn_seams
from toros_fem.making.panels.panel_drawing import PanelDrawing, panel_drawings, printed_face
from toros_fem.meshes import cylinder

OPTIONS = ManufactureOptions()
INSIDE = ManufactureOptions(print_side="inside", grain=60.0)
ALLOWANCE = 5e-3
_KNOWN: dict[str, list[PanelDrawing]] = {}


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
