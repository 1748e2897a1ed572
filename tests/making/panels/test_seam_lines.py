"""Seam lines hold every sewn edge once, with both sides point by point together."""

import numpy as np
import pytest
import shapely
from helpers.panels import KINDS, pattern_of

from toros_fem.making.panels.marks import sewn_seams


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
