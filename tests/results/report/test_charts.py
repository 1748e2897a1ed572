"""Charts put values where their axes say."""

import re
import xml.etree.ElementTree as ET

import pytest

from toros_fem.results.report.charts import PRINT, Chart, Line

LINE = Line("angle", [0.0, 5.0, 10.0], [0.0, 30.0, 90.0])


def chart(*lines: Line, **further: object) -> str:
    return Chart("pressure", "pressure (kPa)", "angle (°)", lines or [LINE], **further).svg()  # type: ignore[arg-type]


def texts(svg: str) -> list[str]:
    return [part.text or "" for part in ET.fromstring(svg).iter("text")]


def data(svg: str, name: str) -> float:
    return float(ET.fromstring(svg).attrib[f"data-{name}"])


def places_of_line(svg: str) -> list[tuple[float, float]]:
    """The points of the first line, on the sheet."""
    for path in ET.fromstring(svg).iter("path"):
        style = path.get("style", "")
        if "stroke: var(--print)" in style and "clip-path" in path.attrib:
            found = re.findall(r"[ML] ([\d.]+) ([\d.]+)", path.attrib["d"])
            return [(float(x), float(y)) for x, y in found]
    raise AssertionError("no line")


def test_points_lie_between_their_marks() -> None:
    svg = chart()
    (left, low), (middle, half), (right, high) = places_of_line(svg)
    assert (left, right) == pytest.approx((data(svg, "left"), data(svg, "right")), abs=0.01)
    assert (data(svg, "low"), data(svg, "high")) == (0, 10)
    assert middle == pytest.approx((left + right) / 2, abs=0.01)
    assert (low - half) / (low - high) == pytest.approx(1 / 3, abs=1e-4)
    assert {"0", "20", "40", "60", "80", "2", "10", "angle (°)", "pressure (kPa)"} <= {*texts(svg)}


def test_targets_and_measured_values_are_inside() -> None:
    svg = chart(target=(150.0, "target 150°"), points=[("paper & <b>co $x$", 20.0, -10.0)])
    assert (data(svg, "low"), data(svg, "high")) == (0, 20)
    assert {"target 150°", "paper & <b>co $x$", "125"} <= {*texts(svg)}
    assert "finer mesh" not in texts(svg)
    assert "finer mesh" in texts(chart(breaks=[5.0]))
    assert "at rest" in texts(chart(chosen=("at rest", 5.0, 30.0)))


def test_two_lines_are_named() -> None:
    assert "angle" not in texts(chart()), "its axis says so"
    assert {"angle", "other"} <= {*texts(chart(LINE, Line("other", LINE.x, LINE.x)))}


@pytest.mark.parametrize("values", [[0.5, 1e-4, 2e-3], [0.0, 0.0, 0.0], [1e-9, 1e5, 1.0]])
def test_logarithmic_axes(values: list[float]) -> None:
    svg = chart(Line("T", [0, 1, 2], values), logarithmic=True)
    assert "nan" not in svg
    assert all(0 < y < 187.2 for _, y in places_of_line(svg))
    powers = [text for text in texts(svg) if re.fullmatch(r"0\.0*1|1e-\d+", text)]
    assert (len(powers) > 1) == (max(values) > 0)


def test_a_constant_has_an_axis() -> None:
    assert "nan" not in chart(Line("x", [0, 1], [7.0, 7.0]))
    svg = chart(Line("x", [3.0], [7.0]))
    assert data(svg, "low") < 3 < data(svg, "high"), "of one point too"


def test_a_chart_has_the_same_bytes_again_and_fetches_nothing() -> None:
    svg = chart()
    assert svg == chart()
    assert "http" not in svg
    assert PRINT not in svg, "colours are the page's, which has others in the dark"
    names = re.findall(r'id="([^"]+)"', svg)
    assert not [name for name in names if not re.fullmatch(r"[mp][0-9a-f]{10}", name)]
