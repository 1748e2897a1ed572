"""Marks: notches at seams, registration crosses, the grain arrow, and the ruler of a sheet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.panels.panel_labels import Label, first_fit, places_in
from toros_fem.making.panels.seam_lines import SewnSeam
from toros_fem.meshes.affine import Affine

# Depth of a notch, over the allowance.
DEPTH = 0.5
# The double notch at the start of a seam, over the distance of notches: place and width.
START, PAIR = 0.35, 0.1
# Largest distance in m of its two notches.
APART = 3e-3
# Lengths in m of the grain arrow, the first that fits; its width over its length, and the least.
ARROWS = (30e-3, 20e-3, 15e-3, 10e-3, 7e-3, 5e-3)
BARB = 0.12
# Gap in m between marks and other things.
CLEAR = 0.5e-3
# The ruler: length and distance of ticks; heights of ticks, of its text and of the whole, in m.
RULER, STEP = 0.1, 0.01
TICK, TEXT, HEIGHT = 2e-3, 2.5e-3, 7e-3
# Distance in m of the places that are tried.
TRIED = 4e-3


def notch_arcs(length: float, distance: float) -> Floats:
    """Return the places of notches along a seam as arc lengths in m, (k,).

    Single ones divide the seam evenly, at the distance in m at most. A double one stands near its
    start only, so that neither the direction of an edge nor its partner can be mistaken.
    """
    count = max(1, int(np.ceil(length / distance - 1e-9)))
    step = length / count
    start, half = START * step, min(PAIR * step, APART) / 2
    return np.array([start - half, start + half, *(step * np.arange(1, count))])


def notches(
    seam: SewnSeam, side: int, cut: BaseGeometry, allowance: float, distance: float
) -> Floats:
    """Return the notches at one side of a seam, segments (k, 2, 2) in m, from the cut inwards.

    They end half an allowance before the seam line. Both sides have theirs at the same arc lengths.
    """
    arc = notch_arcs(seam.length, distance)
    normal = seam.outward(side, arc, min(allowance, 0.2 * seam.length))
    foot = seam.at(side, arc)
    rays = shapely.linestrings(np.stack([foot, foot + 2 * allowance * normal], axis=1))
    points, border = shapely.points(foot), cut.boundary
    hit = shapely.shortest_line(points, shapely.intersection(rays, border))
    # A ray that misses the border, which has no length, or meets it at once is not followed.
    far = shapely.length(hit) >= DEPTH * allowance / 2
    hit = np.where(far, hit, shapely.shortest_line(points, border))
    inner, outer = np.moveaxis(shapely.get_coordinates(hit).reshape(-1, 2, 2), 1, 0)
    depth = np.minimum(1.0, DEPTH * allowance / np.maximum(shapely.length(hit), 1e-12))
    return np.stack([outer, outer + depth[:, None] * (inner - outer)], axis=1)


def crosses(outline: BaseGeometry, cut: BaseGeometry, size: float) -> Floats:
    """Return the centres of three registration crosses, (3, 2), of a size in m.

    They stand in corners of the cut outline's bounding box: far apart, so that they measure angles
    well, and off the skin. In a rectangle with an allowance they lie in the corners of the
    allowance, hidden by the sewing; beside a round panel on waste. Where the skin itself, inside
    its seam line, fills a corner they move outwards. The fourth corner has none, so that no half
    turn fits.
    """
    left, low, right, high = cut.bounds
    half = size / 2
    inset = half + CLEAR
    centres = []
    for x, y, outward in ((left, low, (-1, -1)), (right, low, (1, -1)), (left, high, (-1, 1))):
        out = np.array(outward, dtype=np.float64)
        centre = np.array([x, y]) - inset * out
        for _ in range(20):
            # Within the cut it must not meet the skin, outside of it it must not be cut.
            place = shapely.box(*(centre - half), *(centre + half))
            apart = place.intersection(outline).area < 1e-6 * size**2
            if apart and (cut.contains(place) or not cut.intersects(place)):
                break
            centre = centre + 0.25 * half * out
        centres.append(centre)
    return np.array(centres)


def cross_shapes(centres: Floats, size: float) -> list[Floats]:
    """Return the two bars of each cross as segments, (2, 2) in m each."""
    x, y = np.array([size / 2, 0.0]), np.array([0.0, size / 2])
    return [np.stack([c - d, c + d]) for c in centres for d in (x, y)]


def grain_arrow(places: Sequence[BaseGeometry], angle: float) -> list[Floats]:
    """Return the arrow along the grain, at an angle in rad, as lines (n, 2) in m: shaft and head.

    It lies in the first region that has room; without any it lies across the last one.
    """
    sizes = [(length, max(2 * BARB * length, 2e-3)) for length in ARROWS]
    centre, length = shapely.get_coordinates(places[-1].representative_point())[0], ARROWS[-1]
    for place in places:
        tried = places_in(place)
        found = first_fit(place, tried, angle, sizes)
        if found is not None:
            centre, (length, _) = tried[found[0]], found[1]
            break
    along = np.array([np.cos(angle), np.sin(angle)])
    aside = np.array([-along[1], along[0]])
    tail, tip = centre - along * length / 2, centre + along * length / 2
    head = [tip - length * (2 * BARB * along + side * BARB * aside) for side in (1, -1)]
    return [np.stack([tail, tip]), np.stack([head[0], tip, head[1]])]


def ruler(taken: BaseGeometry, sheet: tuple[float, float]) -> tuple[list[Floats], Label]:
    """Return the lines of a ruler of 100 mm, to check the scale of a sheet by, and its text.

    The first line, (n, 2) in m each, is 100 mm long, the others are ticks every 10 mm. They are at
    the lowest place that is not taken, upright where no level one is free, and below the sheet
    without any place.
    """
    free = shapely.box(2 * CLEAR, 2 * CLEAR, sheet[0] - 2 * CLEAR, sheet[1] - 2 * CLEAR)
    free = free.difference(taken.buffer(2 * CLEAR)).buffer(1e-6)
    size = RULER + 4 * CLEAR, HEIGHT
    for angle in (0.0, np.pi / 2):
        wide, high = size if angle == 0 else size[::-1]
        x = np.arange(2 * CLEAR + wide / 2, sheet[0], TRIED)
        for y in np.arange(2 * CLEAR + high / 2, sheet[1], TRIED):
            centres = np.column_stack([x, np.full(len(x), y)])
            found = first_fit(free, centres, angle, [size])
            if found is not None:
                return _ruler_at(Affine.turn(angle, centres[found[0]]))
    below = [2 * CLEAR + size[0] / 2, -2 * CLEAR - HEIGHT / 2]
    return _ruler_at(Affine.shift(below))


def _ruler_at(place: Affine) -> tuple[list[Floats], Label]:
    base = -HEIGHT / 2 + CLEAR
    ticks = np.arange(0, RULER + STEP / 2, STEP) - RULER / 2
    lines = [np.array([[-RULER / 2, base], [RULER / 2, base]])]
    lines += [np.array([[x, base], [x, base + TICK]]) for x in ticks]
    middle = place.points([0.0, base + TICK + CLEAR + TEXT / 2])
    label = Label(f"{1e3 * RULER:.0f} mm", middle, place.angle, TEXT)
    return [place.points(line) for line in lines], label
