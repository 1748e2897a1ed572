"""Tubes: half of a long capped one, solved, and one stretched alike everywhere."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from benchmarks.accuracy.known import Measured
from benchmarks.accuracy.scenes import (
    COMM,
    Bools,
    Floats,
    Solved,
    entry,
    half_held,
    solve,
    table_a,
    without,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import Pattern, cylinder, sew

RADIUS = 0.01  # m, of the tables' tubes
# Half length of tubes in radii: six radii from the tip its disc is felt by less than 1e-6.
HALF_LENGTH = 8.0


def half_tube(sides: int, length: float, mesh: str) -> tuple[Pattern, Supports]:
    """Half of a capped tube, from its middle z = 0, a plane of symmetry, to its tip.

    Args:
        sides: Vertices of a ring, a multiple of four.
        length: Of the half, in radii.
        mesh: As for `cylinder`.
    """
    edge = 2 * np.pi * RADIUS / sides
    pattern = without(cylinder(COMM, length * RADIUS, 2 * RADIUS, edge, mesh=mesh), "base")
    return pattern, half_held(pattern)


@cache
def inflated_tube(pressure: float, mesh: str, sides: int) -> Solved:
    """Half of a long capped tube of material A."""
    pattern, supports = half_tube(sides, HALF_LENGTH, mesh)
    return solve(pattern, table_a(), supports, pressure)


def on_tube(value: Callable[[Solved], float], pressure: float, mesh: str, sides: int) -> Measured:
    """A value of the inflated tube."""
    found = inflated_tube(pressure, mesh, sides)
    return found.measured(value(found))


def swelling(found: Solved) -> float:
    """Radius about the middle of a half tube, over the assembled one."""
    return float(np.linalg.norm(found.points[middle(found), :2], axis=1).mean() / RADIUS)


def lengthening(found: Solved) -> float:
    """Stretch along the tube about its middle."""
    near = middle(found)
    height = found.pattern.points[near, 2]
    return float(height @ found.points[near, 2] / (height @ height))


def twist(found: Solved) -> float:
    """Return the twist about the tube's middle, in rad over a length of R."""
    near = middle(found)
    before, after = (p[near, 0] + 1j * p[near, 1] for p in (found.pattern.points, found.points))
    height = found.pattern.points[near, 2] / RADIUS
    return float(height @ np.angle(after / before) / (height @ height))


def middle(found: Solved) -> Bools:
    """Vertices of a half tube that are within two radii of the middle."""
    return np.asarray(found.pattern.points[:, 2] < 2 * RADIUS + 1e-9)


def exact_polygon(sides: int, pressure: float) -> tuple[float, float]:
    """Return stretches around and along of the tube with a number of sides."""
    match = {"mat": "A", "n_circumference": f"{sides}", "P_Pa": f"{pressure:.0f}"}
    return (
        entry("gent_cylinder_ngon", "lambda_theta", **match),
        entry("gent_cylinder_ngon", "lambda_z", **match),
    )


class HomogeneousTube:
    """Forces on a short structured half tube that is stretched alike everywhere."""

    def __init__(self, sides: int, composite: Composite) -> None:
        self.pattern, supports = half_tube(sides, 2.0, "structured")
        self.skin = sew(COMM, self.pattern)
        self.model = make_model(self.skin, composite, supports)
        self.model.set_density(np.zeros(len(self.skin.owned_cells)))
        self.model.set_load(Load(np.array([0.0])))
        self.tip = self.pattern.vertices_of("tip")
        wall = np.setdiff1d(self.pattern.vertices_of("wall"), self.tip)
        self.inner = wall[self.pattern.points[wall, 2] > 1e-9]

    def forces(self, around: float, along: float) -> tuple[Floats, Floats]:
        """Return the force of the stretched skin in N, and that of a unit pressure in m²."""
        scale = np.array([around, around, along])
        state = (self.model.assembled.reshape(-1, 3) * scale).ravel()
        gather = self.skin.gather_vertices
        pull = gather(self.model.residual(state).reshape(-1, 3))
        return pull, gather(self.model.volume_gradient(state).reshape(-1, 3))

    def unbalanced(self, around: float, along: float, pressure: float) -> float:
        """Return the largest unbalanced fraction of the pressure's force, in wall or tip."""
        pull, load = self.forces(around, along)
        inner = np.linalg.norm((pull - pressure * load)[self.inner])
        tip = (pull - pressure * load)[self.tip, 2].sum()
        return float(
            max(
                inner / np.linalg.norm(pressure * load[self.inner]),
                abs(tip) / (pressure * load[self.tip, 2].sum()),
            )
        )

    def pressure(self, around: float) -> float:
        """Return the pressure in Pa at a stretch around; the stretch along balances the tip."""

        def held_by(along: float) -> tuple[float, float]:
            pull, load = self.forces(around, along)
            inner = load[self.inner].ravel()
            pressure = float(pull[self.inner].ravel() @ inner / (inner @ inner))
            return pressure, float((pull - pressure * load)[self.tip, 2].sum())

        along = brentq(lambda z: held_by(z)[1], 1.0, 3.0, xtol=1e-10)
        return held_by(along)[0]
