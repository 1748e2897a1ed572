"""Prints with lines wider or narrower than drawn."""

import numpy as np
import pytest
import shapely
from helpers.prints import MM, metres
from helpers.scenes import square

from toros_fem.meshes import Pattern
from toros_fem.products.tolerance.simulated import broken_lines, offset_print

RESOLUTION = 0.03 * MM


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    return square()  # 20 mm wide


def test_a_border_on_the_cut_stays(pattern: Pattern) -> None:
    """A line of 2 mm across the panel gets wider by twice the way of its borders."""
    line = metres(shapely.box(9, 0, 11, 20))
    for offset in (-0.1, 0.1):
        (made,) = offset_print(pattern, [line], offset * MM, RESOLUTION)
        wanted = metres(shapely.box(9 - offset, 0, 11 + offset, 20))
        assert made.symmetric_difference(wanted).area < 1e-4 * MM**2


def test_a_panel_that_is_printed_all_over_stays(pattern: Pattern) -> None:
    (made,) = offset_print(pattern, [metres(shapely.box(0, 0, 20, 20))], -0.1 * MM, RESOLUTION)
    assert made.area == pytest.approx(pattern.areas.sum(), rel=1e-9)


def test_what_breaks_is_told(pattern: Pattern) -> None:
    """A thin line vanishes, one with a neck parts; two close ones merge, a small hole closes."""
    thin = shapely.box(1, 1, 19, 1.15)
    neck = shapely.union_all(
        [shapely.box(1, 4, 9, 6), shapely.box(9, 4.9, 11, 5.05), shapely.box(11, 4, 19, 6)]
    )
    close = [shapely.box(1, 9, 19, 11), shapely.box(1, 11.15, 19, 13)]
    ring = shapely.Point(10, 17).buffer(2).difference(shapely.Point(10, 17).buffer(0.08))
    drawn = [metres(shapely.union_all([thin, neck, *close, ring]))]

    def told(offset: float) -> list[str]:
        made = offset_print(pattern, drawn, offset * MM, RESOLUTION)
        return broken_lines(pattern, drawn, made, RESOLUTION)

    assert told(-0.1) == ["1 line vanishes.", "1 line parts."]
    assert told(0.1) == ["1 gap closes.", "1 line touches another."]
    assert told(0.01) == told(-0.01) == []


def test_a_ring_that_opens_is_a_line_that_parts(pattern: Pattern) -> None:
    outer, inner = shapely.box(4, 4, 16, 16), shapely.box(6, 6, 14, 15.85)
    drawn = [metres(outer.difference(inner))]
    made = offset_print(pattern, drawn, -0.1 * MM, RESOLUTION)
    assert broken_lines(pattern, drawn, made, RESOLUTION) == ["1 line parts."]
    assert np.isclose(made[0].area, drawn[0].area, rtol=0.2)
