"""A surface in space, modelled or scanned: nearest places, parts at symmetry planes, repair."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree

from toros_fem.base.errors import PatternError, SurfaceError
from toros_fem.base.validation import Floats, Ints, checked_names
from toros_fem.meshes.pattern import (
    FLAT,
    Pattern,
    flip,
    keep_arrays,
    longest_chain,
    plane_border,
    require_indices,
)
from toros_fem.meshes.triangles import (
    between,
    clashing,
    coincident,
    connected_regions,
    edge_keys,
    edges_of,
    half_edges,
    lengths,
    linked,
    normals,
    require_manifold,
    shapes,
    surface_areas,
    surface_components,
)

# Thinner triangles (height over longest edge) spoil every flattening.
MIN_SHAPE = 1e-5
# Points that are looked for at once: each has a list of triangles near to it.
AT_ONCE = 512
# Shares of a corner below this are rounding: a place on an edge is on it.
ROUNDING = 1e-9
# Largest distance between a symmetric surface and its mirror image over the mean edge length: two
# meshes of one round surface are apart by the sagitta of their edges.
SYMMETRIC = 0.1
# Part of an edge from its end within which a plane crosses it at this end.
NEAR = 0.25
# Largest distance of a cut border from a line, over its length, that is straightened.
STRAIGHT = 0.02
# Vertices closer than this fraction of the bounding box's diagonal are merged.
COINCIDENT = 1e-7
# Triangles thinner than this (height over longest edge) are repaired.
THIN = 1e-3
PASSES = 50
# Kinds of repairs, in the words and the order in which they are told.
KINDS = MERGED, DROPPED, COLLAPSED, FLIPPED, REVERSED = (
    "coincident vertices merged", "triangles dropped", "edges collapsed", "edges flipped",
    "triangles reversed",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Surface:
    """One connected, oriented, manifold surface; validated on construction.

    Args:
        points: Vertices, shape (n, 3), in m.
        triangles: Corners of each triangle, shape (t, 3), counter-clockwise seen from outside.
        parts: Number of the part of each triangle, shape (t,), from 0; empty is one part.
            Borders between parts are seams.
        part_names: A name for each part.
        seams: Edges to cut along, pairs of vertices, shape (k, 2).
        repairs: Repairs that were made when it was read, in words.

    Raises:
        SurfaceError: The arrays do not fit together, hold NaN, or the surface is not connected.
        PatternError: It has triangles thinner than `MIN_SHAPE`, an edge of more than two or a
            vertex of several fans of them, neighbours that are oriented differently, or is closed
            and faces inwards.
    """

    points: Floats
    triangles: Ints
    parts: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    part_names: tuple[str, ...] = ()
    seams: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    repairs: str = "none"

    def __post_init__(self) -> None:
        if np.size(self.parts) == 0 and np.ndim(self.triangles) > 0:
            object.__setattr__(self, "parts", np.zeros(len(self.triangles)))
        keep_arrays(
            self, SurfaceError, points=(float, 3), triangles=(int, 3), parts=(int, 0),
            seams=(int, 2),
        )  # fmt: skip
        names = self.part_names
        if isinstance(names, tuple) and not names:
            names = tuple(f"part-{k}" for k in range(1 + int(self.parts.max(initial=0))))
        object.__setattr__(self, "part_names", checked_names("part_names", names, SurfaceError))
        for fault in self._faults():
            raise fault
        remedy = "Reverse one of them; a surface with one side only cannot be sewn."
        require_manifold(self.points, self.triangles, edges_of(self.triangles), remedy)
        if self.closed and volume(self.points, self.triangles) <= 0:
            raise PatternError(
                "the closed surface faces inwards: its volume is not positive. Swap two corners "
                "of every triangle."
            )

    @property
    def area(self) -> float:
        """Area of the surface in m²."""
        return float(surface_areas(self.points, self.triangles).sum())

    @property
    def size(self) -> float:
        """Diagonal of the bounding box in m."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return len(edges_of(self.triangles).border) == 0

    def _faults(self) -> Iterator[SurfaceError | PatternError]:
        n = len(self.points)
        if len(self.triangles) == 0:
            yield SurfaceError("the surface has no triangle.")
        if len(self.parts) != len(self.triangles):
            yield SurfaceError(f"parts has {len(self.parts)} entries, not one for each triangle.")
        require_indices(
            SurfaceError, triangles=(self.triangles, n), seams=(self.seams, n),
            parts=(self.parts, len(self.part_names)),
        )  # fmt: skip
        unused = np.setdiff1d(np.arange(n), self.triangles)
        if len(unused):
            yield SurfaceError(f"vertex {unused[0]} belongs to no triangle.")
        shape = shapes(self.points, self.triangles)
        thin = np.flatnonzero(shape < MIN_SHAPE)
        if len(thin):
            worst = int(np.argmin(shape))
            yield PatternError(
                f"{len(thin)} triangles are thinner than {MIN_SHAPE:g} of their longest edge, the "
                f"worst, {worst}, at {self.points[self.triangles[worst]].mean(axis=0)} m with "
                f"{shape[worst]:.2g}. Remesh the surface."
            )
        label = surface_components(self.triangles)
        if label.max() > 0:
            yield SurfaceError(
                f"the surface has {label.max() + 1} connected components, of "
                f"{np.bincount(label).tolist()} triangles. Give one of them, or connect them."
            )


def holes(surface: Surface) -> str:
    """Return the number of edges around the holes of an open surface, and the largest, in words."""
    edges = edges_of(surface.triangles)
    ends = edges.ends[edges.border]
    used, local = np.unique(ends, return_inverse=True)
    one, two = local.reshape(-1, 2).T
    label = linked(one, two, len(used))
    rims = [surface.points[used[label == k]] for k in range(label.max(initial=-1) + 1)]
    wide = max(rims, key=lambda rim: float(np.ptp(rim, axis=0).max()))
    across, (x, y, z) = np.ptp(wide, axis=0).max(), wide.mean(axis=0)
    count = "a hole" if len(rims) == 1 else f"{len(rims)} holes, the largest"
    return (
        f"{len(ends)} edges have one triangle alone, around {count} of {across:.3g} m at "
        f"({x:.4g}, {y:.4g}, {z:.4g}) m"
    )


def volume(points: Floats, triangles: Ints) -> float:
    """Return the volume in m³ inside a closed oriented surface; negative if it faces inwards."""
    a, b, c = np.moveaxis(points[triangles] - points.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def oriented(triangles: Ints) -> Ints:
    """Reverse triangles (t, 3) to agree with the first one of their connected region.

    At most two triangles may meet at each edge.
    """
    edges, size = edges_of(triangles), len(triangles)
    one, two = edges.sides[edges.inner].T
    clash = np.isin(edges.inner, clashing(triangles, edges))
    # Each triangle is two nodes: unchanged, and reversed (+ size). On a surface with two sides, a
    # node is linked to one of the two nodes of any other triangle.
    rows = np.concatenate([one, one + size])
    cols = np.concatenate([two + size * clash, two + size * ~clash])
    label = linked(rows, cols, 2 * size)
    if np.any(label[:size] == label[size:]):
        k = int(np.argmax(label[:size] == label[size:]))
        raise PatternError(
            f"the surface has one side only around triangle {k}, vertices "
            f"{triangles[k].tolist()}: it has no outside. Cut it, or remove the faces that "
            "connect its two sides."
        )
    region = connected_regions(edges, edges.inner)
    root = np.unique(region, return_index=True)[1][region]
    turned = label[:size] != label[root]
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


# --------------------------------------------------------------------------------- nearest places


@dataclass(frozen=True, eq=False)
class Nearest:
    """Nearest places of some points on a surface.

    Attributes:
        distance: Distance of each point in m, (k,).
        triangle: Number of the triangle that the place is in, (k,).
        shares: Share of each of its corners in the place, (k, 3).
    """

    distance: Floats
    triangle: Ints
    shares: Floats

    def weights(self, triangles: Ints, count: int) -> csr_array:
        """Return the matrix (k, n) that interpolates values at n vertices to the places."""
        rows = np.repeat(np.arange(len(self.triangle)), 3)
        columns = triangles[self.triangle].ravel()
        return csr_array((self.shares.ravel(), (rows, columns)), shape=(len(self.triangle), count))


def nearest(points: Floats, vertices: Floats, triangles: Ints) -> Nearest:
    """Return the places that are nearest to points (k, 3) on triangles (t, 3) between vertices."""
    corners, count = vertices[triangles], len(points)
    found = Nearest(np.full(count, np.inf), np.zeros(count, dtype=np.int64), np.zeros((count, 3)))
    area = float(surface_areas(vertices, triangles).sum())
    size = float(np.sqrt(area / count))
    places, of = _samples(corners, size)
    tree = cKDTree(places)
    for begin in range(0, count, AT_ONCE):
        some = np.arange(begin, min(begin + AT_ONCE, count))
        far = tree.query(points[some])[0] + size
        lists = tree.query_ball_point(points[some], far)
        near = np.concatenate([np.asarray(one, dtype=np.int64) for one in lists])
        pairs = np.repeat(some, [len(one) for one in lists]) * len(triangles) + of[near]
        point, cell = np.divmod(np.unique(pairs), len(triangles))
        _keep_nearest(found, point, cell, points, corners)
    return found


def _samples(corners: Floats, size: float) -> tuple[Floats, Ints]:
    """Return places on triangles (t, 3, 3), and the triangle of each.

    No place of a triangle is further than a size in m from one of these. Triangles are halved until
    they are low enough for a row of places along the longest side.
    """
    pieces, of = corners, np.arange(len(corners))
    places, owners = list[Floats](), list[Ints]()
    while len(pieces):
        sides = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
        order = (sides.argmax(axis=1)[:, None] + np.arange(3)) % 3  # the longest side first
        a, b, c = np.moveaxis(np.take_along_axis(pieces, order[..., None], axis=1), 1, 0)
        length = sides.max(axis=1)
        height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / length
        low = height <= size / 2
        several = np.ceil(length[low] / size).astype(np.int64)
        row = np.repeat(np.flatnonzero(low), several)
        along = np.arange(len(row)) - np.repeat(np.cumsum(several) - several, several)
        part = (along + 0.5) / np.repeat(several, several)
        places.append(a[row] + part[:, None] * (b - a)[row])
        owners.append(of[row])
        a, b, c, of = a[~low], b[~low], c[~low], np.tile(of[~low], 2)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        pieces = np.concatenate(halves)
    return np.concatenate(places), np.concatenate(owners)


def _keep_nearest(found: Nearest, point: Ints, cell: Ints, points: Floats, corners: Floats) -> None:
    """Keep of each point the nearest of some triangles."""
    shares = _shares(points[point], corners[cell])
    place = np.einsum("pk,pki->pi", shares, corners[cell])
    distance = np.linalg.norm(points[point] - place, axis=1)
    order = np.lexsort((distance, point))
    least = order[np.unique(point[order], return_index=True)[1]]
    found.distance[point[least]] = distance[least]
    found.triangle[point[least]] = cell[least]
    found.shares[point[least]] = shares[least]


def _shares(points: Floats, corners: Floats) -> Floats:
    """Return the shares of corners (p, 3, 3) in the places nearest to points (p, 3), (p, 3)."""
    along = np.roll(corners, -1, axis=1) - corners
    away = points[:, None] - corners
    normal = np.cross(along[:, 0], along[:, 1])
    # The side opposite of a corner, and the part of the area beyond it.
    area = np.einsum("psi,pi->ps", np.cross(along, away), normal)
    inside = np.roll(area, -1, axis=1) / np.einsum("pi,pi->p", normal, normal)[:, None]
    way = np.einsum("psi,psi->ps", away, along) / np.einsum("psi,psi->ps", along, along)
    way = np.clip(way, 0, 1)
    side = np.linalg.norm(away - way[..., None] * along, axis=2).argmin(axis=1)
    rows = np.arange(len(points))
    on_side = np.zeros((len(points), 3))
    on_side[rows, side] = 1 - way[rows, side]
    on_side[rows, (side + 1) % 3] = way[rows, side]
    shares = np.where((inside >= 0).all(axis=1)[:, None], inside, on_side)
    shares[shares < ROUNDING] = 0.0
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


# ----------------------------------------------------------------------- parts at symmetry planes


def cut_at_planes(
    surface: Surface, axes: Sequence[int], near: float = NEAR
) -> tuple[Surface, csr_array]:
    """Cut a symmetric surface at coordinate planes x, y or z = 0, given by their axes.

    Triangles that a plane crosses are divided, so that the mesh need not be symmetric. A vertex
    near a crossing, a part `near` of an edge, moves into the plane. `require_symmetric` checks the
    surface before. A part that lies on one side of a plane already is taken as it is. The matrix,
    (m, n), interpolates values at the whole's vertices to those of the part.
    """
    part, weights = surface, csr_array(eye_array(len(surface.points)))
    for axis in axes:
        part, own = _cut(part, axis, FLAT * surface.size, near)
        weights = own @ weights
    return part, weights


def straightened(pattern: Pattern, axes: Sequence[int]) -> Pattern:
    """Return a part's flat panels with straight borders where `mirrored` continues them.

    There a panel is reflected in the line of its longest cut. On a smooth surface the cut is a
    geodesic, and bends by no more than the panel is distorted. A border that is more crooked stays:
    the panel and its image are then sewn together there.
    """
    flat = pattern.flat_points.copy()
    for axis in axes:
        border = np.sort(plane_border(pattern, axis))
        edges, panel = half_edges(pattern.flat_triangles)[border], pattern.panel[border // 3]
        for number in np.unique(panel):
            chain = longest_chain(flat, edges[panel == number])
            vertices, count = np.unique(chain, return_counts=True)
            if np.count_nonzero(count == 1) != 2:
                continue  # a loop
            begin, end = flat[vertices[count == 1]]
            length = np.linalg.norm(end - begin)
            arm = flat[vertices] - begin
            on_line = np.outer(arm @ (end - begin), end - begin) / length**2
            if np.linalg.norm(arm - on_line, axis=1).max() <= STRAIGHT * length:
                flat[vertices] = begin + on_line
    return replace(pattern, flat_points=flat)


def asymmetry(surface: Surface, axis: int) -> float:
    """Return the largest distance in m of a mirrored vertex from the surface."""
    image = surface.points * flip(axis)
    return float(nearest(image, surface.points, surface.triangles).distance.max())


def require_symmetric(surface: Surface, axis: int, what: str = "the surface") -> None:
    """Check that a surface is its own mirror image in the plane x, y or z = 0, or half of one."""
    if surface.points[:, axis].min() >= -FLAT * surface.size and not surface.closed:
        return
    edge = float(lengths(surface.points, edges_of(surface.triangles).ends).mean())
    off = asymmetry(surface, axis)
    if off > SYMMETRIC * edge:
        name = "xyz"[axis]
        raise SurfaceError(
            f"{what} is not symmetric about {name} = 0: a mirrored vertex is {off:.3g} m away "
            f"from it; the bound is {SYMMETRIC:g} of the mean edge length, {SYMMETRIC * edge:.3g} "
            f"m. Move the mesh so that {name} = 0 is its middle, or leave this plane out."
        )


def _cut(surface: Surface, axis: int, flat: float, near: float) -> tuple[Surface, csr_array]:
    """Cut at one plane."""
    points, triangles, count = surface.points, surface.triangles, len(surface.points)
    away = np.where(np.abs(points[:, axis]) <= flat, 0.0, points[:, axis])
    # A vertex near a crossing moves into the plane, and has the values of the nearest crossing.
    ends, part = _crossings(triangles, away)
    to, fraction = np.arange(count), np.zeros(count)
    order = np.argsort(-np.minimum(part, 1 - part), kind="stable")
    for (a, b), at in zip(ends[order], part[order], strict=True):
        if min(at, 1 - at) < near:
            mover, other = (a, b) if at < near else (b, a)
            to[mover], fraction[mover], away[mover] = other, min(at, 1 - at), 0.0
    # Other crossings become vertices.
    ends, part = _crossings(triangles, away)
    number = {(int(a), int(b)): count + k for k, (a, b) in enumerate(ends)}
    one, two = np.append(np.arange(count), ends[:, 0]), np.append(to, ends[:, 1])
    share = np.append(fraction, part)
    weights = csr_array(
        (np.append(1 - share, share), (np.tile(np.arange(len(one)), 2), np.append(one, two))),
        shape=(len(one), count),
    )
    placed = np.concatenate([points, (weights @ points)[count:]])
    placed[np.append(away == 0, np.ones(len(ends), dtype=bool)), axis] = 0.0
    sides = away[triangles]
    kept = np.flatnonzero((sides >= 0).all(axis=1) & (sides > 0).any(axis=1))
    cells, corners = list(kept), list(triangles[kept])
    for cell in np.flatnonzero((sides.min(axis=1) < 0) & (sides.max(axis=1) > 0)):
        pieces = _pieces(triangles[cell], away, number, placed)
        cells += [cell] * len(pieces)
        corners += pieces
    used, made = np.unique(np.array(corners), return_inverse=True)
    seams = [
        pair
        if away[pair].min() >= 0
        else (pair[np.argmax(away[pair])], number[tuple(sorted(pair))])
        for pair in surface.seams
        if away[pair].max() > 0
    ]
    names, parts = np.unique(surface.parts[cells], return_inverse=True)
    half = Surface(
        placed[used],
        made.reshape(-1, 3),
        parts,
        tuple(surface.part_names[k] for k in names),
        np.searchsorted(used, np.array(seams, dtype=np.int64).reshape(-1, 2)),
        surface.repairs,
    )
    return half, weights[used]


def _crossings(triangles: Ints, away: Floats) -> tuple[Ints, Floats]:
    """Return the edges that a plane crosses, (k, 2), and where, as parts of their lengths, (k,)."""
    ends = edges_of(triangles).ends
    ends = ends[away[ends].prod(axis=1) < 0]
    return ends, away[ends[:, 0]] / (away[ends[:, 0]] - away[ends[:, 1]])


def _pieces(
    triangle: Ints, away: Floats, number: Mapping[tuple[int, int], int], points: Floats
) -> list[Ints]:
    """Return the one or two triangles on the far side of a plane that a triangle is cut at."""
    found: list[int] = []
    for a, b in zip(triangle, np.roll(triangle, -1), strict=True):
        found += [a] if away[a] >= 0 else []
        found += [number[min(a, b), max(a, b)]] if away[a] * away[b] < 0 else []
    if len(found) == 3:
        return [np.array(found)]
    a, b, c, d = found
    if np.linalg.norm(points[a] - points[c]) < np.linalg.norm(points[b] - points[d]):
        return [np.array([a, b, c]), np.array([a, c, d])]
    return [np.array([a, b, d]), np.array([b, c, d])]


# ----------------------------------------------------------------------------------------- repair


def weld(points: Floats, triangles: Ints, near: float = COINCIDENT) -> tuple[Ints, Ints]:
    """Merge vertices (n, 3) at the same place, within a fraction of the size.

    Returned are for each vertex the one that replaces it, (n,), and the indices of the triangles
    that are kept: those with three different corners, each set of corners once.
    """
    reach = near * float(np.linalg.norm(np.ptp(points, axis=0)))
    place = coincident(points, reach)
    replaced_by = np.unique(place, return_index=True)[1][place]
    corners = np.sort(replaced_by[triangles], axis=1)
    first = np.unique(corners, axis=0, return_index=True)[1]
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    return replaced_by, np.sort(first[proper[first]])


def remove_thin(
    points: Floats, triangles: Ints, parts: Ints, kept: Ints
) -> tuple[Floats, Ints, Ints, Ints, Counter[str]]:
    """Remove triangles thinner than `THIN`, where that is simple.

    A needle's short edge is collapsed. A cap's long edge is flipped; where that edge is a border,
    the cap is dropped. The surface moves by less than `THIN` of the longest edge. A triangle
    is not changed if its repair would change the topology, fold the surface over or move a kept
    edge, one of `kept`, (k, 2), or between parts.

    Returned are points (n, 3), triangles and parts, the vertex that replaces each old one, (n,),
    and the numbers of repairs.
    """
    points, triangles = points.copy(), triangles.copy()
    replaced_by = np.arange(len(points))
    repairs: Counter[str] = Counter()
    for _ in range(PASSES):
        work = _Pass(points, triangles, parts, replaced_by[kept])
        done = work.run()
        if not done:
            break
        repairs += done
        triangles, parts = triangles[~work.gone], parts[~work.gone]
        replaced_by = work.replaced_by[replaced_by]
    return points, triangles, parts, replaced_by, repairs


class _Pass:
    """One pass over the thin triangles, the worst first.

    After a repair, its neighbourhood is not changed again in this pass.
    """

    def __init__(self, points: Floats, triangles: Ints, parts: Ints, kept: Ints) -> None:
        self.points, self.triangles, self.parts = points, triangles, parts
        self.edges = edges_of(triangles)
        self.gone = np.zeros(len(triangles), dtype=bool)
        self.replaced_by = np.arange(len(points))
        self.locked = np.zeros(len(points), dtype=bool)
        ends, size = self.edges.ends, len(points)
        named = np.isin(edge_keys(ends, size), edge_keys(kept, size))
        self.fixed_edge = between(self.edges, parts) | named | (self.edges.count == 1)
        self.fixed = np.zeros(size, dtype=bool)
        self.fixed[ends[self.fixed_edge]] = True
        self.at_border = np.zeros(size, dtype=bool)
        self.at_border[ends[self.edges.border]] = True
        self.order = np.argsort(triangles.ravel(), kind="stable")
        self.start = np.searchsorted(triangles.ravel()[self.order], np.arange(size + 1))

    def run(self) -> Counter[str]:
        """Repair each thin triangle once; return the numbers of repairs."""
        done: Counter[str] = Counter()
        shape = shapes(self.points, self.triangles)
        bad = np.flatnonzero(shape < THIN)
        for t in bad[np.argsort(shape[bad], kind="stable")]:
            corners = self.triangles[t]
            near = np.unique(self.triangles[np.concatenate([self.star(v) for v in corners])])
            if self.gone[t] or self.locked[near].any():
                continue
            side = np.linalg.norm(self.points[np.roll(corners, -1)] - self.points[corners], axis=1)
            short, long = int(np.argmin(side)), int(np.argmax(side))
            apex = corners[(long + 2) % 3]
            if side[short] < 2 * THIN * side[long] and self.collapse(t, short):
                done[COLLAPSED] += 1
            elif self.drop(t, long, apex):
                done[DROPPED] += 1
            elif self.flip(t, long, apex):
                done[FLIPPED] += 1
            else:
                continue
            self.locked[near] = True
        return done

    def star(self, vertex: int) -> Ints:
        """Return the triangles around a vertex."""
        return self.order[self.start[vertex] : self.start[vertex + 1]] // 3

    def drop(self, t: int, edge: int, apex: int) -> bool:
        """Drop a triangle at a border edge, if the surface stays connected there."""
        alone = self.edges.count[self.edges.of_triangle[t]] == 1
        # With its apex on the border too, it connects its two neighbours, unless it has only one.
        if not alone[edge] or (self.at_border[apex] and alone.sum() != 2):
            return False
        self.gone[t] = True
        return True

    def flip(self, t: int, edge: int, apex: int) -> bool:
        """Flip an edge, if both new triangles are less thin and nothing folds over."""
        number = self.edges.of_triangle[t, edge]
        if self.fixed_edge[number]:
            return False
        one, two = self.edges.sides[number]
        other = one if two == t else two
        a, b = self.triangles[t, edge], self.triangles[t, (edge + 1) % 3]
        far = int(self.triangles[other].sum() - a - b)
        if np.any(self.triangles[self.star(far)] == apex):
            return False
        new = np.array([[a, far, apex], [far, b, apex]])
        if shapes(self.points, new).min() < 2 * shapes(self.points, self.triangles[[t]])[0]:
            return False
        if np.any(normals(self.points, new) @ normals(self.points, self.triangles[[other]])[0] < 0):
            return False
        self.triangles[[t, other]] = new
        return True

    def collapse(self, t: int, edge: int) -> bool:
        """Merge the ends of an edge, unless topology, a fold or a kept edge forbids it."""
        number = self.edges.of_triangle[t, edge]
        a, b = (int(v) for v in self.edges.ends[number])
        fixed = self.fixed[[a, b]]
        if fixed.all() and not self.fixed_edge[number]:
            return False
        common = np.intersect1d(self.triangles[self.star(a)], self.triangles[self.star(b)])
        if len(common) != 2 + self.edges.count[number]:
            return False
        stays, goes = (b, a) if fixed[1] and not fixed[0] else (a, b)
        ring = np.union1d(self.star(a), self.star(b))
        lost = ring[np.isin(self.triangles[ring], [a, b]).sum(axis=1) == 2]
        ring = np.setdiff1d(ring, lost)
        old = self.triangles[ring]
        new = np.where(old == goes, stays, old)
        moved = self.points.copy()
        if not fixed.any():
            moved[stays] = self.points[[a, b]].mean(axis=0)
        before, after = normals(self.points, old), normals(moved, new)
        proper = shapes(self.points, old) > THIN
        if np.any((np.einsum("ij,ij->i", before, after) <= 0) & proper):
            return False
        self.points[stays], self.triangles[ring] = moved[stays], new
        self.gone[lost] = True
        self.replaced_by[goes] = stays
        return True
