"""Texts on a panel, and free places for them: name, upper side, the number of each seam."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.panels.seam_lines import SewnSeam
from toros_fem.meshes.affine import Affine

# Number of places that are tried along the longer side of a region.
INSIDE = 48

# Length and width in m.
Size = tuple[float, float]
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


def rectangles(centres: Floats, size: Size, angle: float | Floats) -> np.ndarray:
    """Return rectangles around points (k, 2), turned by an angle in rad, as polygons."""
    angle = np.broadcast_to(angle, len(centres))
    along = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0] / 2
    aside = np.column_stack([-np.sin(angle), np.cos(angle)]) * size[1] / 2
    corners = [centres + s * along + t * aside for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.asarray(shapely.polygons(np.stack(corners, axis=1)))


def first_fit(
    region: BaseGeometry, centres: Floats, angles: float | Floats, sizes: Iterable[Size]
) -> tuple[int, Size] | None:
    """Return the first place where the first size that fits anywhere lies in a region.

    Places (k, 2) and sizes are given the best first, with the angle in rad of the length, one for
    all or one for each place. Returned are the number of the place and the size; None without room.
    """
    shapely.prepare(region)
    for size in sizes:
        fits = shapely.contains(region, rectangles(centres, size, angles))
        if fits.any():
            return int(np.argmax(fits)), size
    return None


def places_in(region: BaseGeometry) -> Floats:
    """Return places in a region, (k, 2), the nearest to its middle first."""
    if region.is_empty:
        return np.empty((0, 2))
    left, low, right, high = region.bounds
    step = max(right - left, high - low) / INSIDE
    x, y = np.meshgrid(
        np.arange(left + step / 2, right, step), np.arange(low + step / 2, high, step)
    )
    places = np.column_stack([x.ravel(), y.ravel()])
    shapely.prepare(region)
    places = places[shapely.contains_xy(region, places)]
    far = np.linalg.norm(places - np.array([left + right, low + high]) / 2, axis=1)
    return places[np.argsort(far, kind="stable")]


@dataclass(frozen=True, eq=False)
class Label:
    """A text on a panel: its centre, (2,), in m, direction in rad, and height of capitals in m."""

    text: str
    place: Floats
    angle: float
    height: float

    @property
    def frame(self) -> BaseGeometry:
        """Rectangle around the text."""
        return rectangles(self.place[None], text_size(self.text, self.height), self.angle)[0]

    def moved(self, place: Affine) -> Label:
        """Return the text after a rotation; one that would stand upside down turns over."""
        angle = float(upright(self.angle + place.angle))
        return replace(self, place=place.points(self.place), angle=angle)


def text_size(text: str, height: float) -> Size:
    """Return width and height in m of the room that a text needs."""
    return LETTER * height * len(text), LINE * height


def edge_labels(seam: SewnSeam, side: int, free: BaseGeometry, allowance: float) -> list[Label]:
    """Return the number of a seam once for every 80 mm beside its edge, where there is room.

    It stands at least once, at the middle of a short seam even where that is not free.
    """
    text, length = str(seam.number), seam.length
    places, angles, arc = _beside(seam, side, allowance)
    heights = [share * allowance for share in HEIGHTS]
    count = max(1, round(length / DISTANCE))
    found = []
    for k in range(count):
        away = np.abs(arc - (k + 0.5) * length / count).round(9)  # so that rounding picks none
        near = np.argsort(away, kind="stable")
        near = near[away[near] <= length / count / 2]
        label = _first(text, places[near], angles[near], free, heights)
        if label is not None:
            found.append(label)
            free = free.difference(label.frame)
    middle = TRIED // 2
    return found or [Label(text, places[middle], float(angles[middle]), heights[-1])]


def panel_label(
    texts: Sequence[str],
    edges: Sequence[tuple[SewnSeam, int]],
    band: BaseGeometry,
    fabric: BaseGeometry,
    panel: BaseGeometry,
    allowance: float | None,
) -> Label:
    """Return a text beside an edge of a panel, or inside of it where no edge is long enough.

    `texts` are its wordings, the best first. `band`, the allowance, and `fabric`, which is not
    printed, are where nothing else is. Without room the shortest wording stands on the panel.
    """
    inside = places_in(fabric)
    for text in texts:
        if allowance is not None and edges:
            tried = [_beside(*edge, allowance) for edge in edges]
            places, angles = (np.concatenate([t[i] for t in tried]) for i in (0, 1))
            label = _first(text, places, angles, band, [share * allowance for share in HEIGHTS])
            if label is not None:
                return label
        label = _first(text, inside, np.zeros(len(inside)), fabric, ELSEWHERE)
        if label is not None:
            return label
    middle = shapely.get_coordinates(panel.representative_point())[0]
    return Label(texts[-1], middle, 0.0, ELSEWHERE[-1])


def upright(angle: Floats | float) -> Floats:
    """Return the direction in rad in which a text along a line is read from below or the right."""
    return np.asarray(np.mod(angle + TILT, np.pi) - TILT)


def _beside(seam: SewnSeam, side: int, allowance: float) -> tuple[Floats, Floats, Floats]:
    """Return places in the middle of an allowance, directions of writing, and arc lengths."""
    arc = (np.arange(TRIED) + 0.5) * seam.length / TRIED
    outward = seam.outward(side, arc, 1e-6 * seam.length)
    angles = upright(np.arctan2(outward[:, 1], outward[:, 0]) + np.pi / 2)
    return seam.at(side, arc) + outward * allowance / 2, angles, arc


def _first(
    text: str, places: Floats, angles: Floats, free: BaseGeometry, heights: Sequence[float]
) -> Label | None:
    """Return the text at the first place that is free, as high as possible."""
    found = first_fit(free, places, angles, (text_size(text, height) for height in heights))
    if found is None:
        return None
    k, (_, high) = found
    return Label(text, places[k], float(angles[k]), high / LINE)
