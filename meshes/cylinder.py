"""A capped tube: one rectangle rolled up, and two round end caps."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import on_first_rank
from toros_fem._types import Floats, Ints
from toros_fem._validate import require_choice, require_positive
from toros_fem.meshes.gmsh_panels import polygon_meshes
from toros_fem.meshes.pattern import Panel, Pattern
from toros_fem.meshes.sheet import circle, ringed_disc

WALL, BASE, TIP = "wall", "base", "tip"


def cylinder(
    comm: MPI.Comm,
    length: float,
    diameter: float,
    edge_length: float,
    *,
    mesh: str = "unstructured",
    caps: bool = True,
) -> Pattern:
    """Make a tube along z from z = 0 (panel "base") to z = length (panel "tip") (collective).

    The wall is one flat rectangle, u around the tube and v = z along it. It is sewn along the line
    in the half-plane y = 0, x < 0: the outside of a bend towards +x. The tube is the prism over the
    regular n-gon inscribed in the given circle, n = round(π diameter / edge_length). Rolling up
    the structured mesh is therefore an exact isometry. The perimeter is smaller than π diameter by
    the fraction π²/(6 n²).

    Args:
        comm: Communicator; gmsh runs on its first rank only.
        length: Length of the tube in m.
        diameter: Diameter of the circle through the vertices, in m.
        edge_length: Target edge length in m.
        mesh: "unstructured" (gmsh, frontal Delaunay) or "structured" (right triangles with one
            diagonal direction, on which the curvature "average" is exact for quadratics).
        caps: Whether the ends are closed. An open tube cannot carry pressure.

    Raises:
        ParameterError: A size is not positive, or too large for a tube of six sides and two rows.
    """
    require_positive(length=length, diameter=diameter, edge_length=edge_length)
    require_choice("mesh", mesh, ("unstructured", "structured"))
    bound = min(np.pi * diameter / 5.5, length / 1.5)
    require_positive(edge_length=edge_length, at_most=bound)
    around = round(np.pi * diameter / edge_length)
    rows = max(2, round(length / edge_length))
    radius = diameter / 2
    chord = 2 * radius * np.sin(np.pi / around)
    width = around * chord

    def build() -> Pattern:
        if mesh == "structured":
            wall = _grid(around, rows, width, length)
            cap = ringed_disc(around, radius) if caps else None
        else:
            ring = circle(around, radius)
            corner = np.array([[0, 0], [width, 0], [width, length], [0, length]])
            outlines = [(corner, [around, rows, around, rows])]
            if caps:
                outlines.append((ring, [1] * around))
            meshes = polygon_meshes(outlines, edge_length)
            wall, cap = meshes[0], (meshes[1] if caps else None)
        panels = [_wall_panel(*wall, radius, width)]
        if cap is not None:
            panels += [_cap_panel(BASE, *cap, 0.0), _cap_panel(TIP, *cap, length)]
        return Pattern.from_panels(panels, tolerance=1e-3 * min(chord, length / rows))

    return on_first_rank(comm, build)


def _wall_panel(flat: Floats, triangles: Ints, radius: float, width: float) -> Panel:
    angle = np.pi + 2 * np.pi * flat[:, 0] / width
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Panel(WALL, flat, triangles, np.column_stack([ring, flat[:, 1]]))


def _cap_panel(name: str, flat: Floats, triangles: Ints, height: float) -> Panel:
    points = np.column_stack([flat, np.full(len(flat), height)])
    if name == BASE:  # seen from outside, that is from below, the disc is mirrored
        return Panel(name, flat * [1, -1], triangles[:, ::-1], points)
    return Panel(name, flat, triangles, points)


def _grid(around: int, rows: int, width: float, length: float) -> tuple[Floats, Ints]:
    u, v = np.meshgrid(np.linspace(0, width, around + 1), np.linspace(0, length, rows + 1))
    node = np.arange((rows + 1) * (around + 1)).reshape(rows + 1, around + 1)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    lower, upper = np.stack([a, b, c], axis=2), np.stack([b, d, c], axis=2)
    triangles = np.stack([lower, upper], axis=2).reshape(-1, 3)
    return np.column_stack([u.ravel(), v.ravel()]), triangles
