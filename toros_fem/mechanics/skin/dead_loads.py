"""Dead loads: the skin's own weight, and forces that keep their direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, require_between, require_kind
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import Refinement

# Largest distance of the place of a force from the skin, as a fraction of the skin's size.
ON_SKIN = 0.01


@dataclass(frozen=True)
class Weight:
    """Weight of the skin itself, which changes with the design.

    Attributes:
        fabric, reinforcement: Mass per flat area in kg/m² of the plain and of the reinforced
            fabric; linear in ρ̄ between them, as the stiffness is.
        gravity: Acceleration in m/s², (gx, gy, gz).

    Raises:
        ParameterError: A mass is negative, or gravity is no finite vector.
    """

    fabric: float
    reinforcement: float
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        require_between(0.0, np.inf, fabric=self.fabric, reinforcement=self.reinforcement)
        what = "a finite vector of three components, in m/s²"
        gravity = checked_floats("gravity", self.gravity, what, (3,))
        object.__setattr__(self, "gravity", (gravity[0], gravity[1], gravity[2]))
        object.__setattr__(self, "fabric", float(self.fabric))  # forms take no integers
        object.__setattr__(self, "reinforcement", float(self.reinforcement))


def refined_force(finer: Refinement, pattern: Pattern, force: Floats) -> Floats:
    """Return dead forces in N on a refined pattern, (n, 3), with the same total.

    Force per area is interpolated.

    Args:
        finer: The refinement.
        pattern: The coarse pattern.
        force: Forces on its assembled vertices, (m, 3).
    """
    density = finer.at_vertices(force / pattern.vertex_areas[:, None])
    return np.asarray(density * finer.pattern.vertex_areas[:, None])


def spread_force(pattern: Pattern, panel: str, force: Sequence[float] | Floats) -> Floats:
    """Return dead forces that spread one force over a panel by flat area.

    Args:
        pattern: The pattern.
        panel: Name of the panel.
        force: The total force in N, (3,).

    Returns:
        Forces in N on all assembled vertices, (n, 3).

    Raises:
        PanelError: There is no such panel.
        ParameterError: The force is no finite vector.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    total = _vector("force", force, 3, "N")
    cells = pattern.cells_of(panel)
    third = np.repeat(pattern.areas[cells] / 3, 3)
    areas = np.bincount(pattern.triangles[cells].ravel(), third, minlength=len(pattern.points))
    return np.asarray(np.outer(areas / areas.sum(), total))


def point_force(
    pattern: Pattern,
    place: Sequence[float] | Floats,
    force: Sequence[float] | Floats,
    panel: str | None = None,
) -> Floats:
    """Return a dead force at one point of the skin.

    The vertices of the triangle there bear it by their barycentric coordinates, so that it has the
    right moment too. At a vertex that vertex bears it alone.

    Args:
        pattern: The pattern.
        place: The point in m: assembled coordinates (3,), of which the nearest point of the
            assembled skin is taken; or flat coordinates (2,) in the chart of `panel`.
        force: The force in N, (3,).
        panel: Name of the panel of flat coordinates; None for assembled ones.

    Returns:
        Forces in N on all assembled vertices, (n, 3).

    Raises:
        PanelError: There is no such panel.
        ParameterError: An array is no finite vector of its length; or the point is further
            from the skin than `ON_SKIN` of its size.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    whole = _vector("force", force, 3, "N")
    flat = panel is not None
    at = _vector("place", place, 2 if flat else 3, "m")
    cells = np.arange(len(pattern.panel)) if panel is None else pattern.cells_of(panel)
    corners = pattern.corners[cells] if flat else pattern.points[pattern.triangles[cells]]
    weights = _nearest_weights(corners, at)
    away = np.linalg.norm(np.einsum("cik,ci->ck", corners, weights) - at, axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] > ON_SKIN * pattern.size:
        where = f"panel {panel!r}" if flat else "the assembled skin"
        raise ParameterError(
            f"place = {at} m is {away[nearest]:.3g} m away from {where}; at most "
            f"{ON_SKIN * pattern.size:.3g} m are allowed. Give a point on it."
        )
    forces = np.zeros((len(pattern.points), 3))
    np.add.at(forces, pattern.triangles[cells[nearest]], np.outer(weights[nearest], whole))
    return forces


def _vector(name: str, values: Sequence[float] | Floats, size: int, unit: str) -> Floats:
    advice = "; flat coordinates (2,) need the name of their panel" if name == "place" else ""
    what = f"a finite vector ({size},), in {unit}{advice}"
    return checked_floats(name, values, what, (size,))


def _nearest_weights(corners: Floats, at: Floats) -> Floats:
    """Return barycentric coordinates (c, 3) of the point of each triangle nearest to a point."""
    inside = _projected(corners, at)
    beyond = (inside < 0).any(axis=1)
    best = np.full(len(corners), np.inf)
    found = inside.copy()
    for i in range(3):  # outside, the nearest point is on an edge
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        along = b - a
        share = np.einsum("ck,ck->c", at - a, along) / np.einsum("ck,ck->c", along, along)
        share = np.clip(share, 0.0, 1.0)
        distance = np.linalg.norm(a + share[:, None] * along - at, axis=1)
        closer = beyond & (distance < best)
        best[closer] = distance[closer]
        row = np.zeros((len(corners), 3))
        row[:, i], row[:, (i + 1) % 3] = 1 - share, share
        found[closer] = row[closer]
    return found


def _projected(corners: Floats, at: Floats) -> Floats:
    """Return barycentric coordinates (c, 3) of a point's projection onto triangles' planes."""
    u, v, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], at - corners[:, 0]
    uu, uv, vv = (np.einsum("ck,ck->c", *pair) for pair in ((u, u), (u, v), (v, v)))
    uw, vw = (np.einsum("ck,ck->c", side, w) for side in (u, v))
    area = uu * vv - uv**2
    one, two = (vv * uw - uv * vw) / area, (uu * vw - uv * uw) / area
    return np.stack([1 - one - two, one, two], axis=1)
