"""Labels of places in a picture, beside each other and joined to their places by lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# Size of the marks that labels keep clear of, and empty border of a label, in points.
MARK, BORDER = 16.0, 2.0
# Distances from the place to its label that are tried, in points, and directions in degrees.
DISTANCES = (12.0, 24.0, 40.0, 60.0, 85.0, 115.0, 150.0)
DIRECTIONS = (30, -30, 150, 210, 0, 180, 60, -60, 120, 240, 90, 270)
# Places of a kind that are closer than this, in points, share a label.
CLOSE = 30.0


@dataclass(frozen=True, eq=False)
class Label:
    """A text beside a place.

    Attributes:
        text: The text.
        at: The place on the axes, (2,).
        colour: Colour of the text.
        places: How many places the label stands for.
    """

    text: str
    at: Floats
    colour: str
    places: int = 1


def groups(axes: Axes, points: Floats) -> list[list[int]]:
    """Return the numbers of points that share a label: each group lies around its first point.

    Args:
        axes: Axes with their final layout.
        points: Points on the axes, (n, 2), the most important first.
    """
    pixels = axes.transData.transform(points)
    near = CLOSE * axes.figure.dpi / 72
    found: list[list[int]] = []
    for k, point in enumerate(pixels):
        for group in found:
            if np.linalg.norm(point - pixels[group[0]]) < near:
                group.append(k)
                break
        else:
            found.append([k])
    return found


def write_labels(axes: Axes, labels: Sequence[Label], marks: Floats) -> int:
    """Write labels that cover neither each other nor a mark; return how many places have none.

    Each is joined to its place by a line that crosses no other label or mark. One that finds no
    room inside the axes is left out.

    Args:
        axes: Axes with their final layout.
        labels: The labels, the most important first.
        marks: Places of all marks on the axes, (n, 2).
    """
    point = axes.figure.dpi / 72  # pixels in a point
    window = shapely.box(*axes.get_window_extent().extents)
    half = MARK / 2 * point
    taken: list[BaseGeometry] = [
        shapely.box(x - half, y - half, x + half, y + half)
        for x, y in axes.transData.transform(marks)
    ]
    leaders: list[BaseGeometry] = []
    left_out = 0
    for label in labels:
        text = axes.annotate(
            label.text,
            (float(label.at[0]), float(label.at[1])),
            (0.0, 0.0),
            textcoords="offset points",
            ha="center",
            va="center",
            color=label.colour,
            fontweight="bold",
            zorder=6,
            path_effects=[withStroke(linewidth=3, foreground="white")],
            arrowprops={"arrowstyle": "-", "color": label.colour, "lw": 0.9, "shrinkA": 0.0,
                        "shrinkB": MARK / 2},
        )  # fmt: skip
        text.set_in_layout(False)
        extent = Text.get_window_extent(text)  # without the line
        size = np.array([extent.width, extent.height]) / point + 2 * BORDER
        start = axes.transData.transform(label.at)
        others = [mark for mark in taken if not mark.contains(shapely.Point(start))]
        for offset in _offsets(size):
            middle = start + offset * point
            box = shapely.box(*(middle - size * point / 2), *(middle + size * point / 2))
            leader = shapely.LineString([start, middle])
            if (
                window.contains(box)
                and not any(box.intersects(other) for other in (*taken, *leaders))
                and not any(leader.intersects(other) for other in others)
            ):
                text.set_position((float(offset[0]), float(offset[1])))
                taken.append(box)
                leaders.append(leader)
                break
        else:
            text.remove()
            left_out += label.places
    return left_out


def _offsets(size: Floats) -> list[Floats]:
    """Return offsets of the middle of a label from its place, in points, to try in turn."""
    angles = np.radians(DIRECTIONS)
    toward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    # From the middle of the label to its border.
    inside = np.min(size / 2 / np.maximum(np.abs(toward), 1e-9), axis=1, keepdims=True)
    return [offset for r in DISTANCES for offset in toward * (inside + r)]
