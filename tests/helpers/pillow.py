"""A flat pillow whose sheet wrinkles under pressure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from helpers.scenes import TABLE_A
from toros_fem.materials.sheet import Composite, Membrane
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import sew
from toros_fem.meshes.sheets import rectangle

SIDE = 0.04
COMPOSITE = Composite(
    fabric=TABLE_A,
    reinforcement=replace(TABLE_A, young=10 * TABLE_A.young),
    c1=1.8,
    c2=2.0,
    bending=None,
    membrane=Membrane("tension-field", 1e-4),
)


def pillow(comm: MPI.Comm, composite: Composite = COMPOSITE) -> EquilibriumSolver:
    """The upper one of two sewn squares."""

    def place(flat: np.ndarray) -> np.ndarray:
        u, v = (np.pi * flat / SIDE).T
        lift = 0.05 * SIDE * np.sin(u) * np.sin(v)
        return np.column_stack([flat - SIDE / 2, np.where(lift < 1e-9, 0.0, lift)])

    pattern = rectangle(comm, SIDE, SIDE, SIDE / 6, "union-jack", place)
    seam = symmetry_plane(pattern, 2)
    fixed = seam.fixed
    x, y, _ = pattern.points.T
    middle = np.abs(y) < 1e-9
    fixed[middle & (np.abs(x) > 0.49 * SIDE), 1] = True
    fixed[(np.abs(x) < 1e-9) & (y < -0.49 * SIDE), 0] = True
    supports = Supports(fixed, planes=seam.planes)
    return EquilibriumSolver(
        sew(comm, pattern), composite, supports, NewtonOptions(tolerance=1e-12)
    )
