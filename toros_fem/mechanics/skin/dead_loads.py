"""Dead forces on the vertices of a skin, which keep their direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Floats, checked_floats, require_kind
from toros_fem.meshes.panels import located
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surface import nearest
from toros_fem.meshes.transfer import OtherMesh

# Largest distance of the place of a force from the skin, as a fraction of the skin's size.
ON_SKIN = 0.01


def carried_force(other: OtherMesh, force: Floats) -> Floats:
    """Return dead forces in N, (n, 3), on another mesh, from those on its source, (m, 3).

    The total stays. Where triangles are divided, force per area is interpolated. Elsewhere the
    triangle at each vertex of the source bears its force by the barycentric coordinates.
    """
    source, target = other.source, other.pattern
    if np.array_equal(other.cell, np.repeat(np.arange(len(source.panel)), 4)):
        density = other.at_vertices(force / source.vertex_areas[:, None])
        return np.asarray(density * target.vertex_areas[:, None])
    vertex = np.flatnonzero(np.any(force != 0, axis=1))
    point = np.zeros(len(source.points), dtype=np.int64)
    point[source.sewn] = np.arange(len(source.sewn))
    at = point[vertex]
    cell, weight = located(target, source.panel_of_point[at], source.flat_points[at])
    found = np.zeros((len(target.points), 3))
    np.add.at(found, target.triangles[cell], weight[..., None] * force[vertex][:, None])
    return found


def spread_force(pattern: Pattern, panel: str, force: Sequence[float] | Floats) -> Floats:
    """Spread one force in N, (3,), over a panel by flat area: forces on all vertices, (n, 3)."""
    require_kind("pattern", pattern, Pattern, "a Pattern")
    whole = _vector("force", force, 3, "N")
    cells = pattern.cells_of(panel)
    third = np.repeat(pattern.areas[cells] / 3, 3)
    areas = np.bincount(pattern.triangles[cells].ravel(), third, minlength=len(pattern.points))
    return np.asarray(np.outer(areas / areas.sum(), whole))


def point_force(
    pattern: Pattern,
    place: Sequence[float] | Floats,
    force: Sequence[float] | Floats,
    panel: str | None = None,
) -> Floats:
    """Return dead forces on all vertices, (n, 3), of one force in N, (3,), at one point.

    The vertices of the triangle there bear it by their barycentric coordinates, so that it has the
    right moment too. At a vertex that vertex bears it alone.

    Args:
        pattern: The pattern.
        place: The point in m: assembled coordinates (3,), of which the nearest point of the
            assembled skin is taken; or flat coordinates (2,) in the chart of `panel`.
        force: The force.
        panel: Name of the panel of flat coordinates; None for assembled ones.

    Raises:
        ParameterError: The point is further from the skin than `ON_SKIN` of its size.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    whole = _vector("force", force, 3, "N")
    flat = panel is not None
    at = _vector("place", place, 2 if flat else 3, "m")
    cells = np.arange(len(pattern.panel)) if panel is None else pattern.cells_of(panel)
    vertices, triangles = pattern.points, pattern.triangles
    if flat:
        vertices, triangles = np.pad(pattern.flat_points, ((0, 0), (0, 1))), pattern.flat_triangles
    found = nearest(np.pad(at, (0, 3 - len(at)))[None], vertices, triangles[cells])
    away, cell = float(found.distance[0]), cells[found.triangle[0]]
    if away > ON_SKIN * pattern.size:
        where = f"panel {panel!r}" if flat else "the assembled skin"
        raise ParameterError(
            f"place = {at} m is {away:.3g} m away from {where}; at most "
            f"{ON_SKIN * pattern.size:.3g} m are allowed. Give a point on it."
        )
    forces = np.zeros((len(pattern.points), 3))
    np.add.at(forces, pattern.triangles[cell], np.outer(found.shares[0], whole))
    return forces


def _vector(name: str, values: Sequence[float] | Floats, size: int, unit: str) -> Floats:
    advice = "; flat coordinates (2,) need the name of their panel" if name == "place" else ""
    what = f"a finite vector ({size},), in {unit}{advice}"
    return checked_floats(name, values, what, (size,))
