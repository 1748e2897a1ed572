"""Layers of a sheet: which of its vertices may touch, and layers that are moved apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.mechanics.contact.bodies import collision_mesh, ipctk, patches_apart
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import cross, dihedral_angles, following, normals

# Paths in the sheet, over its thickness. Two points of a folded sheet that are one thickness apart
# have a path of π/2 of it between them: vertices within FOLDED are neighbours, and all vertices of
# faces and edges within ADJACENT.
FOLDED, ADJACENT = 2.0, 1.6
# The same over the reach of contact: what is nearer touches in the flat sheet already.
FLAT = 1.1
# Distance from which neighbours touch, over the smallest height of a triangle.
HEIGHT = 0.1
# Smallest angle in rad of a view along the sheet: what is left beside a vertex is rounding.
VIEW = 1e-6
# Angle between the normals of two triangles in rad from which on their edge is a fold.
FOLD = 0.75 * np.pi
# Cosine between the normals of two layers that face each other.
OPPOSITE = -0.5
# Slopes of the layers at a fold, tried in this order.
SLOPES = (0.4, 0.5, 0.6, 0.7, 0.8)
# Distance of opened layers over the reach of contact, which hardly acts on them; tried in turn.
# More is for coarse meshes, where a triangle with three corners on folds stays where it is.
APART = (1.05, 2.1, 4.2)
# Distance of faces over that of contact with which an opened shape is taken at once. Faces much
# nearer than that repel each other so much that the first steps are small.
LEAST = 0.25
# Spacing of places along a fold, from which distances are measured, over the thickness.
SPACING = 0.1
# Relative size of a distance's rounding.
ROUNDING = 1e-6


@dataclass(frozen=True)
class ContactSizes:
    """Numbers of a contact, all given.

    Attributes:
        thickness, distance, slip: In m, as of `Contact`.
        stiffness: In Pa.
    """

    thickness: float
    distance: float
    stiffness: float
    slip: float

    @property
    def reach(self) -> float:
        """Distance in m of middle surfaces from which on contact acts."""
        return self.thickness + self.distance


def opened(pattern: Pattern, sizes: ContactSizes, in_planes: Bools | None = None) -> Floats:
    """Return positions of all vertices, (n, 3), in m, from which contact can act.

    Layers that lie on each other are moved apart along their normals, by a parabola of the distance
    from the folds between them, until the reach of contact is between their middle surfaces; a
    ParameterError is raised if they cannot be. A skin whose layers are apart as assembled keeps its
    positions. Vertices stay `in_planes`, (n, 3), the symmetry planes across x, y or z in which they
    lie.
    """
    mesh = skin_mesh(pattern, sizes)
    directions = _vertex_normals(pattern)
    # The check takes long where all layers lie on each other.
    if not _layered(pattern, directions, sizes.thickness):
        found = check_start(mesh, pattern.points, sizes.thickness)
        if found.admissible:
            return pattern.points.copy()
    if in_planes is not None:
        directions[in_planes] = 0.0
    clear = LEAST * sizes.distance
    best, widest = pattern.points, 0.0
    for apart, slope in product(APART, SLOPES):
        height = apart * sizes.reach / 2
        width = 2 * height / slope
        rest = 1.0 - _from_folds(pattern, width, SPACING * sizes.thickness) / width
        positions = pattern.points + (height * (1.0 - rest**2))[:, None] * directions
        found = check_start(mesh, positions, sizes.thickness, distance=clear)
        if found.admissible and found.distance > widest:
            best, widest = positions, found.distance
        if widest >= clear:
            break
    if widest > 0:
        return best
    raise ParameterError(
        "the layers of the assembled skin cannot be moved apart for contact: "
        f"{found.sentence(pattern, positions)}, where middle surfaces must be more than "
        f"{1e3 * sizes.thickness:.4g} mm apart. Assemble the skin with its layers apart, give "
        "Contact a smaller thickness, or remesh it there with edges of one length."
    )


def skin_mesh(pattern: Pattern, sizes: ContactSizes) -> Any:
    """Return the `ipctk.CollisionMesh` of a skin alone, without its neighbours in the sheet."""
    may_touch = leaving_out(neighbours(pattern, sizes))
    return collision_mesh(pattern.points, pattern.triangles, may_touch)


def _layered(pattern: Pattern, directions: Floats, thickness: float) -> bool:
    """Return whether layers with opposite normals are nearer than a thickness, far from folds."""
    inner = np.flatnonzero(_from_folds(pattern, 2 * thickness, thickness) > thickness)
    pairs = inner[cKDTree(pattern.points[inner]).query_pairs(thickness, output_type="ndarray")]
    one, two = directions[pairs[:, 0]], directions[pairs[:, 1]]
    return bool((np.einsum("ij,ij->i", one, two) < OPPOSITE).any())


def _from_folds(pattern: Pattern, most: float, spacing: float) -> Floats:
    """Return the distance of each vertex from the nearest fold in m, (n,), at most a given one."""
    angles = dihedral_angles(pattern.points, pattern.triangles, pattern.edges)
    ends = pattern.edges.ends[angles > FOLD]
    away = np.full(len(pattern.points), most)
    if len(ends):
        begin, end = pattern.points[ends].transpose(1, 0, 2)
        parts = np.ceil(np.linalg.norm(end - begin, axis=1) / spacing).astype(np.int64) + 1
        first = np.cumsum(parts) - parts
        share = (np.arange(parts.sum()) - np.repeat(first, parts)) / np.repeat(parts - 1, parts)
        edge = np.repeat(np.arange(len(ends)), parts)
        places = begin[edge] + share[:, None] * (end - begin)[edge]
        found, _ = cKDTree(places).query(pattern.points, distance_upper_bound=most)
        away = np.minimum(found, most)
        away[ends] = 0.0
    return away


def _vertex_normals(pattern: Pattern) -> Floats:
    """Return unit normals of the vertices, (n, 3), zero where those of the triangles cancel."""
    each = normals(pattern.points, pattern.triangles)
    corner, count = pattern.triangles.ravel(), len(pattern.points)
    total = np.column_stack([np.bincount(corner, np.repeat(v, 3), count) for v in each.T])
    length = np.linalg.norm(total, axis=1)[:, None]
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


@dataclass(frozen=True)
class StartCheck:
    """Where faces are nearest to each other, or surfaces cross.

    Attributes:
        admissible: Whether contact can act: no surface crosses another, and faces are apart.
        distance: Smallest distance of two faces in m; negative where sheets overlap, infinite where
            none is below the one that was asked for.
        vertices: Vertices of the collision mesh that are nearest, or of an edge and a triangle that
            cross. Empty where the start is admissible.
        crossing: Whether they cross.
        ground: Whether the one vertex is too near to the ground, or in it.
    """

    admissible: bool
    distance: float
    vertices: tuple[int, ...] = ()
    crossing: bool = False
    ground: bool = False

    def sentence(self, pattern: Pattern, positions: Floats, bodies: Sequence[str] = ()) -> str:
        """Return the worst place in words.

        `bodies` names the body of each vertex that follows those of the skin.
        """
        listed = list(self.vertices)
        place = ", ".join(f"{1e3 * v:.4g}" for v in positions[listed].mean(axis=0))
        skin = [v for v in listed if v < len(pattern.points)]
        near = np.isin(pattern.triangles, skin).any(axis=1)
        touching = [pattern.panel_names[k] for k in np.unique(pattern.panel[near])]
        touching += sorted({bodies[v - len(pattern.points)] for v in listed if v not in skin})
        parts = " and ".join(map(repr, touching)) + (" and the ground" if self.ground else "")
        where = f"at vertices {listed} of {parts}, near ({place}) mm"
        if self.crossing:
            return f"surfaces cross {where}"
        if self.distance <= 0:
            return f"faces overlap by {-1e3 * self.distance:.4g} mm {where}"
        return f"faces are {1e3 * self.distance:.4g} mm apart {where}"


def check_start(
    mesh: Any, positions: Floats, thickness: float, *, distance: float = 0.0
) -> StartCheck:
    """Return whether contact can act on positions of a mesh, and the worst place where it cannot.

    Middle surfaces must be more than the thickness apart. The smallest distance of faces is found
    up to the given one.
    """
    library = ipctk()
    positions = np.asfortranarray(positions, dtype=np.float64)
    # Without a least distance nothing is left out, however near it is.
    near = library.NormalCollisions()
    near.build(mesh, positions, thickness * (1 + ROUNDING) + distance)
    found = float(np.sqrt(near.compute_minimum_distance(mesh, positions)))
    if found > thickness:
        crossing: tuple[int, ...] = ()
        if library.has_intersections(mesh, positions):
            crossing = _crossing(mesh, positions)
        return StartCheck(not crossing, found - thickness, crossing, crossing=bool(crossing))
    near.build(mesh, positions, max(found * (1 + ROUNDING), ROUNDING * thickness))
    worst = min(
        (near[k] for k in range(len(near))),
        key=lambda pair: pair.compute_distance(positions, mesh.edges, mesh.faces),
    )
    vertices = tuple(int(v) for v in worst.vertex_ids(mesh.edges, mesh.faces) if v >= 0)
    return StartCheck(False, found - thickness, vertices)


def _crossing(mesh: Any, positions: Floats) -> tuple[int, ...]:
    library = ipctk()
    phase = library.LBVH()
    phase.can_vertices_collide = mesh.can_collide
    phase.build(positions, mesh.edges, mesh.faces)
    for pair in phase.detect_edge_face_candidates():
        edge, face = mesh.edges[pair.edge_id], mesh.faces[pair.face_id]
        if library.is_edge_intersecting_triangle(*positions[edge], *positions[face]):
            return tuple(int(v) for v in (*edge, *face))
    return ()


def collision_filter(
    prescribed: Bools, bodies: Sequence[int], free_bodies: Ints, *, self_contact: bool
) -> Any:
    """Return the `ipctk.CollisionFilter` of a skin, and of bodies whose vertices follow its own.

    Left out are pairs of prescribed vertices of the skin, (n,), vertices of one body, and bodies
    that are held with each other. `bodies` are the bodies' numbers of vertices, `free_bodies` the
    numbers of those that move freely.
    """
    count = len(prescribed)
    held = count + len(bodies)
    own = np.where(prescribed, held + 1, np.arange(count))
    numbers = [count + k if k in free_bodies else held for k in range(len(bodies))]
    of_bodies = np.repeat(np.array(numbers, dtype=np.int64), list(bodies))
    found = patches_apart(np.append(own, of_bodies))
    return found if self_contact else found & patches_apart(np.append(0 * own, of_bodies))


def leaving_out(pairs: Ints) -> Any:
    """Return the `ipctk.CollisionFilter` that leaves out pairs of vertices, (k, 2), sorted."""
    if not len(pairs):
        return ipctk().CollisionFilter()
    one, two = (list(map(int, ends)) for ends in pairs.T)
    return ipctk().make_sparse_filter(dict.fromkeys(zip(one, two, strict=True), False), True)


def neighbours(pattern: Pattern, sizes: ContactSizes) -> Ints:
    """Return the pairs of vertices that are near along the sewn sheet, (k, 2), sorted.

    A face and a vertex, or two edges, may touch unless all their pairs of vertices are listed.
    Where edges are longer than twice the thickness there is none, unless triangles are slivers:
    contact then prevents a sharp fold between two triangles. Where they are shorter it does not
    act in a sheet that lies flat.
    """
    count, sheet = len(pattern.points), _Sheet.of(pattern)
    near = paths(count, *sheet.links(), FOLDED * sizes.thickness)
    corner, half = sheet.edges_near(max(ADJACENT * sizes.thickness, FLAT * sizes.reach))
    if len(corner):
        rows = np.tile(sheet.begin[corner], 2)
        columns = sheet.begin[np.append(half, following(half))]
        ends = np.concatenate([pattern.edges.ends, np.arange(count)[:, None] * [1, 1]])
        star = _matrix(count, ends[:, 0], ends[:, 1])
        around = coo_array((star + star.T) @ _matrix(count, rows, columns) @ (star + star.T))
        near = np.concatenate([near, np.column_stack([around.row, around.col])])
    near = near[near[:, 0] != near[:, 1]]
    keys = np.unique(near.min(axis=1) * np.int64(count) + near.max(axis=1))
    return np.stack(np.divmod(keys, count), axis=1)


def sizes_between_neighbours(pattern: Pattern, sizes: ContactSizes) -> ContactSizes:
    """Return the sizes by which neighbours in the sheet touch.

    They cannot be a thickness apart. They keep away from each other by a small part of the
    smallest height of a triangle, so that folds finer than the thickness do not cross either.
    """
    corners = pattern.flat_points[pattern.flat_triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return replace(
        sizes, thickness=0.0, distance=HEIGHT * float((2 * pattern.areas / longest).min())
    )


def paths(count: int, one: Ints, two: Ints, length: Floats, limit: float) -> Ints:
    """Return pairs of nodes, (k, 2) in both orders, that paths shorter than a limit join.

    The links between nodes `one` and `two`, (e,), have the given lengths.
    """
    kept = length <= limit
    one, two, length = one[kept], two[kept], length[kept]
    begin, end, step = np.append(one, two), np.append(two, one), np.append(length, length)
    order = np.argsort(begin, kind="stable")
    begin, end, step = begin[order], end[order], step[order]
    first = np.searchsorted(begin, np.arange(count + 1))
    keys, known = _shortest(begin * np.int64(count) + end, step)
    newest, reached = keys, known
    while len(newest):  # every path is continued by all links at its end
        start, stop = np.divmod(newest, count)
        number = first[stop + 1] - first[stop]
        link = np.repeat(first[stop] - np.cumsum(number) + number, number) + np.arange(number.sum())
        far = np.repeat(reached, number) + step[link]
        inside = (far <= limit) & (np.repeat(start, number) != end[link])
        longer, far = _shortest(
            (np.repeat(start, number) * np.int64(count) + end[link])[inside], far[inside]
        )
        place = np.minimum(np.searchsorted(keys, longer), len(keys) - 1)
        better = (keys[place] != longer) | (far < known[place] * (1 - 1e-12))
        newest, reached = longer[better], far[better]
        keys, known = _shortest(np.append(keys, newest), np.append(known, reached))
    return np.stack(np.divmod(keys, count), axis=1)


def _shortest(keys: Ints, lengths: Floats) -> tuple[Ints, Floats]:
    """Return each key once, sorted, with its smallest length."""
    order = np.lexsort((lengths, keys))
    keys, lengths = keys[order], lengths[order]
    first = np.append(True, keys[1:] != keys[:-1])[: len(keys)]
    return keys[first], lengths[first]


def _matrix(count: int, rows: Ints, columns: Ints) -> csr_array:
    return csr_array(coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)))


@dataclass(frozen=True, eq=False)
class _Sheet:
    """Triangles of a sewn sheet, each in its own plane.

    Half-edges are numbered as in `Edges`; the apex of one is the corner that it does not contain.

    Attributes:
        begin: Vertex at which each half-edge begins, (3 t,).
        twin: The half-edge on the other side, −1 at a border, (3 t,).
        length: Length in m, (3 t,).
        foot: Distance in m of the foot of the apex from the half-edge's begin, (3 t,).
        height: Height in m of the apex over the half-edge, (3 t,).
    """

    begin: Ints
    twin: Ints
    length: Floats
    foot: Floats
    height: Floats

    @classmethod
    def of(cls, pattern: Pattern) -> _Sheet:
        flat = pattern.corners
        sides = np.roll(flat, -1, axis=1) - flat
        length = np.linalg.norm(sides, axis=2)
        foot = -np.einsum("tij,tij->ti", np.roll(sides, 1, axis=1), sides) / length
        twin = np.full(3 * len(flat), -1)
        inner = pattern.edges.twins[pattern.edges.inner]
        twin[inner], twin[inner[:, ::-1]] = inner[:, ::-1], inner
        height = 2 * pattern.areas[:, None] / length
        begin = pattern.triangles.ravel()
        return cls(begin, twin, length.ravel(), foot.ravel(), height.ravel())

    def beyond(self, half: Ints, begin: Floats, end: Floats) -> Floats:
        """Return the place of the apex behind half-edges between given places, (k, 2), in m."""
        twin = self.twin[half]
        along = (begin - end) / np.linalg.norm(begin - end, axis=1)[:, None]
        left = along[:, ::-1] * [-1, 1]
        return np.asarray(end + self.foot[twin, None] * along + self.height[twin, None] * left)

    def opposite(self, corner: Ints) -> tuple[Ints, Floats, Floats]:
        """Return the half-edges opposite corners, and their ends' places seen from there.

        Corner and half-edge 3 t + i have the same number.
        """
        half = following(corner)
        middle = np.column_stack([self.foot[half], self.height[half]])
        return half, -middle, np.column_stack([self.length[half], np.zeros(len(half))]) - middle

    def links(self) -> tuple[Ints, Ints, Floats]:
        """Return ends and length of straight paths along edges, and across one edge each."""
        corner = np.flatnonzero(self.twin[following(np.arange(len(self.twin)))] >= 0)
        half, begin, end = self.opposite(corner)
        place = self.beyond(half, begin, end)
        seen = (cross(begin, place) > 0) & (cross(place, end) > 0)
        far = self.begin[following(following(self.twin[half]))]
        every = np.arange(len(self.begin))
        return (
            np.append(self.begin, self.begin[corner[seen]]),
            np.append(self.begin[following(every)], far[seen]),
            np.append(self.length, np.linalg.norm(place[seen], axis=1)),
        )

    def edges_near(self, limit: float) -> tuple[Ints, Ints]:
        """Return corners and half-edges not at them, that straight paths below a limit join."""
        corner: Ints = np.arange(len(self.begin))
        half, begin, end = self.opposite(corner)
        low, high = begin, end
        corners, halves = [], []
        while len(corner):
            direction = end - begin
            one, two = (
                (cross(begin, direction) / cross(ray, direction))[:, None] * ray
                for ray in (low, high)
            )
            near = _distance(one, two) <= limit
            corners.append(corner[near])
            halves.append(half[near])
            near &= self.twin[half] >= 0
            corner, half = corner[near], half[near]
            begin, end, low, high = (at[near] for at in (begin, end, low, high))
            apex = self.beyond(half, begin, end)
            after = following(self.twin[half])
            corner, half = np.tile(corner, 2), np.append(after, following(after))
            begin, end = np.concatenate([begin, apex]), np.concatenate([apex, end])
            low, high = np.tile(low, (2, 1)), np.tile(high, (2, 1))
            low = np.where((cross(low, begin) > 0)[:, None], begin, low)
            high = np.where((cross(end, high) > 0)[:, None], end, high)
            seen = cross(low, high) > VIEW * np.linalg.norm(low, axis=1) * np.linalg.norm(
                high, axis=1
            )
            corner, half = corner[seen], half[seen]
            begin, end, low, high = (at[seen] for at in (begin, end, low, high))
        return np.concatenate(corners), np.concatenate(halves)


def _distance(begin: Floats, end: Floats) -> Floats:
    """Return the distance of the origin from segments, (k,)."""
    along = end - begin
    share = np.clip(
        -np.einsum("ij,ij->i", begin, along) / np.einsum("ij,ij->i", along, along), 0, 1
    )
    return np.asarray(np.linalg.norm(begin + share[:, None] * along, axis=1))
