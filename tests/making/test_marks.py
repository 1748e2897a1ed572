"""The ruler of a sheet keeps its distance from panels and from the border."""

import tracemalloc

import numpy as np
import pytest
import shapely
from helpers.panels import KINDS, pattern_of

from toros_fem.making.marks import ruler, sewn_seams


def points(array: np.ndarray) -> list[tuple[float, ...]]:
    return [(float(x), float(y)) for x, y in array]


@pytest.mark.parametrize("kind", KINDS)
def test_seams_hold_every_sewn_edge_once(kind: str) -> None:
    pattern = pattern_of(kind)
    seams = sewn_seams(pattern)
    assert [seam.number for seam in seams] == list(range(1, len(seams) + 1))
    found = []
    for seam in seams:
        one, two = seam.lines
        found += [
            frozenset({(seam.panels[0], a, b), (seam.panels[1], c, d)})
            for (a, b), (c, d) in zip(
                zip(points(one), points(one[1:]), strict=False),
                zip(points(two), points(two[1:]), strict=False),
                strict=True,
            )
        ]
    panel = np.zeros(len(pattern.flat_points), dtype=int)
    panel[pattern.flat_triangles] = pattern.panel[:, None]
    wanted = set()
    for (a, b), (c, d) in pattern.seams:
        p, q = int(panel[a]), int(panel[c])
        places = [tuple(pattern.flat_points[k].tolist()) for k in (a, b, c, d)]
        forward = frozenset({(p, places[0], places[1]), (q, places[2], places[3])})
        wanted.add(forward)
        wanted.add(frozenset({(p, places[1], places[0]), (q, places[3], places[2])}))
    assert len(found) == len(set(found)) == len(pattern.seams)
    assert set(found) <= wanted


@pytest.mark.parametrize("kind", KINDS)
def test_panels_lie_left_of_the_first_side_and_right_of_the_second(kind: str) -> None:
    pattern = pattern_of(kind)
    for seam in sewn_seams(pattern):
        arc = (seam.arc[1:] + seam.arc[:-1]) / 2
        for side, panel in enumerate(seam.panels):
            beside = seam.at(side, arc) + 1e-5 * seam.outward(side, arc, 1e-6)
            inside = seam.at(side, arc) - 1e-5 * seam.outward(side, arc, 1e-6)
            outline = pattern.outline(panel)
            assert not shapely.contains_xy(outline, beside).any()
            assert shapely.contains_xy(outline, inside).all()


@pytest.mark.parametrize(("room", "fits"), [(9.1e-3, True), (8.9e-3, False)])
def test_the_ruler_takes_a_band_that_is_just_high_enough(room: float, fits: bool) -> None:
    """7 mm for itself, 1 mm to the border and 1 mm to what is cut."""
    (base, *_), _ = ruler(shapely.box(0.0, room, 0.2, 0.1), (0.2, 0.1))
    assert (base.min() > 0) == fits  # else below the sheet


def test_ruler_of_a_long_roll_takes_little_memory() -> None:
    """Places are tried row by row: a grid of all of a roll would fill the memory."""
    tracemalloc.start()
    lines, _ = ruler(shapely.Polygon(), (5.0, 100.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert lines[0][0, 1] < 0.02
    assert peak < 5e6
