"""Widths of the lines of a printed region, and of the gaps between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.making.print.contours import TOUCHING, fabric_of
from toros_fem.meshes.triangles import cross, linked

# Most samples of a border: some minutes, and some hundred megabytes.
MOST_SAMPLES = 5e6
# Two sides face each other if the path along the border from one to the other is longer than this
# factor times their distance, and times the limit. For a wedge the ratio is cot(angle/2): corners,
# notches and junctions blunter than 28° do not count as narrow lines, and neither does the end of
# a line.
FACING = 4.0
# Length over the limit of a stretch of border that one sample stands for in a first look.
STRETCH = 1 / 4
# Fewer points than this have no triangulation.
SIMPLEX = 4


@dataclass(frozen=True, eq=False)
class LocalWidth:
    """Width of a line or a gap at a place where it is locally thinnest.

    Attributes:
        width: Diameter in m of the largest disc that fits between the two sides.
        ends: The two points where the disc touches the sides, (2, 2), in m on the flat panel.
        panel: Number of the panel.
    """

    width: float
    ends: Floats
    panel: int

    @property
    def centre(self) -> Floats:
        """Point half way between the ends, (2,), in m."""
        return np.asarray(self.ends.mean(axis=0))


_width = attrgetter("width")


class Widths(NamedTuple):
    """Smallest width, None without facing sides, and all places narrower than a limit."""

    smallest: LocalWidth | None
    narrow: tuple[LocalWidth, ...]

    @classmethod
    def joined(cls, parts: Sequence[Widths]) -> Widths:
        """Return those of several regions together."""
        smallest = [part.smallest for part in parts if part.smallest]
        narrow = [place for part in parts for place in part.narrow]
        return cls(min(smallest, key=_width, default=None), tuple(sorted(narrow, key=_width)))


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
    """Measure the widths of lines, and of the gaps between them, on one panel; return both.

    Print and bare fabric are measured alike, as two regions that share out the panel. The border
    of a region is sampled densely. A disc through two samples that contains no other is inscribed,
    and measures a width. The two samples must lie on facing sides: on different rings, or far apart
    along one ring. The cut edge of the panel is a side only where it leaves less than the limit:
    slivers along it count, wide rests do not. A piece without facing sides, such as a dot, is as
    wide as the largest disc in it; one that meets the cut counts below the limit only.

    Args:
        width_limit, gap_limit: Narrower places are listed, in m. Ends of lines, and bumps lower
            than about twice the limit, have no width of their own.
        resolution: Distance of samples in m; the error is at most this.
        within: Only discs with their centres in it count, of one tile in a sheet for instance; None
            takes the outline.
    """
    found = []
    for polygons, limit in (
        (region, width_limit),
        (fabric_of(region, outline, resolution), gap_limit),
    ):
        border = _Border(polygons, outline.boundary, limit, resolution)
        pairs = facing = border.facing()
        if within is not None:
            pairs = pairs.select(shapely.contains_xy(within, pairs.centre))
        least = limit - TOUCHING * resolution  # a width equal to the limit is not narrow
        places = [
            LocalWidth(width, border.points[ends], panel)
            for ends, width in border.thinnest(pairs, least)
        ]
        for dot, cut in border.lone(facing):
            place = _largest_disc(dot, panel, resolution)
            here = within is None or shapely.contains_xy(within, *place.centre)
            if here and (not cut or place.width < least):
                places.append(place)
        places.sort(key=_width)
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

    Sides further away from these places are left out, which saves most of the time. Returned are
    centres, (n, 2), in m, and for each whether the cut, the panel's border, is one of the sides.
    """
    border = _Border(polygons, cut, limit, resolution, near)
    pairs = border.facing()
    thin = pairs.select(pairs.width < limit)
    places = [
        (_largest_disc(dot, 0, resolution), at_cut)
        for dot, at_cut in border.lone(pairs)
        if dot.buffer(-resolution - limit / 2).is_empty  # else a larger disc fits in
    ]
    small = [(place, at_cut) for place, at_cut in places if place.width < limit]
    at_cut = [*~border.free[thin.ends].all(axis=1), *(at_cut for _, at_cut in small)]
    centres = np.concatenate([thin.centre, *(place.centre[None] for place, _ in small)])
    return centres, np.array(at_cut, dtype=bool)


class _Border:
    """Samples on the border of a region, and which of them face each other.

    What is far from places that are given, and sides further apart than the limit, are left out.

    Attributes:
        points: The samples, (n, 2), in m.
        free: Which of them are not on the cut, the border of the panel, (n,).
    """

    def __init__(
        self,
        polygons: BaseGeometry,
        cut: BaseGeometry,
        limit: float,
        resolution: float,
        near: BaseGeometry | None = None,
    ) -> None:
        self._limit, self._resolution = limit, resolution
        parts = shapely.get_parts(polygons)
        parts = parts[shapely.area(parts) > 0]
        if near is not None:
            parts = parts[shapely.intersects(parts, near)]
        self._parts = parts
        rings, part = shapely.get_rings(parts, return_index=True)
        count = float(shapely.length(rings).sum()) / resolution
        if count > MOST_SAMPLES:
            raise ParameterError(
                f"widths of {limit:.3g} m would be measured at {count:.2g} places of the border, "
                f"more than {MOST_SAMPLES:.0g}. Give a limit of at least "
                f"{limit * count / MOST_SAMPLES:.2g} m."
            )
        dense, ring = shapely.get_coordinates(
            shapely.segmentize(rings, resolution), return_index=True
        )
        count = len(ring)
        last = np.append(ring[1:] != ring[:-1], True)[:count]  # it repeats the first of its ring
        step = np.where(last[:-1], 0, np.linalg.norm(np.diff(dense, axis=0), axis=1))
        along = np.concatenate([[0], np.cumsum(step)])[:count]
        first = np.concatenate([[True], last[:-1]])[:count]
        kept = ~last
        if near is not None:
            within = near.buffer(2 * limit)
            shapely.prepare(within)
            kept &= shapely.contains_xy(within, dense)
        self.points, self._ring = dense[kept], ring[kept]
        # The part, the distance along the ring, and the length of the ring, of each sample.
        self._part = part[self._ring]
        self._arc = (along - along[first][ring])[kept]
        self._length = (along[last] - along[first])[self._ring]
        shapely.prepare(cut)
        self.free = ~shapely.dwithin(cut, shapely.points(self.points), TOUCHING * resolution)
        self._chosen = np.arange(len(self.points)) if near is None else self._close()

    def facing(self) -> _Pairs:
        """Return the pairs of samples on facing sides of a part."""
        pairs = self._neighbours()
        shapely.prepare(self._parts)
        inside = np.zeros(len(pairs.width), dtype=bool)
        one, two = self._part[pairs.ends].T
        same = one == two
        inside[same] = shapely.contains_xy(self._parts[one[same]], pairs.centre[same])
        counts = self.free[pairs.ends].all(axis=1) | (pairs.width < self._limit)
        return pairs.select(inside & counts & (pairs.path > FACING * self._limit))

    def lone(self, pairs: _Pairs) -> list[tuple[BaseGeometry, bool]]:
        """Return the parts without facing sides, and whether each meets the cut."""
        touched = np.unique(self._part[~self.free])
        lone = np.setdiff1d(np.arange(len(self._parts)), self._part[pairs.ends])
        return [(self._parts[k], bool(np.isin(k, touched))) for k in lone]

    def thinnest(self, pairs: _Pairs, limit: float) -> list[tuple[Ints, float]]:
        """Return the thinnest pair of all, or of each connected set of pairs under the limit."""
        if not len(pairs.width):
            return []
        thin = np.flatnonzero(pairs.width < limit)
        if not len(thin):
            thin = np.array([np.argmin(pairs.width)])
        ends, width = pairs.ends[thin], pairs.width[thin]
        best = _leaders(width, linked(ends[:, 0], ends[:, 1], len(self.points))[ends[:, 0]])
        # A width that oscillates about the limit must not count as many places.
        near = cKDTree(self.points[ends[best]].mean(axis=1)).query_pairs(
            limit, output_type="ndarray"
        )
        best = best[_leaders(width[best], linked(near[:, 0], near[:, 1], len(best)))]
        return [(ends[k], float(width[k])) for k in best]

    def _paths(self, p: Ints, q: Ints) -> Floats:
        """Return the distance along the border between samples, infinite between two rings."""
        along = np.abs(self._arc[p] - self._arc[q])
        along = np.minimum(along, self._length[p] - along)
        return np.where(self._ring[p] == self._ring[q], along, np.inf)

    def _close(self) -> Ints:
        """Return the samples that may face others at less than the limit, with those around them.

        One sample of each stretch of the border stands for all of the stretch. The distances that
        are asked of it are so much larger, and the paths so much shorter, that no pair is lost, nor
        what lies in the disc between its ends.
        """
        if not len(self.points):
            return np.empty(0, np.int64)
        limit, stretch = self._limit, STRETCH * self._limit
        number = np.stack([self._ring, np.floor(self._arc / stretch).astype(np.int64)])
        first = np.append(True, np.any(np.diff(number, axis=1) != 0, axis=0))
        chosen = np.flatnonzero(first)
        tree = cKDTree(self.points[chosen])
        pairs = tree.query_pairs(limit + 2 * stretch, output_type="ndarray")
        far = self._paths(*chosen[pairs].T) > FACING / 2 * limit - 2 * stretch
        close = np.zeros(len(chosen))
        close[pairs[far]] = 1.0
        # The discs of the outermost pairs are known from samples beyond them.
        reach = int(np.ceil(1 / STRETCH))
        wide = np.convolve(close, np.ones(2 * reach + 1), mode="same") > 0.5
        return np.flatnonzero(wide[np.cumsum(first) - 1])

    def _neighbours(self) -> _Pairs:
        """Return pairs of samples far along the border that are edges of a Delaunay triangulation.

        The discs through a pair that contain no other sample have their centres on the Voronoi edge
        dual to it. The smallest disc has the pair as its diameter if its centre is there. Otherwise
        it is the smaller circumscribed disc of the edge's two triangles.
        """
        if len(self._chosen) < SIMPLEX:
            return NO_PAIRS
        origin = self.points.mean(axis=0)
        # On straight borders and round panels many samples lie on common circles. That makes Qhull
        # 10 to 100 times slower, so they are shifted a little.
        shift = np.random.default_rng(0).uniform(-1, 1, self.points.shape)
        points = self.points - origin + TOUCHING * self._resolution * shift
        mesh = Delaunay(points[self._chosen])
        triangle, k = np.nonzero(mesh.neighbors > np.arange(len(mesh.simplices))[:, None])
        p, q = (self._chosen[mesh.simplices[triangle, (k + step) % 3]] for step in (1, 2))
        path = self._paths(p, q)
        chord = np.linalg.norm(self.points[p] - self.points[q], axis=1)
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
        scale = 0.5 / cross(u, v)
        x, y = v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu
        return a + np.stack([x * scale, y * scale], axis=1)


def _leaders(width: Floats, label: Ints) -> Ints:
    """Return the thinnest entry of each label."""
    order = np.argsort(width, kind="stable")
    return order[np.unique(label[order], return_index=True)[1]]


def _largest_disc(dot: BaseGeometry, panel: int, resolution: float) -> LocalWidth:
    """Return the diameter of the largest disc in a polygon."""
    radius = shapely.maximum_inscribed_circle(dot, tolerance=resolution / 4)
    centre, border = shapely.get_coordinates(radius)
    return LocalWidth(2 * radius.length, np.stack([2 * centre - border, border]), panel)
