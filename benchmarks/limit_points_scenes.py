"""Skins of `limit_points.py`, which snap: a hinged roof, a tube without stretch bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from accuracy_scenes import COMM, table_a
from accuracy_sheets import elastic
from accuracy_tubes import RADIUS, half_tube

from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern, rectangle, sew

Floats = npt.NDArray[np.float64]

# Sze, Liu & Lo 2004, section 3.8: the hinged cylindrical roof, here in m, Pa and N.
ROOF_RADIUS, ROOF_HALF_LENGTH, ROOF_ANGLE = 2.54, 0.254, 0.1
ROOF_YOUNG, ROOF_POISSON = 3102.75e6, 0.3
ROOF_LOAD = 3000.0
ROOF_THICKNESSES = (12.7e-3, 6.35e-3)


@dataclass(frozen=True, eq=False)
class Scene:
    """A skin and its loads at load factor 1.

    Attributes:
        pattern: Flat panels and assembled positions.
        solver: Its solver.
        density: Of the owned triangles.
        pressure: In Pa.
        force: Dead forces in N, (n, 3); None for none.
    """

    pattern: Pattern
    solver: EquilibriumSolver
    density: Floats
    pressure: float = 0.0
    force: Floats | None = None


def roof(count: int, thickness: float, mesh: str = "right") -> tuple[Scene, int]:
    """Return a quarter of the hinged roof under its point load, and the vertex that carries it.

    Args:
        count: Edges along the quarter's arc.
        thickness: In m.
        mesh: As for `rectangle`.
    """
    arc = ROOF_RADIUS * ROOF_ANGLE

    def place(flat: Floats) -> Floats:
        angle = flat[:, 0] / ROOF_RADIUS
        height = ROOF_RADIUS * (np.cos(angle) - 1)
        return np.column_stack([ROOF_RADIUS * np.sin(angle), flat[:, 1], height])

    pattern = rectangle(COMM, arc, ROOF_HALF_LENGTH, arc / count, mesh, place)
    x, y, _ = pattern.points.T
    hinged = np.repeat((x > x.max() - 1e-9)[:, None], 3, axis=1)
    supports = symmetry_plane(pattern, 0) | symmetry_plane(pattern, 1) | Supports(hinged)
    composite = elastic(ROOF_YOUNG, ROOF_POISSON, thickness, "midedge", rest="assembled")
    skin = sew(COMM, pattern)
    top = int(np.argmin(x + y))
    force = np.zeros(pattern.points.shape)
    force[top, 2] = -ROOF_LOAD / 4
    solver = EquilibriumSolver(skin, composite, supports)
    return Scene(pattern, solver, np.zeros(len(skin.owned_cells)), force=force), top


def unbounded_tube(sides: int, mesh: str = "structured") -> Scene:
    """Return half of a long capped tube of material A without stretch bounds, at 1 kPa."""
    pattern, supports = half_tube(sides, 8.0, mesh)
    skin = sew(COMM, pattern)
    solver = EquilibriumSolver(skin, table_a(c1=1e5, c2=1e5), supports)
    return Scene(pattern, solver, np.zeros(len(skin.owned_cells)), pressure=1e3)


def middle_radius(pattern: Pattern, positions: Floats) -> float:
    """Return the radius in the tube's plane of symmetry over the assembled one."""
    middle = np.abs(pattern.points[:, 2]) < 1e-9
    return float(np.linalg.norm(positions[middle, :2], axis=1).mean() / RADIUS)
