"""What every mesh, sheet and print keeps to, on drawn ones of each kind."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.outlines import volume
from helpers.scenes import square
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

from toros_fem.base.errors import OutlineError
from toros_fem.making.cleaning import Panels, clean
from toros_fem.making.layout import nest
from toros_fem.making.panel_drawing import cut_outline
from toros_fem.making.printability import DEFAULT_LIMITS, printability
from toros_fem.meshes import (
    Pattern,
    cylinder,
    disc,
    finger,
    gripper,
    mirrored,
    rectangle,
    rounded,
    tile,
    two_panels,
    walker,
)
from toros_fem.meshes.sheets import KINDS
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import flat_areas

ALONE = MPI.COMM_SELF
FEW = settings(
    max_examples=8, derandomize=True, deadline=None, database=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
EDGES = st.floats(2.5e-3, 8e-3)


@dataclass(frozen=True)
class Made:
    """A pattern, and what is known of it.

    Attributes:
        pattern: The pattern.
        area: Its flat area in m²; None where only its maker knows it.
        euler: Vertices less edges plus triangles.
        border: Length of its free border in m; None as for the area.
        planes: Planes through the origin that cut it.
        isometric: Whether flat and assembled edges are equally long.
    """

    pattern: Pattern = field(repr=False)
    area: float | None
    euler: int
    border: float | None = 0.0
    planes: tuple[int, ...] = ()
    isometric: bool = True


@st.composite
def rectangles(draw: st.DrawFn) -> Made:
    a, b = draw(st.tuples(*[st.floats(0.01, 0.05)] * 2))
    made = rectangle(
        ALONE, a, b, draw(st.floats(0.1, 0.4)) * min(a, b), draw(st.sampled_from(KINDS))
    )
    return Made(made, a * b, 1, 2 * (a + b))


@st.composite
def discs(draw: st.DrawFn) -> Made:
    radius, kind = (
        draw(st.floats(0.01, 0.05)),
        draw(st.sampled_from(["structured", "unstructured"])),
    )
    edge = radius * draw(st.floats(0.15, 0.4))
    sides = round(2 * np.pi * radius / edge)
    chord = 2 * radius * np.sin(np.pi / sides)
    area = sides / 2 * chord * radius * np.cos(np.pi / sides)
    return Made(disc(ALONE, radius, edge, kind), area, 1, sides * chord)


@st.composite
def cylinders(draw: st.DrawFn) -> Made:
    """Tubes with both caps, one or none, and what one or two planes leave of them."""
    planes = draw(st.sampled_from([(), (1,), (0, 1)]))
    caps = draw(st.sampled_from(["both", "base", "tip", None]))
    mesh = draw(st.sampled_from(["structured", "left", "union-jack", "crossed", "unstructured"]))
    length, radius = draw(st.floats(0.02, 0.06)), draw(st.floats(8e-3, 15e-3))
    made = cylinder(ALONE, length, 2 * radius, draw(EDGES), mesh=mesh, caps=caps, planes=planes)
    parts, ends = 2 ** len(planes), {"both": 2, None: 0}.get(caps, 1)
    rim = made.points[made.points[:, 2] < 1e-9]
    on_rim = np.isclose(np.hypot(*rim[:, :2].T), radius).sum()
    sides = parts * (on_rim - (1 if planes else 0))
    chord = 2 * radius * np.sin(np.pi / sides)
    cap = sides / 2 * chord * radius * np.cos(np.pi / sides)
    area = (sides * chord * length + ends * cap) / parts
    # The cut of a part runs along the wall and across the caps.
    border = (2 - ends) * sides * chord / parts
    if planes:
        border += 2 * length + 2 * ends * radius
    euler = 1 if planes else ends
    return Made(
        made, area, euler, border, planes, isometric=mesh in ("structured", "left", "union-jack")
    )


@st.composite
def tori(draw: st.DrawFn) -> Made:
    a, b = draw(st.tuples(*[st.floats(0.01, 0.03)] * 2))
    mesh = draw(st.sampled_from(["right", "crossed", "union-jack", "unstructured"]))
    found = tile(ALONE, (a, b), draw(st.floats(0.12, 0.24)) * min(a, b), mesh)
    return Made(found.pattern, a * b, 0, isometric=False)


@st.composite
def pillows(draw: st.DrawFn) -> Made:
    """Two panels of a drawn outline with round corners."""
    count = draw(st.integers(3, 6))
    radii = np.array(draw(st.lists(st.floats(0.02, 0.04), min_size=count, max_size=count)))
    angle = 2 * np.pi * (np.arange(count) + 0.3) / count
    corners = np.stack([radii * np.cos(angle), radii * np.sin(angle)], axis=1)
    try:
        outline = rounded(corners, 3e-3)
        made = two_panels(ALONE, outline, draw(st.floats(3e-3, 6e-3)))
    except OutlineError:  # a corner is too sharp for its radius, or the mesh too coarse for a side
        assume(False)
    return Made(made, None, 2, isometric=False)


@st.composite
def robots(draw: st.DrawFn) -> Made:
    make: Any = draw(st.sampled_from([walker, gripper, finger]))
    planes = draw(st.sampled_from([(), (1,), (0, 1)] if make is walker else [(), (1,)]))
    made = make(ALONE, draw(st.floats(6e-3, 9e-3)), planes=planes)
    return Made(made, None, 1 if planes else 2, None if planes else 0.0, planes, isometric=False)


MAKERS: dict[str, st.SearchStrategy[Made]] = {
    "rectangle": rectangles(), "disc": discs(), "cylinder": cylinders(), "tile": tori(),
    "pillow": pillows(), "robot": robots(),
}  # fmt: skip


def euler(pattern: Pattern) -> int:
    return len(pattern.points) - len(pattern.edges.ends) + len(pattern.panel)


def lengths(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points[:, 1] - points[:, 0], axis=1))


@pytest.mark.parametrize("name", MAKERS)
@FEW
@given(data=st.data())
def test_meshes(name: str, data: st.DataObject) -> None:
    """Size, shape and orientation; seams that are equally long; no vertex left over."""
    made = data.draw(MAKERS[name])
    pattern = made.pattern
    assert flat_areas(pattern.corners).min() > 0, "counter-clockwise"
    assert pattern.areas == pytest.approx(flat_areas(pattern.corners), rel=1e-12)
    if made.area is not None:
        assert pattern.areas.sum() == pytest.approx(made.area, rel=1e-9)
    assert euler(pattern) == made.euler
    assert np.array_equal(np.unique(pattern.triangles), np.arange(len(pattern.points)))
    assert len(np.unique(np.sort(pattern.triangles, axis=1), axis=0)) == len(pattern.triangles)
    if made.border is not None:
        border = lengths(pattern.points[pattern.free_edges]).sum()
        assert border == pytest.approx(made.border, rel=1e-9, abs=1e-15)
    if made.euler == 2:
        assert volume(pattern) > 0, "normals point outwards"
    if len(pattern.seams):
        one, other = (lengths(pattern.flat_points[pattern.seams[:, k]]) for k in (0, 1))
        assert one == pytest.approx(other, rel=1e-9 if made.isometric else 1e-3)
    if made.isometric:
        for k in range(3):
            flat = pattern.corners[:, k] - pattern.corners[:, k - 1]
            there = pattern.points[pattern.triangles[:, k]]
            there = there - pattern.points[pattern.triangles[:, k - 1]]
            same = np.linalg.norm(flat, axis=1)
            assert np.linalg.norm(there, axis=1) == pytest.approx(same, rel=1e-9)


@pytest.mark.parametrize("name", sorted(set(MAKERS) - {"tile"}))  # tori are made anew
@FEW
@given(data=st.data())
def test_refined(name: str, data: st.DataObject) -> None:
    """Four quarters in each triangle; the mean over them is what was there."""
    made = data.draw(MAKERS[name])
    pattern, found = made.pattern, refine(made.pattern)
    fine = found.pattern
    assert fine.panel_names == pattern.panel_names
    assert np.array_equal(fine.panel, pattern.panel[found.cell])
    assert np.array_equal(np.bincount(found.cell), np.full(len(pattern.panel), 4))
    assert fine.areas == pytest.approx(pattern.areas[found.cell] / 4, rel=1e-9)
    assert len(fine.seams) == 2 * len(pattern.seams)
    assert len(fine.free_edges) == 2 * len(pattern.free_edges)
    assert euler(fine) == made.euler
    assert found.at_vertices(pattern.points) == pytest.approx(fine.points, abs=1e-17)
    old = found.ends[:, 0] == found.ends[:, 1]
    values = np.random.default_rng(0).normal(size=len(pattern.points))
    assert np.array_equal(found.at_vertices(values)[old], values)
    middle = np.zeros_like(pattern.centroids)
    np.add.at(middle, found.cell, fine.centroids / 4)
    assert middle == pytest.approx(pattern.centroids, abs=1e-15)


@FEW
@given(data=st.data())
def test_mirrored(data: st.DataObject) -> None:
    """A part and its images: nothing is lost, and a second time the same is found."""
    made = data.draw(cylinders() | robots())
    assume(made.planes)
    part, count = made.pattern, 2 ** len(made.planes)
    for axis in made.planes:
        assert part.points[:, axis].min() == 0, "the cut is exactly in its plane"
    images = mirrored(part, made.planes)
    whole = images.pattern
    assert len(whole.panel) == count * len(part.panel)
    assert np.array_equal(np.bincount(images.cell), np.full(len(part.panel), count))
    assert whole.areas == pytest.approx(part.areas[images.cell], rel=1e-12)
    assert volume(whole) == pytest.approx(count * volume(part), rel=1e-9)
    assert images.at_vertices(part.points) == pytest.approx(whole.points, abs=1e-17)
    flip = np.ones(3)
    flip[list(made.planes)] = -1
    for axis in made.planes:
        turned = whole.points * np.where(np.arange(3) == axis, -1.0, 1.0)
        order, same = (np.lexsort(np.round(p, 9).T) for p in (turned, whole.points))
        assert turned[order] == pytest.approx(whole.points[same], abs=1e-9)
    steps = part
    for axis in made.planes:
        steps = mirrored(steps, (axis,)).pattern
    assert steps.areas.sum() == pytest.approx(whole.areas.sum(), rel=1e-12)
    assert len(steps.points) == len(whole.points)


# ------------------------------------------------------------------------- panels and prints


@st.composite
def blobs(draw: st.DrawFn) -> shapely.Polygon:
    """A panel with a wavy border, some centimetres wide."""
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    size, phase = draw(st.floats(0.02, 0.04)), draw(st.floats(0, 6))
    radius = size * (1 + draw(st.floats(0, 0.3)) * np.cos(draw(st.integers(1, 4)) * turn + phase))
    return shapely.Polygon(np.column_stack([radius * np.cos(turn), 0.6 * radius * np.sin(turn)]))


@settings(FEW, max_examples=20)
@given(panel=blobs(), allowance=st.floats(1e-3, 8e-3))
def test_allowance(panel: shapely.Polygon, allowance: float) -> None:
    """The cut runs at its distance all around, and mitres reach no further than twice that."""
    cut = cut_outline(panel, [shapely.get_coordinates(panel)], allowance)
    assert cut.contains(panel)
    away = shapely.distance(shapely.points(shapely.get_coordinates(cut)), panel)
    assert away.min() > 0.995 * allowance
    assert away.max() < 2.01 * allowance
    least = panel.buffer(0.99 * allowance)
    assert least.difference(cut).area < 1e-3 * least.area
    assert cut_outline(panel, [], allowance).symmetric_difference(panel).area < 1e-9 * panel.area


@settings(FEW, max_examples=8)
@given(
    panels=st.lists(blobs(), min_size=2, max_size=6), gap=st.floats(1e-3, 6e-3),
    grain=st.sampled_from([None, 0.0, np.pi / 2, 0.3]),
)  # fmt: skip
def test_nested(panels: list[shapely.Polygon], gap: float, grain: float | None) -> None:
    """Panels of their own size lie on the sheet, apart, along the grain, and go back again."""
    outlines, margin, size = {f"{k}": panel for k, panel in enumerate(panels)}, 8e-3, (0.2, 0.16)
    places = nest(outlines, size, gap=gap, margin=margin, grain=grain)
    assert [place.panel for place in places] == list(outlines)
    inner = shapely.box(margin, margin, size[0] - margin, size[1] - margin).buffer(3e-6)
    placed = [place.to_sheet.region(outlines[place.panel]) for place in places]
    for place, region in zip(places, placed, strict=True):
        assert inner.covers(region)
        assert region.area == pytest.approx(outlines[place.panel].area, rel=1e-9)
        back = place.to_sheet.inverse.region(region).symmetric_difference(outlines[place.panel])
        assert back.area < 1e-9 * region.area
        if grain is not None:  # along the roll, up or down
            assert abs(np.cos(place.angle + grain)) < 1e-9
    for (one, a), (other, b) in combinations(zip(places, placed, strict=True), 2):
        assert one.sheet != other.sheet or a.distance(b) > gap - 3e-6


@settings(FEW, max_examples=3)
@given(seed=st.integers(0, 10**6))
def test_cleaned_prints(seed: int) -> None:
    """Of any print what is left can be made: lines and gaps are wide, and it lies on its panel."""
    rng, pattern = np.random.default_rng(seed), square(n=8)
    spots = shapely.buffer(shapely.points(rng.uniform(0, 0.02, (9, 2))), rng.uniform(2e-4, 3e-3, 9))
    strips = shapely.buffer(shapely.linestrings(rng.uniform(0, 0.02, (4, 2, 2))), 3e-4)
    outline = pattern.outline(0)
    region = shapely.union_all([*spots, *strips]).intersection(outline)
    cleaned = clean(Panels(pattern), [region], island_area=5e-6).regions
    found = printability(pattern, cleaned)
    assert not found.lines.narrow
    assert not found.gaps.narrow
    assert not found.free_islands
    assert all(hole.area >= DEFAULT_LIMITS.hole_area for hole in found.holes)
    assert cleaned[0].difference(outline.buffer(1e-8)).area < 1e-12
    if not cleaned[0].is_empty:
        again = clean(Panels(pattern), cleaned, island_area=5e-6).regions[0]
        assert again.symmetric_difference(cleaned[0]).area < 0.01 * cleaned[0].area
