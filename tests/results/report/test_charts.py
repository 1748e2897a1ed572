"""Charts put values where their axes say."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers.runs import change_summary, tube, write_run

from toros_fem.measures.figures import Figure
from toros_fem.results.pictures.curves import draw_history, draw_over_pressure
from toros_fem.results.report.charts import chart, over_iterations, over_pressure
from toros_fem.results.runs.stored_run import Measured, StoredCurve, read_run

ANGLE = Figure("angle", "deg", 30.0)


def curve(
    figure: Figure = ANGLE, at: float | None = None, measured: Sequence[Measured] = ()
) -> str:
    rows = [{"pressure_pa": 1e3 * x, "angle_deg": y} for x, y in ((0, 0), (5, 30), (10, 90))]

    def draw(axes: Any) -> None:
        draw_over_pressure(axes, StoredCurve(rows, at, measured), [figure])
        axes.set_xlabel("pressure (kPa)")

    return chart("pressure", draw)[0]


def history(values: Sequence[float], levels: Sequence[int] = ()) -> str:
    rows = [
        {"iteration": float(k), "objective": value, "level": float(level)}
        for k, (value, level) in enumerate(zip(values, levels or [0] * len(values), strict=True))
    ]
    return chart("iteration", lambda axes: draw_history(axes, rows))[0]


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
    svg = curve()
    (left, low), (middle, half), (right, high) = places_of_line(svg)
    assert (left, right) == pytest.approx((data(svg, "left"), data(svg, "right")), abs=0.01)
    assert (data(svg, "low"), data(svg, "high")) == (0, 10)
    assert middle == pytest.approx((left + right) / 2, abs=0.01)
    assert (low - half) / (low - high) == pytest.approx(1 / 3, abs=1e-4)
    assert {"0", "20", "40", "60", "80", "2", "10", "angle (°)", "pressure (kPa)"} <= {*texts(svg)}


def test_targets_and_measured_values_are_inside() -> None:
    odd = Measured("angle_deg", 20e3, -10.0, None, "paper & <b>co $x$")
    svg = curve(Figure("angle", "deg", 30.0, None, 150.0, 4.5), 5e3, [odd])
    assert (data(svg, "low"), data(svg, "high")) == (0, 20)
    assert {"target 150°", "-10° (paper & <b>co $x$)", "30°"} <= {*texts(svg)}
    assert "30°" not in texts(curve(at=12e3)), "the curve ends before this pressure"


def test_the_next_mesh_is_marked() -> None:
    assert "finer mesh" not in texts(history([1.0, 0.5, 0.2]))
    assert "finer mesh" in texts(history([1.0, 0.5, 0.2], [0, 1, 1]))


@pytest.mark.parametrize("values", [[0.5, 1e-4, 2e-3], [0.0, 0.0, 0.0], [1e-9, 1e5, 1.0]])
def test_logarithmic_axes(values: list[float]) -> None:
    svg = history(values)
    assert "nan" not in svg
    assert all(0 < y < 187.2 for _, y in places_of_line(svg))
    powers = [text for text in texts(svg) if re.fullmatch(r"0\.0*1|1e-\d+", text)]
    assert (len(powers) > 1) == (max(values) > 0)


def test_a_chart_has_the_same_bytes_again_and_fetches_nothing() -> None:
    svg = curve()
    assert svg == curve()
    assert "http" not in svg
    assert "#1f3a5f" not in svg, "colours are the page's, which has others in the dark"
    names = re.findall(r'id="([^"]+)"', svg)
    assert not [name for name in names if not re.fullmatch(r"[mp][0-9a-f]{10}", name)]


def test_a_run_has_charts_of_its_metrics(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", tube())
    run = read_run(folder)
    ((one, label),), ((other, of_other),) = over_pressure(run), over_iterations(run)
    assert label == "angle (°) over pressure (kPa)"
    assert of_other == "objective T over iteration"
    assert {"70° (paper)", "88.2 ± 1.5°", "target 90°"} <= {*texts(one)}
    assert "angle (°)" in texts(other)
    change_summary(folder, figures=[])
    ((plain, _),) = over_iterations(read_run(folder))
    assert "angle (°)" not in texts(plain)
