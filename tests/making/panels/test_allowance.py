"""The cut runs at the allowance beyond what is sewn, and nowhere else."""

import numpy as np
import pytest
from shapely.geometry import Polygon

from toros_fem.making.panels.panel_drawing import cut_outline

MM = 1e-3
CORNERS = np.array([[0, 0], [100, 0], [100, 50], [0, 50], [0, 0]]) * MM
SQUARE = Polygon(CORNERS)


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
