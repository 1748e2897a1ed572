"""Charts put values where their axes say."""

import re

import pytest

from toros_fem.results.report.charts import Chart, Line


def chart(**further: object) -> str:
    line = Line("angle", [0.0, 5.0, 10.0], [0.0, 30.0, 90.0])
    return Chart("pressure", "pressure (kPa)", "angle (°)", [line], **further).svg()  # type: ignore[arg-type]


def test_points_lie_between_their_marks() -> None:
    svg = chart()
    marks = {
        label: float(y)
        for y, label in re.findall(r'class="mark" x="56" y="([\d.]+)"[^>]*>([^<]+)<', svg)
    }
    assert list(marks) == ["0", "20", "40", "60", "80", "100"]
    assert re.findall(r'"middle">(\d+)<', svg) == ["0", "2", "4", "6", "8", "10"]
    points = re.search(r'points="([^"]+)"', svg)
    assert points
    (left, low), (middle, _), (right, high) = (
        map(float, point.split(",")) for point in points[1].split()
    )
    assert (left, middle, right) == pytest.approx((62, 304, 546), abs=0.1)
    # A mark's text is 4 below its line.
    per_degree = (marks["0"] - marks["100"]) / 100
    assert low == pytest.approx(marks["0"] - 4, abs=0.1)
    assert high == pytest.approx(low - 90 * per_degree, abs=0.1)


def test_targets_and_measured_values_are_inside() -> None:
    svg = chart(target=150.0, points=[("paper & co", 20.0, -10.0)])
    assert 'data-low="0.0" data-high="20.0"' in svg
    assert ">−50<" in svg
    assert "target 150" in svg
    assert "paper &amp; co" in svg
    assert "finer mesh" not in svg
    assert '<li class="break">finer mesh</li>' in chart(breaks=[5.0])


@pytest.mark.parametrize("values", [[0.5, 1e-4, 2e-3], [0.0, 0.0, 0.0], [1e-9, 1e5, 1.0]])
def test_logarithmic_axes(values: list[float]) -> None:
    svg = Chart(
        "iteration", "iteration", "T", [Line("T", [0, 1, 2], values)], logarithmic=True
    ).svg()
    heights = [float(point.split(",")[1]) for point in re.findall(r"[\d.]+,[\d.-]+", svg)]
    assert all(13 < height < 191 for height in heights)
    assert "10⁻" in svg


def test_a_constant_has_an_axis() -> None:
    svg = Chart("iteration", "iteration", "x", [Line("x", [0, 1], [7.0, 7.0])]).svg()
    assert "nan" not in svg
    assert ">7<" in svg
    svg = Chart("iteration", "iteration", "x", [Line("x", [3.0], [7.0])]).svg()
    assert 'data-low="3.0" data-high="4.0"' in svg, "of one point too"
