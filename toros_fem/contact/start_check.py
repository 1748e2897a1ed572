"""Whether contact can act on given positions: no surface crosses another, faces are apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toros_fem._types import Floats, Ints
from toros_fem.contact.library import ipctk
from toros_fem.contact.settings import Ground
from toros_fem.meshes.pattern import Pattern

# Relative size of a distance's rounding.
ROUNDING = 1e-6


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

        Args:
            pattern: The skin's pattern.
            positions: As of `check_start`.
            bodies: Name of the body of each vertex that follows those of the skin.
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
    mesh: Any,
    positions: Floats,
    thickness: float,
    *,
    distance: float = 0.0,
    grounds: Sequence[Ground] = (),
    grounded: Ints | None = None,
) -> StartCheck:
    """Return whether contact can act on given positions, and the worst place where it cannot.

    Args:
        mesh: `ipctk.CollisionMesh`, with its filter.
        positions: Of all its vertices in m, (n, 3).
        thickness: Distance of middle surfaces in m that they must exceed.
        distance: Distance of faces in m up to which the smallest is found.
        grounds: Half-spaces, already moved to where middle surfaces must stay out.
        grounded: Vertices that half-spaces keep out, (g,); None for all.

    Raises:
        MissingPackageError: ipctk is not installed.
    """
    library = ipctk()
    positions = np.asfortranarray(positions, dtype=np.float64)
    kept_out = np.arange(len(positions)) if grounded is None else grounded
    for ground in grounds:
        height = (positions[kept_out] - np.array(ground.point)) @ np.array(ground.normal)
        lowest = int(np.argmin(height))
        if height[lowest] <= 0:
            at = (int(kept_out[lowest]),)
            return StartCheck(False, float(height[lowest]), at, ground=True)
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
    """Return vertices of an edge and a triangle that cross."""
    library = ipctk()
    phase = library.LBVH()
    phase.can_vertices_collide = mesh.can_collide
    phase.build(positions, mesh.edges, mesh.faces)
    for pair in phase.detect_edge_face_candidates():
        edge, face = mesh.edges[pair.edge_id], mesh.faces[pair.face_id]
        if library.is_edge_intersecting_triangle(*positions[edge], *positions[face]):
            return tuple(int(v) for v in (*edge, *face))
    return ()
