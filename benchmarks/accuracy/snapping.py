"""Skins of `limit_points.py`: a roof and a lid that snap, a tube that bulges, closed forms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from benchmarks.accuracy.scenes import COMM, table_a
from benchmarks.accuracy.sheets import elastic
from benchmarks.accuracy.tubes import RADIUS, half_tube
from benchmarks.stability.scenes import triangle_panels
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.meshes import Pattern, rectangle, sew

Floats = npt.NDArray[np.float64]

# Sze, Liu & Lo 2004, section 3.8: the hinged cylindrical roof, here in m, Pa and N.
ROOF_RADIUS, ROOF_HALF_LENGTH, ROOF_ANGLE = 2.54, 0.254, 0.1
ROOF_YOUNG, ROOF_POISSON = 3102.75e6, 0.3
ROOF_LOAD = 3000.0
ROOF_THICKNESSES = (12.7e-3, 6.35e-3)
# The lid: half side, sag of its middle, depth of its box, in m.
LID_HALF, LID_SAG, LID_DEPTH = 0.02, 2e-3, 0.02


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


def bulge(material: Material, pressure: float, radius: float) -> tuple[float, float]:
    """Return hoop stretches of a long capped tube that has bulged: far away, in the bulge's middle.

    The tube is a membrane without stretch bounds. Along its meridian W − λ₁ W₁ and the axial force
    do not change (Pipkin 1968), far away it is a homogeneous tube, and where the meridian is
    parallel to the axis this leaves one more state.

    Args:
        material: Of the tube.
        pressure: In Pa, below the largest one of a homogeneous tube.
        radius: Of the tube at rest, in m.
    """
    mu, lam, h = material.mu, material.lam, material.thickness

    def along(hoop: float) -> float:  # from h W₁ = P R λ₂²/2, the force on the caps
        force = pressure * radius * hoop**2 / 2 / h
        return float((force + 2 * mu - lam * (hoop - 2)) / (2 * mu + lam))

    def invariant(hoop: float) -> float:
        a, b = along(hoop) - 1, hoop - 1
        energy = mu * (a * a + b * b) + lam / 2 * (a + b) ** 2
        return float(energy - (a + 1) * (2 * mu * a + lam * (a + b)))

    def unbalanced(hoop: float) -> float:
        a, b = along(hoop) - 1, hoop - 1
        return float(h * (2 * mu * b + lam * (a + b)) - pressure * radius * hoop * (a + 1))

    far: float = brentq(unbalanced, 1.0, 2.2886)
    level = invariant(far)
    # The invariant has an extremum at each homogeneous state; the bulge lies beyond the second.
    second: float = brentq(unbalanced, 2.2886, 100.0)
    middle: float = brentq(lambda hoop: invariant(hoop) - level, second, 100.0)
    return far, middle


def lid(count: int) -> tuple[Scene, int]:
    """Return a box with a printed lid, moulded so that it sags, and the lid's middle.

    The lid is four triangles, all printed. The box is fabric that is held in place. At load factor
    1 the pressure is 1 kPa.

    Args:
        count: Edges along a side of a triangle.
    """
    ring = LID_HALF * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    corners = np.array([*ring, [0.0, 0.0, -LID_SAG], [0.0, 0.0, -LID_DEPTH]])
    sides = [(k, (k + 1) % 4) for k in range(4)]
    faces = [(*side, 4) for side in sides] + [(*side[::-1], 5) for side in sides]
    pattern = triangle_panels(corners, np.array(faces), count)
    skin = sew(COMM, pattern)
    composite = Composite(bending=Bending(rest="assembled"))
    supports = clamp(pattern, [f"face {k}" for k in range(4, 8)])
    solver = EquilibriumSolver(skin, composite, supports)
    middle = int(np.argmin(np.linalg.norm(pattern.points - [0.0, 0.0, -LID_SAG], axis=1)))
    density = np.where(pattern.panel < 4, 1.0, 0.0)[skin.owned_cells]
    return Scene(pattern, solver, density, pressure=1e3), middle
