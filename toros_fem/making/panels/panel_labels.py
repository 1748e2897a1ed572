"""Texts on a panel: its name, which side is up, and the number of each seam beside its edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.panels.free_place import free_place, rectangles

# Width of a letter, and of the rectangle that stays free above and below, over its height.
LETTER, LINE = 0.85, 1.3
# Heights of texts in the allowance, over its width, and in m elsewhere.
HEIGHTS = (0.55, 0.45, 0.35)
ELSEWHERE = (4e-3, 3e-3, 2e-3, 1.5e-3)
# Largest distance in m of the numbers along one seam.
DISTANCE = 80e-3
# Steepest direction of writing downwards, in rad: a small tilt shall not turn a text.
TILT = np.radians(89.0)
# Number of places that are tried along a seam.
TRIED = 200


@dataclass(frozen=True, eq=False)
class Label:
    """A text on a panel.

    Attributes:
        text: The text.
        place: Its centre, (2,), in m.
        angle: Direction of writing in rad.
        height: Height of capitals in m.
    """

    text: str
    place: Floats
    angle: float
    height: float

    @property
    def frame(self) -> BaseGeometry:
        """Rectangle around the text."""
        return rectangles(self.place[None], text_size(self.text, self.height), self.angle)[0]


def text_size(text: str, height: float) -> tuple[float, float]:
    """Return width and height in m of the room that a text needs."""
    return LETTER * height * len(text), LINE * height


def edge_labels(
    text: str, line: Floats, outward: Floats, free: BaseGeometry, allowance: float
) -> list[Label]:
    """Return a text once for every 80 mm beside a seam line, in the middle of its allowance.

    It stands at least once, at the middle of a short seam even where that is not free.

    Args:
        text: The text.
        line: The seam line, (n, 2), in m.
        outward: Unit vectors from its edges to the outside of the panel, (n − 1, 2).
        free: Where nothing else is.
        allowance: Width of the allowance in m.
    """
    places, angles, arc, length = _beside(line, outward, allowance)
    count = max(1, round(length / DISTANCE))
    found = []
    for k in range(count):
        near = np.argsort(np.abs(arc - (k + 0.5) * length / count), kind="stable")
        near = near[np.abs(arc[near] - (k + 0.5) * length / count) <= length / count / 2]
        label = _first(text, places[near], angles[near], free, allowance)
        if label is not None:
            found.append(label)
            free = free.difference(label.frame)
    middle = TRIED // 2
    least = HEIGHTS[-1] * allowance
    return found or [Label(text, places[middle], float(angles[middle]), least)]


def panel_label(
    texts: Sequence[str],
    borders: Sequence[tuple[Floats, Floats]],
    band: BaseGeometry,
    fabric: BaseGeometry,
    panel: BaseGeometry,
    allowance: float | None,
) -> Label:
    """Return a text beside an edge of a panel, or inside of it where no edge is long enough.

    Args:
        texts: The text, and shorter ones in its place, the best first.
        borders: Seam lines, and unit vectors from their edges outwards.
        band: The allowance, where nothing else is.
        fabric: The fabric that is not printed, where nothing else is.
        panel: The whole panel, where the shortest text stands if there is no other room.
        allowance: Width of the allowance in m; None without one.
    """
    for text in texts:
        if allowance is not None and borders:
            tried = [_beside(line, outward, allowance) for line, outward in borders]
            places, angles = (np.concatenate([t[i] for t in tried]) for i in (0, 1))
            label = _first(text, places, angles, band, allowance)
            if label is not None:
                return label
        sizes = [text_size(text, height) for height in ELSEWHERE]
        found = free_place([fabric], sizes, 0.0)
        if found is not None:
            return Label(text, found[0], 0.0, found[1][1] / LINE)
    middle = shapely.get_coordinates(panel.representative_point())[0]
    return Label(texts[-1], middle, 0.0, ELSEWHERE[-1])


def upright(angle: Floats | float) -> Floats:
    """Return the direction in rad in which a text along a line is read from below or the right."""
    return np.asarray(np.mod(angle + TILT, np.pi) - TILT)


def _beside(
    line: Floats, outward: Floats, allowance: float
) -> tuple[Floats, Floats, Floats, float]:
    """Return places in the middle of an allowance, directions of writing, and arc lengths."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    ends = np.concatenate([[0.0], np.cumsum(steps)])
    length = float(ends[-1])
    arc = (np.arange(TRIED) + 0.5) * length / TRIED
    edge = np.clip(np.searchsorted(ends, arc) - 1, 0, len(steps) - 1)
    point = np.column_stack([np.interp(arc, ends, line[:, axis]) for axis in (0, 1)])
    along = np.diff(line, axis=0)[edge]
    angle = np.arctan2(along[:, 1], along[:, 0])
    return point + outward[edge] * allowance / 2, upright(angle), arc, length


def _first(
    text: str, places: Floats, angles: Floats, free: BaseGeometry, allowance: float
) -> Label | None:
    """Return the text at the first place that is free, as high as possible."""
    shapely.prepare(free)
    for share in HEIGHTS:
        height = share * allowance
        fits = shapely.contains(free, rectangles(places, text_size(text, height), angles))
        if fits.any():
            k = int(np.argmax(fits))
            return Label(text, places[k], float(angles[k]), height)
    return None
