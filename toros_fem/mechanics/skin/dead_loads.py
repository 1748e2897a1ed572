"""Dead loads: the skin's own weight, and forces that keep their direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, require_between, require_kind
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import Refinement

GRAVITY = 9.81  # m/s²
# Largest distance of the place of a force from the skin, as a fraction of the skin's size.
ON_SKIN = 0.01


@dataclass(frozen=True)
class Weight:
    """Weight of the skin itself, which changes with the design.

    Attributes:
        fabric, reinforcement: Mass per flat area in kg/m², ≥ 0, of the plain and of the reinforced
            fabric; linear in ρ̄ between them, as the stiffness is.
        gravity: Acceleration in m/s², (gx, gy, gz).
    """

    fabric: float
    reinforcement: float
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)

    def __post_init__(self) -> None:
        require_between(0.0, np.inf, fabric=self.fabric, reinforcement=self.reinforcement)
        what = "a finite vector of three components, in m/s²"
        gravity = checked_floats("gravity", self.gravity, what, (3,))
        object.__setattr__(self, "gravity", (gravity[0], gravity[1], gravity[2]))
        object.__setattr__(self, "fabric", float(self.fabric))  # forms take no integers
        object.__setattr__(self, "reinforcement", float(self.reinforcement))


def refined_force(finer: Refinement, pattern: Pattern, force: Floats) -> Floats:
    """Return dead forces in N, (n, 3), on a refined pattern, from those on the coarse one, (m, 3).

    Force per area is interpolated; the total stays.
    """
    density = finer.at_vertices(force / pattern.vertex_areas[:, None])
    return np.asarray(density * finer.pattern.vertex_areas[:, None])


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
    corners = pattern.corners[cells] if flat else pattern.points[pattern.triangles[cells]]
    weights, away = _nearest(corners, at)
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


def _nearest(corners: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return the point of each triangle that is nearest to a point, and its distance, (c,).

    The points are barycentric coordinates, (c, 3).
    """
    edges, arms = corners[:, [1, 2, 0]] - corners, at - corners
    share = np.einsum("cik,cik->ci", arms, edges) / np.einsum("cik,cik->ci", edges, edges)
    share = np.clip(share, 0.0, 1.0)[:, :, None]
    on_edges = (1 - share) * np.eye(3) + share * np.roll(np.eye(3), 1, axis=1)
    # The projection onto the plane counts if it lies inside.
    sides = corners[:, 1:] - corners[:, :1]
    products = sides @ arms[:, 0, :, None]
    local = np.linalg.solve(sides @ sides.transpose(0, 2, 1), products)[:, :, 0]
    inside = np.concatenate([1 - local.sum(axis=1, keepdims=True), local], axis=1)
    points = np.concatenate([inside[:, None], on_edges], axis=1)
    away = np.linalg.norm(np.einsum("cpi,cik->cpk", points, corners) - at, axis=2)
    away[(inside < 0).any(axis=1), 0] = np.inf
    best = np.arange(len(corners)), np.argmin(away, axis=1)
    return points[best], away[best]
