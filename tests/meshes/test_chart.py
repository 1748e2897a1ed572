"""Regions are opened to a disc and laid flat, or refused."""

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.chart import ChartError, lay_flat
from toros_fem.meshes.triangles import flat_areas


def test_slivers_are_named() -> None:
    """A flat triangle of no use, though none is turned over."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])
    for method in ("exact", "lscm"):
        with pytest.raises(ChartError, match="1 of its 2 triangles are slivers"):
            lay_flat(points, triangles, np.zeros((2, 3), dtype=bool), method, np.inf, tips=False)


def uncut(triangles: np.ndarray) -> np.ndarray:
    return np.zeros(triangles.shape, dtype=bool)


def test_regions_that_are_refused() -> None:
    cap, _ = surfaces.cap(6, 1.3)
    with pytest.raises(ChartError, match=r"stretch of 0\.\d+ exceeds 0.01"):
        lay_flat(cap.points, cap.triangles, uncut(cap.triangles), "abf", 0.01, tips=False)
    with pytest.raises(SurfaceError, match=r"216 triangles is not developable: .* 'auto'"):
        lay_flat(cap.points, cap.triangles, uncut(cap.triangles), "exact", np.inf, tips=False)
    ball = surfaces.sphere(2)
    with pytest.raises(ChartError, match="closed and round"):
        lay_flat(ball.points, ball.triangles, uncut(ball.triangles), "auto", np.inf, tips=True)
    ramp = surfaces.ramp()
    with pytest.raises(ChartError, match="border overlaps itself"):
        lay_flat(ramp.points, ramp.triangles, uncut(ramp.triangles), "exact", np.inf, tips=False)


@pytest.mark.parametrize("method", ["auto", "lscm"])
def test_a_tube_gets_one_slit_and_keeps_its_area(method: str) -> None:
    tube = surfaces.prism(12, 5)
    chart = lay_flat(tube.points, tube.triangles, uncut(tube.triangles), method, np.inf, tips=False)
    assert chart.method == ("exact" if method == "auto" else method)
    assert chart.slits.sum() == 2 * 5, "both sides of a line of five edges"
    areas = flat_areas(chart.corners)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(tube.area, rel=1e-9)
    already = lay_flat(tube.points, tube.triangles, chart.slits, method, np.inf, tips=False)
    assert not already.slits.any(), "what is cut already is not cut again"
