"""How wide the lines of a printed region are, and how wide the gaps between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Bools, Floats, Ints

# Two sides face each other if the way from one to the other along the border is longer than this
# many times their distance and the limit. For a wedge the ratio is cot(angle/2): corners, notches
# and junctions blunter than 28° are not taken for narrow lines, nor is a line's end.
FACING = 4.0
# Two borders closer than this share of the resolution are the same.
TOUCHING = 1e-3


@dataclass(frozen=True)
class Place:
    """Where a line or a gap is locally thinnest.

    Attributes:
        width: Diameter in m of the largest disc that fits between the two sides there.
        ends: The points on either side where the disc touches, in m on the flat panel.
        panel: Number of the panel.
    """

    width: float
    ends: tuple[tuple[float, float], tuple[float, float]]
    panel: int

    @property
    def middle(self) -> tuple[float, float]:
        """Half way between the ends, in m."""
        (ax, ay), (bx, by) = self.ends
        return (ax + bx) / 2, (ay + by) / 2


class Thin(NamedTuple):
    """The thinnest place of all (None: there are no facing sides), and those under a limit."""

    smallest: Place | None
    under: tuple[Place, ...]


class _Samples(NamedTuple):
    """Points along the print's border, then along the panel's (whose ring is −1)."""

    points: Floats
    ring: Ints
    arc: Floats  # way along the ring
    length: Floats  # of the whole ring
    free: Bools  # on the print's border, and not where the panel is cut


class _Pairs(NamedTuple):
    """Facing samples, and the smallest empty disc through both."""

    ends: Ints
    way: Floats  # between them along the border, infinite between rings
    width: Floats
    centre: Floats

    def select(self, kept: Bools) -> _Pairs:
        return _Pairs(self.ends[kept], self.way[kept], self.width[kept], self.centre[kept])


def measure_widths(
    region: BaseGeometry,
    outline: BaseGeometry,
    panel: int,
    width_limit: float,
    gap_limit: float,
    resolution: float,
) -> tuple[Thin, Thin]:
    """Widths of lines, and of the gaps between them, on one panel.

    The border is sampled densely. A disc that touches two samples and holds none is inscribed;
    it measures a width where its centre is printed and a gap where it is bare cloth, provided that
    the two touch facing sides: different rings, or parts of a ring that lie far apart along it.
    The panel's own border stops discs but is no side. A piece or hole without facing sides, such
    as a dot, is as wide as the largest disc in it; a piece cut by the panel's border has no width
    then.

    Args:
        region: What is printed, polygons in m.
        outline: The panel.
        panel: Its number, for the places.
        width_limit, gap_limit: Places thinner than this are listed, in m. Line ends and bumps
            that stand out less than about twice the limit have no width of their own.
        resolution: Distance of samples in m; results are this good or better.

    Returns:
        Widths and gaps.
    """
    rings, part = shapely.get_rings(shapely.get_parts(region), return_index=True)
    if not len(rings):
        return Thin(None, ()), Thin(None, ())
    samples = _sample(rings, outline.boundary, resolution)
    shapely.prepare([region, outline])
    touched = np.zeros(len(rings), dtype=bool)
    touched[samples.ring[~samples.free & (samples.ring >= 0)]] = True
    hole = np.concatenate([[False], part[1:] == part[:-1]])
    facing = _facing(samples, resolution)
    facing = facing.select(shapely.contains_xy(outline, facing.centre))
    inside = shapely.contains_xy(region, facing.centre)
    found = []
    for printed, limit in ((True, width_limit), (False, gap_limit)):
        pairs = facing.select((inside == printed) & (facing.way > FACING * limit))
        measured = samples.ring[pairs.ends].ravel()
        if printed:
            done = np.union1d(part[measured], part[touched])
            blobs = shapely.get_parts(region)[np.setdiff1d(part, done)]
        else:
            bare = np.flatnonzero(hole & ~touched)
            blobs = shapely.polygons(rings[np.setdiff1d(bare, measured)])
        enough = limit - TOUCHING * resolution  # as wide as the limit, but for rounding
        places = [
            _place(samples.points[ends[0]], samples.points[ends[1]], width, panel)
            for ends, width in _thinnest(samples, pairs, enough)
        ]
        places += [_largest_disc(blob, panel, resolution) for blob in blobs]
        places.sort(key=lambda place: place.width)
        under = tuple(place for place in places if place.width < enough)
        found.append(Thin(places[0] if places else None, under))
    return found[0], found[1]


def _sample(rings: npt.NDArray[np.object_], cut: BaseGeometry, resolution: float) -> _Samples:
    dense, ring = shapely.get_coordinates(shapely.segmentize(rings, resolution), return_index=True)
    last = np.append(ring[1:] != ring[:-1], True)  # a ring's last point repeats its first
    step = np.where(last[:-1], 0, np.linalg.norm(np.diff(dense, axis=0), axis=1))
    way = np.concatenate([[0], np.cumsum(step)])
    first = np.concatenate([[True], last[:-1]])
    arc, length = way - way[first][ring], (way[last] - way[first])[ring]
    shapely.prepare(cut)
    free = ~shapely.dwithin(cut, shapely.points(dense), TOUCHING * resolution)
    border = shapely.get_coordinates(shapely.segmentize(cut, resolution))
    none = np.zeros(len(border))
    return _Samples(
        np.concatenate([dense[~last], border]),
        np.concatenate([ring[~last], none.astype(np.int64) - 1]),
        np.concatenate([arc[~last], none]),
        np.concatenate([length[~last], none]),
        np.concatenate([free[~last], none > 0]),
    )


def _facing(samples: _Samples, resolution: float) -> _Pairs:
    """Pairs of samples on facing sides joined by an edge of the Delaunay triangulation.

    The discs through a pair that hold no other sample have their centres on the edge's Voronoi
    dual. The smallest has the pair as its diameter if its centre is there, else it is the smaller
    one of the two circumscribed discs of the edge's triangles.
    """
    origin = samples.points.mean(axis=0)
    # Straight borders and round panels make many samples lie on common circles, which slows
    # Qhull down by an order of magnitude or two: shift them a little.
    shift = np.random.default_rng(0).uniform(-1, 1, samples.points.shape)
    mesh = Delaunay(samples.points - origin + TOUCHING * resolution * shift)
    triangle, k = np.nonzero(mesh.neighbors > np.arange(len(mesh.simplices))[:, None])
    p, q = (mesh.simplices[triangle, (k + step) % 3] for step in (1, 2))
    way = np.abs(samples.arc[p] - samples.arc[q])
    way = np.minimum(way, samples.length[p] - way)
    way[samples.ring[p] != samples.ring[q]] = np.inf
    modified = np.linalg.norm(samples.points[p] - samples.points[q], axis=1)
    kept = samples.free[p] & samples.free[q] & (way > FACING * modified)
    triangle, k, p, q, way, modified = (a[kept] for a in (triangle, k, p, q, way, modified))
    start, end = mesh.points[p], mesh.points[q]
    one = _circumcentres(mesh.points[mesh.simplices[triangle]])
    two = _circumcentres(mesh.points[mesh.simplices[mesh.neighbors[triangle, k]]])
    middle = (start + end) / 2
    radii = [np.linalg.norm(centre - start, axis=1) for centre in (one, two)]
    between = np.einsum("ij,ij->i", one - middle, two - middle) <= 0
    nearer = np.where((radii[0] <= radii[1])[:, None], one, two)
    width = np.where(between, modified, np.maximum(modified, 2 * np.minimum(*radii)))
    centre = np.where(between[:, None], middle, nearer) + origin
    pairs = _Pairs(np.stack([p, q], axis=1), way, width, centre)
    return pairs.select((way > FACING * width) & np.isfinite(width))


def _circumcentres(corners: Floats) -> Floats:
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    uu, vv = np.sum(u * u, axis=1), np.sum(v * v, axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 0.5 / (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        x, y = v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu
        return a + np.stack([x * scale, y * scale], axis=1)


def _thinnest(samples: _Samples, pairs: _Pairs, limit: float) -> list[tuple[Ints, float]]:
    """The thinnest pair of all, and of each connected stretch of pairs under the limit."""
    if not len(pairs.width):
        return []
    thin = np.flatnonzero(pairs.width < limit)
    if not len(thin):
        thin = np.array([np.argmin(pairs.width)])
    ends, width = pairs.ends[thin], pairs.width[thin]
    best = _leaders(width, _components(ends, len(samples.points))[ends[:, 0]])
    # Noise about the limit must not make many places of one.
    middles = samples.points[ends[best]].mean(axis=1)
    near = cKDTree(middles).query_pairs(limit, output_type="ndarray")
    best = best[_leaders(width[best], _components(near, len(best)))]
    return [(ends[k], float(width[k])) for k in best]


def _components(links: Ints, count: int) -> Ints:
    """Label of each of `count` nodes, the same for those that links, (k, 2), connect."""
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _leaders(width: Floats, label: Ints) -> Ints:
    """The thinnest entry of each label."""
    order = np.argsort(width, kind="stable")
    return order[np.unique(label[order], return_index=True)[1]]


def _largest_disc(blob: BaseGeometry, panel: int, resolution: float) -> Place:
    radius = shapely.maximum_inscribed_circle(blob, tolerance=resolution / 4)
    centre, border = shapely.get_coordinates(radius)
    return _place(2 * centre - border, border, 2 * radius.length, panel)


def _place(one: Floats, two: Floats, width: float, panel: int) -> Place:
    return Place(
        float(width), ((float(one[0]), float(one[1])), (float(two[0]), float(two[1]))), panel
    )
