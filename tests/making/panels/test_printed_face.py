"""A print on the inside is drawn as it is seen from there."""

import numpy as np
import pytest
import shapely
from helpers.panels import pattern_of, striped

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.panels.printed_face import printed_face
from toros_fem.making.panels.seam_lines import sewn_seams

INSIDE = ManufactureOptions(print_side="inside", grain=60.0)


def mirrored(shape: shapely.Geometry) -> shapely.Geometry:
    return shapely.transform(shape, lambda points: points * [-1, 1])


@pytest.mark.parametrize("kind", ["tube", "finger", "sphere"])
def test_an_inside_print_is_mirrored(kind: str) -> None:
    """Print, cut and notches are mirrored; texts are not, and partners stay the same."""
    pattern = pattern_of(kind)
    regions = striped(pattern)
    outside = panel_drawings(pattern, regions)
    inside = panel_drawings(*printed_face(pattern, regions, INSIDE), INSIDE)
    for one, other in zip(outside, inside, strict=True):
        assert mirrored(one.printed).symmetric_difference(other.printed).area < 1e-12
        assert mirrored(one.cut).symmetric_difference(other.cut).area < 1e-9
        assert "inside up" in [label.text for label in other.labels]
        assert sorted(seam.partner for seam in one.seams) == sorted(s.partner for s in other.seams)
        shaft = other.grain[0][1] - other.grain[0][0]
        assert np.degrees(np.arctan2(shaft[1], shaft[0])) == pytest.approx(120.0)
    lengths = [
        sorted(seam.length for seam in sewn_seams(each))
        for each in (pattern, printed_face(pattern, regions, INSIDE)[0])
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)
