"""Starts of contact: flat skins opened, and whether given positions keep surfaces apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.mechanics.contact.library import collision_mesh, ipctk
from toros_fem.mechanics.contact.neighbours import leaving_out, neighbours
from toros_fem.mechanics.contact.settings import ContactSizes
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import dihedral_angles, normals

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
