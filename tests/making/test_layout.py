"""Places of panels: apart, inside, along the grain, the same in every run."""

from itertools import combinations

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from toros_fem.making.layout import Placement, nest

GAP, MARGIN = 4e-3, 10e-3
BED = (0.25, 0.21)


def leaves(count: int) -> dict[str, shapely.Polygon]:
    """Irregular panels that all lie around the origin, with many corners."""
    rng = np.random.default_rng(4)
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    found = {}
    for k in range(count):
        wide, phase = rng.uniform(0.02, 0.04), rng.uniform(0, 6)
        radius = wide * (1 + 0.3 * np.cos(3 * turn + phase))
        corners = np.column_stack([radius * np.cos(turn), 0.5 * radius * np.sin(turn)])
        found[f"leaf {k}"] = shapely.Polygon(corners)
    return found


def check(
    outlines: dict[str, shapely.Polygon], places: list[Placement], size: tuple[float, float]
) -> None:
    """Inside the margin, apart by the gap, and each panel of its own size."""
    assert [place.panel for place in places] == list(outlines)
    placed = [place.to_sheet.region(outlines[place.panel]) for place in places]
    inner = shapely.box(MARGIN, MARGIN, size[0] - MARGIN, size[1] - MARGIN).buffer(3e-6)
    for place, region in zip(places, placed, strict=True):
        assert inner.covers(region)
        assert region.area == pytest.approx(outlines[place.panel].area, rel=1e-9)
        back = place.to_sheet.inverse.region(region)
        assert back.symmetric_difference(outlines[place.panel]).area < 1e-9 * region.area
    for (one, a), (other, b) in combinations(zip(places, placed, strict=True), 2):
        if one.sheet == other.sheet:
            assert a.distance(b) > GAP - 3e-6


def test_panels_apart_keep_their_places() -> None:
    outlines = {
        name: translate(shape, 0.11 * k + 3, -7)
        for k, (name, shape) in enumerate(leaves(3).items())
    }
    wide = (0.35, 0.21)
    places = nest(outlines, wide, gap=1e-3, margin=MARGIN, grain=np.pi / 2)
    assert len({place.offset for place in places}) == 1
    assert {(place.angle, place.sheet) for place in places} == {(0.0, 0)}
    low = np.min(
        [place.to_sheet.region(outlines[place.panel]).bounds[:2] for place in places], axis=0
    )
    assert low == pytest.approx([MARGIN, MARGIN], abs=1e-9)
    # Turned with the grain, all alike; no more where they are too close or the sheet too small.
    turned = nest(outlines, (0.21, 0.35), gap=1e-3, margin=MARGIN, grain=0.0)
    assert {place.angle for place in turned} == {np.pi / 2}
    assert len({place.offset for place in turned}) == 1
    packed = nest(outlines, (0.12, 0.21), gap=1e-3, margin=MARGIN, grain=np.pi / 2)
    assert len({place.offset for place in packed}) == 3


def test_panels_of_a_plane_move_apart_for_their_allowances() -> None:
    apart = {f"tile {k}": shapely.box(0.05 * k, 0, 0.05 * k + 0.04, 0.1) for k in range(4)}
    wide = {name: shape.buffer(4.5e-3, join_style="mitre") for name, shape in apart.items()}
    places = nest(wide, BED, gap=GAP, margin=MARGIN, grain=np.pi / 2)
    check(wide, places, BED)
    lefts = [place.to_sheet.region(wide[place.panel]).bounds[0] for place in places]
    steps = np.diff(lefts)
    assert steps == pytest.approx([steps[0]] * 3)
    assert 0.049 + GAP - 3e-6 <= steps[0] <= 0.049 + GAP + 0.02 * 0.05
    assert {place.offset[1] for place in places} == {places[0].offset[1]}


def test_a_panel_as_large_as_the_sheet_fits() -> None:
    whole = {"wall": shapely.box(0, 0, 0.23, 0.19), "cap": shapely.Point(0, 0).buffer(0.01)}
    places = nest(whole, BED, gap=GAP, margin=MARGIN, grain=np.pi / 2)
    check(whole, places, BED)
    assert [place.sheet for place in places] == [0, 1]


def test_a_slanted_panel_is_turned_upright() -> None:
    strip = rotate(shapely.box(0, 0, 0.22, 0.02), 37)
    slanted = {"strip": strip, "cap": shapely.box(0, 0, 1e-2, 1e-2)}
    size = (0.25, 0.08)
    check(slanted, nest(slanted, size, gap=GAP, margin=MARGIN), size)


def test_round_panels_beside_their_crosses_are_nested() -> None:
    """Their simplified outlines have no two corners within rounding of each other."""
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    for high in np.linspace(0.02, 0.03, 25):
        cap = shapely.Polygon(np.column_stack([0.02 * np.cos(turn), high * np.sin(turn)]))
        cross = shapely.box(-0.022, -high - 2e-3, -0.018, -high + 2e-3)
        both = dict.fromkeys(("base", "tip"), cap.union(cross))
        check(both, nest(both, BED, gap=GAP, margin=MARGIN), BED)
