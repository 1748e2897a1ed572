"""Line charts as SVG, drawn without a plotting package."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from toros_fem.base.array_types import Floats

WIDTH, HEIGHT = 560, 230
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 14, 40
# Number of marks that an axis has about.
MARKS = 5


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart.

    Attributes:
        label: Its name in the legend.
        x, y: Its points.
        look: Its style, a class of the page: "first" or "second".
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    look: str = "first"


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart over one axis.

    Attributes:
        series: Series of frames whose slider marks a place on its axis.
        x_label, y_label: Names of its axes, with units.
        lines: Its lines.
        target: A value to reach, a dashed line; None for none.
        points: Values of others, measured for instance: name, x and y.
        chosen: The place that the run's figures are of: name, x and y; None for none.
        logarithmic: Whether its y axis is logarithmic.
        breaks: Places where something changes, dotted lines.
    """

    series: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    target: float | None = None
    points: Sequence[tuple[str, float, float]] = ()
    chosen: tuple[str, float, float] | None = None
    logarithmic: bool = False
    breaks: Sequence[float] = ()

    def svg(self) -> str:
        """Return the chart as an SVG element; the page finds its axis in its attributes."""
        x = np.concatenate([*(line.x for line in self.lines), [p[1] for p in self.points]])
        y = np.concatenate([*(line.y for line in self.lines), [p[2] for p in self.points]])
        if self.target is not None:
            y = np.append(y, self.target)
        low, high = float(x.min()), float(x.max())
        high = high if high > low else low + 1
        marks = _decades(y) if self.logarithmic else _marks(float(y.min()), float(y.max()))
        bottom, top = marks[0], marks[-1]

        def across(value: float) -> float:
            return LEFT + (value - low) / (high - low) * (WIDTH - LEFT - RIGHT)

        def up(value: float) -> float:
            a, b, v = (
                (math.log10(bottom), math.log10(top), math.log10(max(value, bottom)))
                if self.logarithmic
                else (bottom, top, value)
            )
            return HEIGHT - BOTTOM - (v - a) / (b - a) * (HEIGHT - TOP - BOTTOM)

        right, floor = WIDTH - RIGHT, HEIGHT - BOTTOM
        out = [
            f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" data-series="{self.series}" '
            f'data-low="{low!r}" data-high="{high!r}" data-left="{LEFT}" data-right="{right}" '
            f'role="img" aria-label="{escape(self.y_label)} over {escape(self.x_label)}">'
        ]
        for value in marks:
            at = up(value)
            out.append(f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{at:.1f}" y2="{at:.1f}"/>')
            out.append(
                f'<text class="mark" x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">'
                f"{_number(value, self.logarithmic)}</text>"
            )
        inner = [v for v in _marks(low, high) if low <= v <= high]
        out.extend(
            f'<text class="mark" x="{across(v):.1f}" y="{floor + 16}" text-anchor="middle">'
            f"{_number(v)}</text>"
            for v in inner
        )
        out.append(f'<line class="axis" x1="{LEFT}" x2="{right}" y1="{floor}" y2="{floor}"/>')
        out.append(
            f'<text class="name" x="{(LEFT + right) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
            f"{escape(self.x_label)}</text>"
        )
        middle = (TOP + floor) / 2
        out.append(
            f'<text class="name" transform="translate(13,{middle}) rotate(-90)" '
            f'text-anchor="middle">{escape(self.y_label)}</text>'
        )
        out.extend(
            f'<line class="break" x1="{across(v):.1f}" x2="{across(v):.1f}" y1="{TOP}" '
            f'y2="{floor}"/>'
            for v in self.breaks
        )
        if self.target is not None:
            at = up(self.target)
            out.append(
                f'<line class="target" x1="{LEFT}" x2="{right}" y1="{at:.1f}" y2="{at:.1f}"/>'
            )
        for line in self.lines:
            places = " ".join(
                f"{across(a):.1f},{up(b):.1f}" for a, b in zip(line.x, line.y, strict=True)
            )
            out.append(f'<polyline class="line {line.look}" points="{places}"/>')
            if len(line.x) < 40:
                dot = f'<circle class="dot {line.look}" r="2.5"'
                out.extend(
                    f'{dot} cx="{across(a):.1f}" cy="{up(b):.1f}"/>'
                    for a, b in zip(line.x, line.y, strict=True)
                )
        out.extend(
            f'<path class="other" d="M{across(a) - 5:.1f},{up(b):.1f} h10 m-5,-5 v10"/>'
            for _, a, b in self.points
        )
        if self.chosen is not None:
            _, a, b = self.chosen
            out.append(f'<circle class="chosen" cx="{across(a):.1f}" cy="{up(b):.1f}" r="5"/>')
        out.append(f'<line class="now" x1="-9" x2="-9" y1="{TOP}" y2="{floor}"/></svg>')
        return "".join(out) + self._legend()

    def _legend(self) -> str:
        entries = [(line.look, line.label) for line in self.lines if len(self.lines) > 1]
        if self.target is not None:
            entries.append(("target", f"target {_number(self.target)}"))
        entries += [("other", name) for name, *_ in self.points]
        if self.chosen is not None:
            entries.append(("chosen", self.chosen[0]))
        if self.breaks:
            entries.append(("break", "finer mesh"))
        keys = "".join(f'<li class="{look}">{escape(name)}</li>' for look, name in entries)
        return f'<ul class="legend">{keys}</ul>' if keys else ""


def _marks(low: float, high: float) -> Floats:
    """Return round values at even distances that enclose a range."""
    if not high > low:
        margin = abs(low) * 0.05 or 1.0
        low, high = low - margin, high + margin
    rough = (high - low) / MARKS
    power = 10 ** math.floor(math.log10(rough))
    step = next(power * k for k in (1, 2, 5, 10) if power * k >= rough * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return np.arange(first, last + 1) * step


def _decades(values: Floats) -> Floats:
    """Return powers of ten that enclose positive values, seven at most."""
    positive = values[values > 0]
    if len(positive) == 0:
        return np.array([0.1, 1.0])
    low = math.floor(math.log10(positive.min()))
    high = max(low + 1, math.ceil(math.log10(positive.max())))
    step = max(1, math.ceil((high - low) / 6))
    return np.asarray(10.0 ** np.arange(low, high + step, step), dtype=np.float64)


def _number(value: float, scientific: bool = False) -> str:
    if scientific:
        exponent = round(math.log10(value))
        raised = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"10{raised}"
    return f"{value:.6g}".replace("-", "−")
