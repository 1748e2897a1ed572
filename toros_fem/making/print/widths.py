"""Widths of the lines of a printed region, and of the gaps between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.making.print.polygons import TOUCHING, fabric_of
from toros_fem.meshes.triangles import linked

# Two sides face each other if the path along the border from one to the other is longer than this
# factor times their distance, and times the limit. For a wedge the ratio is cot(angle/2): corners,
# notches and junctions blunter than 28° do not count as narrow lines, and neither does the end of
# a line.
FACING = 4.0
# Length over the limit of a stretch of border that one sample stands for in a first look.
STRETCH = 1 / 4
# Fewer points than this have no triangulation.
SIMPLEX = 4


@dataclass(frozen=True)
class LocalWidth:
    """Width of a line or a gap at a place where it is locally thinnest.

    Attributes:
        width: Diameter in m of the largest disc that fits between the two sides.
        ends: The two points where the disc touches the sides, in m on the flat panel.
        panel: Number of the panel.
    """

    width: float
    ends: tuple[tuple[float, float], tuple[float, float]]
    panel: int

    @property
    def centre(self) -> tuple[float, float]:
        """Point half way between the ends, in m."""
        (ax, ay), (bx, by) = self.ends
        return (ax + bx) / 2, (ay + by) / 2


class Widths(NamedTuple):
    """Smallest width, None without facing sides, and all places narrower than a limit."""

    smallest: LocalWidth | None
    narrow: tuple[LocalWidth, ...]


class _Samples(NamedTuple):
    """Points along the rings of polygons."""

    points: Floats
    ring: Ints
    arc: Floats  # distance along the ring
    length: Floats  # length of the whole ring
    free: Bools  # not where the panel is cut

    def path(self, p: Ints, q: Ints) -> Floats:
        """Return the distance along the border between samples, infinite between two rings."""
        along = np.abs(self.arc[p] - self.arc[q])
        along = np.minimum(along, self.length[p] - along)
        return np.where(self.ring[p] == self.ring[q], along, np.inf)


class _Pairs(NamedTuple):
    """Pairs of facing samples, and the smallest empty disc through both."""

    ends: Ints
    path: Floats  # distance along the border, infinite between two rings
    width: Floats
    centre: Floats

    def select(self, kept: Bools) -> _Pairs:
        return _Pairs(self.ends[kept], self.path[kept], self.width[kept], self.centre[kept])


NO_PAIRS = _Pairs(np.empty((0, 2), np.int64), np.empty(0), np.empty(0), np.empty((0, 2)))


def measure_widths(
    region: BaseGeometry,
    outline: BaseGeometry,
    panel: int,
    width_limit: float,
    gap_limit: float,
    resolution: float,
    within: BaseGeometry | None = None,
) -> tuple[Widths, Widths]:
    """Measure the widths of lines, and of the gaps between them, on one panel.

    Print and bare fabric are measured alike, as two regions that share out the panel. The border
    of a region is sampled densely. A disc through two samples that contains no other is inscribed,
    and measures a width. The two samples must lie on facing sides: on different rings, or far apart
    along one ring. The cut edge of the panel is a side only where it leaves less than the limit:
    slivers along it count, wide rests do not. A piece without facing sides, such as a dot, is as
    wide as the largest disc in it; one that meets the cut counts below the limit only.

    Args:
        region: Printed region, polygons in m.
        outline: Outline of the panel.
        panel: Number of the panel.
        width_limit, gap_limit: Narrower places are listed, in m. Ends of lines, and bumps lower
            than about twice the limit, have no width of their own.
        resolution: Distance of samples in m; the error is at most this.
        within: Only discs with their centres in it count, of one tile in a sheet for instance; None
            takes the outline.

    Returns:
        Widths of lines, and of gaps.
    """
    found = []
    for polygons, limit in (
        (region, width_limit),
        (fabric_of(region, outline, resolution), gap_limit),
    ):
        samples, pairs, dots = _facing_sides(polygons, outline.boundary, limit, resolution)
        if within is not None:
            pairs = pairs.select(shapely.contains_xy(within, pairs.centre))
        least = limit - TOUCHING * resolution  # a width equal to the limit is not narrow
        places = [
            _place(samples.points[ends[0]], samples.points[ends[1]], width, panel)
            for ends, width in _thinnest(samples, pairs, least)
        ]
        for dot, cut in dots:
            place = _largest_disc(dot, panel, resolution)
            here = within is None or shapely.contains_xy(within, *place.centre)
            if here and (not cut or place.width < least):
                places.append(place)
        places.sort(key=lambda place: place.width)
        narrow = tuple(place for place in places if place.width < least)
        found.append(Widths(places[0] if places else None, narrow))
    return found[0], found[1]


def narrow_discs(
    polygons: BaseGeometry,
    cut: BaseGeometry,
    limit: float,
    resolution: float,
    near: BaseGeometry,
) -> tuple[Floats, Bools]:
    """Return where inscribed discs are smaller than a limit, close to some places.

    Args:
        polygons: A region, polygons in m.
        cut: Border of the panel.
        limit: Least width in m.
        resolution: Distance in m of the samples on its border.
        near: These places; sides further away are left out, which saves most of the time.

    Returns:
        Centres, (n, 2), in m, and for each whether the cut is one of the two sides.
    """
    samples, pairs, dots = _facing_sides(polygons, cut, limit, resolution, near)
    thin = pairs.select(pairs.width < limit)
    places = [
        (_largest_disc(dot, 0, resolution), at_cut)
        for dot, at_cut in dots
        if dot.buffer(-resolution - limit / 2).is_empty  # else a larger disc fits in
    ]
    small = [(place.centre, at_cut) for place, at_cut in places if place.width < limit]
    at_cut = ~samples.free[thin.ends].all(axis=1)
    return (
        np.concatenate([thin.centre, np.reshape([centre for centre, _ in small], (-1, 2))]),
        np.concatenate([at_cut, np.array([cut_ for _, cut_ in small], dtype=bool)]),
    )


def _facing_sides(
    polygons: BaseGeometry,
    cut: BaseGeometry,
    limit: float,
    resolution: float,
    near: BaseGeometry | None = None,
) -> tuple[_Samples, _Pairs, list[tuple[BaseGeometry, bool]]]:
    """Return samples of the border, pairs on facing sides, and the pieces that have no such.

    With each piece comes whether it meets the cut. With `near`, sides are left out that are far
    from there, or further apart than the limit.
    """
    parts = shapely.get_parts(polygons)
    parts = parts[shapely.area(parts) > 0]
    if near is not None:
        parts = parts[shapely.intersects(parts, near)]
    rings, part = shapely.get_rings(parts, return_index=True)
    if not len(rings):
        none: Floats = np.empty(0)
        zero = np.empty(0, np.int64)
        return _Samples(np.empty((0, 2)), zero, none, none, none > 0), NO_PAIRS, []
    samples = _sample(rings, cut, resolution, None if near is None else near.buffer(2 * limit))
    facing = _facing(samples, resolution, _close(samples, limit) if near is not None else None)
    shapely.prepare(parts)
    inside = np.zeros(len(facing.width), dtype=bool)
    owner = part[samples.ring[facing.ends]]
    same = owner[:, 0] == owner[:, 1]
    inside[same] = shapely.contains_xy(parts[owner[same, 0]], facing.centre[same])
    counts = samples.free[facing.ends].all(axis=1) | (facing.width < limit)
    pairs = facing.select(inside & counts & (facing.path > FACING * limit))
    touched = np.zeros(len(parts), dtype=bool)
    touched[part[samples.ring[~samples.free]]] = True
    lone = np.setdiff1d(np.arange(len(parts)), part[samples.ring[pairs.ends]].ravel())
    return samples, pairs, [(parts[k], bool(touched[k])) for k in lone]


def _sample(
    rings: npt.NDArray[np.object_],
    cut: BaseGeometry,
    resolution: float,
    within: BaseGeometry | None,
) -> _Samples:
    """Return samples, inside some area, on rings of a region that a panel's border cuts."""
    dense, ring = shapely.get_coordinates(shapely.segmentize(rings, resolution), return_index=True)
    last = np.append(ring[1:] != ring[:-1], True)  # a ring's last point repeats its first
    step = np.where(last[:-1], 0, np.linalg.norm(np.diff(dense, axis=0), axis=1))
    along = np.concatenate([[0], np.cumsum(step)])
    first = np.concatenate([[True], last[:-1]])
    arc, length = along - along[first][ring], (along[last] - along[first])[ring]
    kept = ~last
    if within is not None:
        shapely.prepare(within)
        kept &= shapely.contains_xy(within, dense)
    shapely.prepare(cut)
    free = ~shapely.dwithin(cut, shapely.points(dense[kept]), TOUCHING * resolution)
    return _Samples(dense[kept], ring[kept], arc[kept], length[kept], free)


def _close(samples: _Samples, limit: float) -> Bools:
    """Return which samples may face others at less than a limit, with those around them.

    One sample of each stretch of the border stands for all of the stretch. The distances that are
    asked of it are so much larger, and the paths so much shorter, that no pair is lost, nor what
    lies in the disc between its ends.
    """
    stretch = STRETCH * limit
    number = np.stack([samples.ring, np.floor(samples.arc / stretch).astype(np.int64)])
    first = np.append(True, np.any(np.diff(number, axis=1) != 0, axis=0))
    chosen = np.flatnonzero(first)
    pairs = cKDTree(samples.points[chosen]).query_pairs(limit + 2 * stretch, output_type="ndarray")
    p, q = chosen[pairs].T
    far = samples.path(p, q) > FACING / 2 * limit - 2 * stretch
    close: Bools = np.zeros(len(chosen), dtype=bool)
    close[pairs[far]] = True
    # The discs of the outermost pairs are known from samples beyond them.
    reach = int(np.ceil(1 / STRETCH))
    close = np.convolve(close, np.ones(2 * reach + 1), mode="same") > 0
    return close[np.cumsum(first) - 1]


def _facing(samples: _Samples, resolution: float, kept: Bools | None) -> _Pairs:
    """Return pairs of samples on facing sides that are edges of the Delaunay triangulation.

    The discs through a pair that contain no other sample have their centres on the Voronoi edge
    dual to it. The smallest disc has the pair as its diameter if its centre is there. Otherwise it
    is the smaller circumscribed disc of the edge's two triangles.

    Args:
        samples: The samples.
        resolution: Their distance in m.
        kept: The samples that count; None for all.
    """
    origin = samples.points.mean(axis=0)
    # On straight borders and round panels many samples lie on common circles. That makes Qhull 10
    # to 100 times slower, so they are shifted a little.
    shift = np.random.default_rng(0).uniform(-1, 1, samples.points.shape)
    points = samples.points - origin + TOUCHING * resolution * shift
    chosen = np.arange(len(points)) if kept is None else np.flatnonzero(kept)
    if len(chosen) < SIMPLEX:
        return NO_PAIRS
    mesh = Delaunay(points[chosen])
    triangle, k = np.nonzero(mesh.neighbors > np.arange(len(mesh.simplices))[:, None])
    p, q = (chosen[mesh.simplices[triangle, (k + step) % 3]] for step in (1, 2))
    path = samples.path(p, q)
    chord = np.linalg.norm(samples.points[p] - samples.points[q], axis=1)
    far = path > FACING * chord
    triangle, k, p, q, path, chord = (a[far] for a in (triangle, k, p, q, path, chord))
    start, end = points[p], points[q]
    one = _circumcentres(mesh.points[mesh.simplices[triangle]])
    two = _circumcentres(mesh.points[mesh.simplices[mesh.neighbors[triangle, k]]])
    middle = (start + end) / 2
    radii = [np.linalg.norm(centre - start, axis=1) for centre in (one, two)]
    between = np.einsum("ij,ij->i", one - middle, two - middle) <= 0
    nearer = np.where((radii[0] <= radii[1])[:, None], one, two)
    width = np.where(between, chord, np.maximum(chord, 2 * np.minimum(*radii)))
    centre = np.where(between[:, None], middle, nearer) + origin
    pairs = _Pairs(np.stack([p, q], axis=1), path, width, centre)
    return pairs.select((path > FACING * width) & np.isfinite(width))


def _circumcentres(corners: Floats) -> Floats:
    """Return the centres of circles through triangles, (t, 3, 2)."""
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    uu, vv = np.sum(u * u, axis=1), np.sum(v * v, axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 0.5 / (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        x, y = v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu
        return a + np.stack([x * scale, y * scale], axis=1)


def _thinnest(samples: _Samples, pairs: _Pairs, limit: float) -> list[tuple[Ints, float]]:
    """Return the thinnest pair of all, or of each connected set of pairs under the limit."""
    if not len(pairs.width):
        return []
    thin = np.flatnonzero(pairs.width < limit)
    if not len(thin):
        thin = np.array([np.argmin(pairs.width)])
    ends, width = pairs.ends[thin], pairs.width[thin]
    best = _leaders(width, linked(ends[:, 0], ends[:, 1], len(samples.points))[ends[:, 0]])
    # A width that oscillates about the limit must not count as many places.
    middles = samples.points[ends[best]].mean(axis=1)
    near = cKDTree(middles).query_pairs(limit, output_type="ndarray")
    best = best[_leaders(width[best], linked(near[:, 0], near[:, 1], len(best)))]
    return [(ends[k], float(width[k])) for k in best]


def _leaders(width: Floats, label: Ints) -> Ints:
    """Return the thinnest entry of each label."""
    order = np.argsort(width, kind="stable")
    return order[np.unique(label[order], return_index=True)[1]]


def _largest_disc(dot: BaseGeometry, panel: int, resolution: float) -> LocalWidth:
    """Return the diameter of the largest disc in a polygon."""
    radius = shapely.maximum_inscribed_circle(dot, tolerance=resolution / 4)
    centre, border = shapely.get_coordinates(radius)
    return _place(2 * centre - border, border, 2 * radius.length, panel)


def _place(one: Floats, two: Floats, width: float, panel: int) -> LocalWidth:
    return LocalWidth(
        float(width), ((float(one[0]), float(one[1])), (float(two[0]), float(two[1]))), panel
    )
