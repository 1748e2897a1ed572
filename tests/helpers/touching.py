"""Skins that touch bodies and the ground."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from helpers.scenes import square
from helpers.standing import solver_on_base
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.sliding import Pads
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_sphere
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp_where
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes import Skin, sew

# A solver, and what acts.
Lifted = tuple[EquilibriumSolver, Load]
EXACT = NewtonOptions(tolerance=1e-12)
SIZE, STRETCH = 0.08, 1.05
MIDDLE = STRETCH * SIZE / 2
# The inflated short tube bulges against a floor.
FLOOR = Ground((-0.0112, 0.0, 0.0), (1.0, 0.0, 0.0))


def sheet_with_ball(comm: MPI.Comm, *, friction: float | None = None, **more: Any) -> Lifted:
    """A sheet stretched over a frame by 5 %, and a free ball on it, beside the middle.

    The load moves a plate down, which presses the ball into the sheet.
    """
    flat = square(n=8, size=SIZE).flat_points
    pattern = square(np.pad(STRETCH * flat, ((0, 0), (0, 1))), n=8, size=SIZE)
    frame = clamp_where(pattern, lambda x: np.abs(x[:, :2] - MIDDLE).max(axis=1) > 0.999 * MIDDLE)
    thickness = Composite().fabric.thickness
    centre = np.array([MIDDLE + 0.003, MIDDLE + 0.001, 0.0201 + thickness / 2])
    ball = replace(rigid_sphere("ball", 0.02, centre, edge_length=3e-3), free=True)
    plate = rigid_box("plate", (0.03, 0.03, 0.005), centre + [0.0, 0.0, 0.023], edge_length=5e-3)
    contact = Contact(bodies=[ball, plate], friction=friction)
    solver = EquilibriumSolver(sew(comm, pattern), Composite(), frame, contact=contact, **more)
    return solver, Load(poses=np.array([np.zeros(6), [0.0, 0.0, -0.02, 0.0, 0.0, 0.0]]))


def tube_on_floor_and_ball(skin: Skin, **more: Any) -> EquilibriumSolver:
    """The short tube, which bulges against a floor and a ball beside it."""
    contact = Contact(ground=FLOOR, bodies=[rigid_sphere("ball", 0.01, (0.004, 0.0202, 0.035))])
    return solver_on_base(skin, contact=contact, **more)


def dragged(comm: MPI.Comm) -> tuple[EquilibriumSolver, Load, Load]:
    """A sheet over a cylinder and the ground, put down, then dragged by one edge.

    Vertices then stick and slide on both.
    """
    points = square(n=5).points.copy()
    points[:, 2] = 3e-4
    pattern = square(points, n=5)
    roll = rigid_cylinder(
        "roll", 4e-3, 0.03, (0.0, 1.0, 0.0), (0.012, 0.01, -4.6e-3), edge_length=2e-3
    )
    touched = Contact(
        Ground((0.0, 0.0, -1e-4), (0.3, 0.1, 1.0)), [roll], self_contact=False, friction=0.5,
        thickness=5e-4, distance=1e-4, slip=1e-4,
    )  # fmt: skip
    edge = clamp_where(pattern, lambda x: x[:, 0] < 1e-9)
    solver = EquilibriumSolver(sew(comm, pattern), Composite(), edge, EXACT, contact=touched)
    down = np.tile([0.0, 0.01, -0.05], (len(points), 1))
    moved = np.tile([-1e-4, 3e-5, 0.0], (len(points), 1))
    pose = np.array([[0.0, 0.0, 0.0, 0.0, 5e-3, 0.0]])
    return solver, Load(0.0, force=down), Load(0.0, 1.1 * down, moved, poses=pose)


def on_pads(skin: Skin) -> EquilibriumSolver:
    """The short tube, heavy and on pads: all that a walker has."""
    pattern = skin.pattern
    pads = Pads(pattern.points[:, 2] > 0.03, (0.0, 0.0, 1.0), 0.2, 0.7)
    weight, contact = Weight(0.3, 0.6, (-9.81, 0.0, 0.0)), Contact(FLOOR, friction=0.4, pads=pads)
    return solver_on_base(skin, options=EXACT, weight=weight, contact=contact)
