"""Contours of the density as polygons on the flat panels, curves along them, and their widths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.meshes.panels import polygons_of, runs_of_ring
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import cross, linked

# Two borders closer than this fraction of the resolution are the same.
TOUCHING = 1e-3
# Corners of a quarter of a circle.
QUARTER = 10
# A change of a part of a border, points (n, 2), that is a whole ring or a run between fixed ends.
Change = Callable[[Floats, bool], Floats]
# Values this close to the threshold count as equal to it, so that the contour passes through the
# vertex. Otherwise rounding would merge corners of very thin polygons.
SNAP = 1e-9
# Distance of points on a smooth curve, over the smoothing length.
STEP = 1 / 6
# A ring shorter than this many smoothing lengths stays as it is: it would shrink.
SHORTEST = 6.0
# Borders closer than this fraction of the smoothing length are the same.
ON_OUTLINE = 1e-6
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


def solid(shape: BaseGeometry, resolution: float) -> BaseGeometry:
    """Return the polygons of a shape without slivers of rounding, lines and points.

    The resolution is the distance in m of the samples that widths are measured by.
    """
    apart = TOUCHING * resolution
    thick = shape.buffer(-apart, join_style="mitre").buffer(2 * apart, join_style="mitre")
    return shapely.MultiPolygon(list(polygons_of(shape.intersection(thick))))


def fabric_of(region: BaseGeometry, outline: BaseGeometry, resolution: float) -> BaseGeometry:
    """Return the part of a panel that is not printed, as `solid` does."""
    return solid(outline.difference(region), resolution)


def opened(region: BaseGeometry, radius: float) -> BaseGeometry:
    """Return the union of all discs of a radius that lie in a region."""
    return region.buffer(-radius, quad_segs=QUARTER).buffer(radius, quad_segs=QUARTER)


def pieces_and_holes(region: BaseGeometry) -> tuple[int, int]:
    """Return the number of pieces of a region, and of all their holes."""
    pieces = [piece for piece in shapely.get_parts(region) if not piece.is_empty]
    return len(pieces), sum(len(piece.interiors) for piece in pieces)


def even_odd(rings: Iterable[Floats]) -> BaseGeometry:
    """Return the region inside an odd number of rings, points (n, 2) each.

    Those of two points, to which slivers are simplified, have no inside.
    """
    wide = [ring for ring in rings if len(ring) > 2]
    shapes = [shapely.make_valid(shapely.Polygon(ring), method="structure") for ring in wide]
    return reduce(shapely.symmetric_difference, shapes, shapely.Polygon())


def changed_border(
    region: BaseGeometry, outline: BaseGeometry, near: float, change: Change
) -> BaseGeometry:
    """Return a region in a panel with another border, but where that is the panel's own.

    Points closer than `near`, in m, to the outline lie on it.
    """
    cut = outline.boundary
    shapely.prepare(cut)
    rings = shapely.get_rings(shapely.get_parts(region))
    return even_odd(
        _changed_ring(shapely.get_coordinates(ring)[:-1], cut, near, change) for ring in rings
    )


def simplified(
    region: BaseGeometry, outline: BaseGeometry, near: float, distance: float
) -> BaseGeometry:
    """Return a region with fewer corners, as of `changed_border`; it moves by a distance in m."""

    def change(points: Floats, closed: bool) -> Floats:
        line = shapely.LinearRing(points) if closed else shapely.LineString(points)
        found = shapely.get_coordinates(line.simplify(distance))
        return found[:-1] if closed else found

    return changed_border(region, outline, near, change)


def _changed_ring(points: Floats, cut: BaseGeometry, near: float, change: Change) -> Floats:
    """Return the points of a ring (n, 2), changed where it is off the cut."""
    runs = runs_of_ring(points, cut, near)
    if runs is None:
        return change(points, True)
    return np.concatenate([(change(run, False) if off else run)[:-1] for run, off in runs])


def printed_regions(
    pattern: Pattern, at_points: Floats, at_centroids: Floats, threshold: float
) -> list[BaseGeometry]:
    """Return the printed region of each panel, where the density exceeds the threshold η.

    Each triangle is split into three at its centroid. The density is linear on each third, so that
    the values ρ̃ at flat points, (m,), and at centroids, (t,), are met exactly.
    """
    count = len(pattern.flat_points)
    points = np.concatenate([pattern.flat_points, pattern.centroids])
    value = np.concatenate([at_points, at_centroids]) - threshold
    value[np.abs(value) < SNAP] = 0
    panels = [np.flatnonzero(pattern.panel == k) for k in range(len(pattern.panel_names))]
    return [_positive(points, value, pattern.flat_triangles[k], count + k) for k in panels]


def _positive(points: Floats, value: Floats, corner: Ints, centre: Ints) -> BaseGeometry:
    """Return where values are positive, of triangles by their corners (t, 3) and centroids (t,)."""
    centre = centre[:, None]
    whole = np.all(value[corner] > 0, axis=1) & (value[centre[:, 0]] > 0)
    thirds = np.stack([corner, np.roll(corner, -1, axis=1), np.repeat(centre, 3, axis=1)], axis=2)
    third = thirds[~whole].reshape(-1, 3)
    inside = value[third] > 0
    below = np.any(value[third] < 0, axis=1)
    corners = [
        points[corner[whole]],
        points[third[inside.any(axis=1) & ~below]],
        *_cut(points, value, third[inside.any(axis=1) & below]),
    ]
    polygons = np.concatenate(
        [shapely.polygons(c) for c in corners if len(c)] or [np.empty(0, object)]
    )
    return shapely.coverage_union_all(polygons)


def _cut(points: Floats, value: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Return the positive parts of triangles with values of both signs, (k, 3, 2) and (l, 4, 2)."""
    inside = value[triangles] > 0
    lone = inside.sum(axis=1) == 1
    apart = np.argmax(inside == lone[:, None], axis=1)  # the corner alone on its side
    order = (apart[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order, axis=1).T
    ab, ac = _crossing(points, value, a, b), _crossing(points, value, a, c)
    tips = np.stack([points[a], ab, ac], axis=1)[lone]
    return tips, np.stack([ab, points[b], points[c], ac], axis=1)[~lone]


def _crossing(points: Floats, value: Floats, a: Ints, b: Ints) -> Floats:
    """Return where edges cross 0; the same to rounding from both sides, exact at a vertex of 0."""
    outer, inner = np.where(value[a] > 0, [b, a], [a, b])
    fraction = value[outer] / (value[outer] - value[inner])
    return points[outer] + fraction[:, None] * (points[inner] - points[outer])


def smoothed(region: BaseGeometry, outline: BaseGeometry, length: float) -> BaseGeometry:
    """Return a region whose border, where it is not that of its panel, is a smooth curve.

    Points along the border are averaged with a Gaussian weight, whose standard deviation is the
    length in m, twice as 2 G − G²: waves shorter than about twice the length vanish, those longer
    than eight times it keep 99 % of their height, so that lines neither shrink nor part. Ends on
    the border of the panel stay.
    """

    def smooth(points: Floats, closed: bool) -> Floats:
        if not closed:
            return _averaged(_even(points, length), closed=False)
        ring = np.concatenate([points, points[:1]])
        if shapely.length(shapely.linestrings(ring)) < SHORTEST * length:
            return points
        return _averaged(_even(ring, length)[:-1], closed=True)

    found = changed_border(region, outline, ON_OUTLINE * length, smooth)
    parts = polygons_of(found.intersection(outline))
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(list(parts))


def _even(line: Floats, length: float) -> Floats:
    """Return points at equal distances along a line, both ends included."""
    curve = shapely.linestrings(line)
    count = max(2, int(np.ceil(curve.length / (STEP * length))))
    return shapely.get_coordinates(
        shapely.line_interpolate_point(curve, np.linspace(0, 1, count + 1), normalized=True)
    )


def _averaged(points: Floats, *, closed: bool) -> Floats:
    """Return evenly spaced points (n, 2), averaged along a ring or between fixed ends."""
    ends, beyond = points[[0, -1]], 0 if closed else len(points) - 1
    mode = "wrap" if closed else "nearest"
    # An odd continuation at both ends keeps them.
    longer = np.pad(points, ((beyond, beyond), (0, 0)), "reflect", reflect_type="odd")
    once = gaussian_filter1d(longer, 1 / STEP, axis=0, mode=mode)
    twice = np.asarray(2 * once - gaussian_filter1d(once, 1 / STEP, axis=0, mode=mode))
    found = twice[beyond : beyond + len(points)]
    if not closed:
        found[[0, -1]] = ends
    return found


# ----------------------------------------------------------------------- widths of lines and gaps


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
