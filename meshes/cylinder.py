"""A tube: one rectangle rolled up, and round caps at both ends, one, or none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import require_choice, require_positive, shown
from toros_fem.meshes.gmsh_panels import polygon_mesh
from toros_fem.meshes.pattern import Panel, Pattern
from toros_fem.meshes.sheet import grid, ringed_disc, sector
from toros_fem.meshes.triangle_limit import require_affordable

WALL, BASE, TIP = "wall", "base", "tip"
KINDS = ("unstructured", "structured", "left", "union-jack", "crossed")
# Rounding of a coordinate, as a fraction of the tube's diameter or perimeter.
TINY = 1e-9


@collective("comm")
def cylinder(
    comm: MPI.Comm,
    length: float,
    diameter: float,
    edge_length: float,
    *,
    mesh: str = "unstructured",
    caps: str | None = "both",
    planes: Sequence[int] = (),
) -> Pattern:
    """Make a tube along z from z = 0 (panel "base") to z = length (panel "tip") (collective).

    The wall is one flat rectangle, u around the tube and v = z along it. It is sewn along the line
    in the half-plane y = 0, x < 0: the outside of a bend towards +x. The tube is the prism over the
    regular n-gon inscribed in the given circle, n = round(π diameter / edge_length). Rolling up
    the structured mesh is therefore an exact isometry. The perimeter is smaller than π diameter by
    the fraction π²/(6 n²).

    Half a tube, or a quarter, is completed by `mirrored(part, (1,))` or `mirrored(part, (0, 1))`:
    the wall continues across the plane at x > 0 and has its seam where the whole tube has it. Its
    flat coordinates are those in the whole. n is then the nearest multiple of 2, or of 4.

    Args:
        comm: Communicator; gmsh runs on its first rank only.
        length: Length of the tube in m.
        diameter: Diameter of the circle through the vertices, in m.
        edge_length: Target edge length in m.
        mesh: "unstructured" (gmsh, frontal Delaunay); or rows of rectangles, each divided by the
            diagonal that falls along u ("structured", on which the curvature "average" is exact
            for quadratics), by the one that rises ("left"), by both in turn ("union-jack"), or in
            four ("crossed"). The centres of crossed rectangles lie on the circle, so that this
            mesh alone of them is rolled up with a small strain.
        caps: Ends that are closed: "both", "base", "tip", or None. An open end carries pressure
            only where a symmetry plane holds it: `symmetry_plane(pattern, 2)` at z = 0,
            `symmetry_plane(pattern, 2, at=length)` at the tip.
        planes: Symmetry planes that cut the tube: () for the whole, (1,) for the half at y ≥ 0,
            (0, 1) for the quarter that also has x ≥ 0. The cut is not sewn.

    Raises:
        ParameterError: A size is not positive, or too large for a tube of six sides and two rows;
            or the planes, the caps or the kind of mesh are others.
        MeshSizeError: There would be more triangles than `triangle_limit` allows.
    """
    require_positive(length=length, diameter=diameter, edge_length=edge_length)
    require_choice("mesh", mesh, KINDS)
    if caps is not None:
        require_choice("caps", caps, ("both", BASE, TIP))
    bound = min(np.pi * diameter / 5.5, length / 1.5)
    require_positive(edge_length=edge_length, at_most=bound)
    listed = isinstance(planes, list | tuple)
    if not listed or tuple(planes) not in ((), (1,), (0, 1), (1, 0)):
        raise ParameterError(
            f"planes = {shown(planes)} must be () for the whole tube, (1,) for the half at y ≥ 0, "
            "or (0, 1) for the quarter with x ≥ 0 as well."
        )
    parts = 2 ** len(planes)
    # Vertices must lie in all planes.
    require_affordable(np.pi * diameter * (length + diameter / 2) / parts, edge_length)
    around = parts * max(2, round(np.pi * diameter / edge_length / parts))
    sides, rows = around // parts, max(2, round(length / edge_length))
    radius = diameter / 2
    chord = 2 * radius * np.sin(np.pi / around)
    begin = around // 2 * chord if planes else 0.0
    end = begin + sides * chord

    def build() -> Pattern:
        if mesh != "unstructured":
            wall = _grid(sides, rows, begin, end, length, mesh)
            cap = ringed_disc(around, radius, parts) if caps else None
        else:
            corner = np.array([[begin, 0], [end, 0], [end, length], [begin, length]])
            wall = polygon_mesh(corner, edge_length, counts=[sides, rows, sides, rows])
            cap = None
            if caps:
                rim, counts = _cap_outline(around, radius, parts, edge_length)
                cap = polygon_mesh(rim, edge_length, counts=counts)
        panels = [_wall_panel(*wall, radius, around * chord, begin)]
        if cap is not None:
            ends = ((BASE, 0.0), (TIP, length))
            panels += [_cap_panel(name, *cap, z) for name, z in ends if caps in ("both", name)]
        if planes:  # the cut is exactly in its plane
            for panel in panels:
                panel.points[np.abs(panel.points) < TINY * diameter] = 0.0
        return Pattern.from_panels(panels, tolerance=1e-3 * min(chord, length / rows))

    return on_first_rank(comm, build)


def _cap_outline(
    around: int, radius: float, parts: int, edge_length: float
) -> tuple[Floats, list[int]]:
    """Return corners of a cap, or of its part, and the number of edges between them."""
    rim = sector(around, radius, parts)
    if parts == 1:
        return rim, [1] * around
    arc, across = [1] * (len(rim) - 1), max(1, round(radius / edge_length))
    if parts == 2:
        return rim, [*arc, 2 * across]
    return np.concatenate([rim, np.zeros((1, 2))]), [*arc, across, across]


def _wall_panel(flat: Floats, triangles: Ints, radius: float, width: float, begin: float) -> Panel:
    angle = np.pi + 2 * np.pi * flat[:, 0] / width
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # `mirrored` continues a panel across its first cut edge: it shall be that at x > 0.
    at_begin = (flat[triangles, 0] - begin < TINY * width).sum(axis=1) == 2
    triangles = triangles[np.argsort(~at_begin, kind="stable")] if begin else triangles
    return Panel(WALL, flat, triangles, np.column_stack([ring, flat[:, 1]]))


def _cap_panel(name: str, flat: Floats, triangles: Ints, height: float) -> Panel:
    points = np.column_stack([flat, np.full(len(flat), height)])
    if name == BASE:  # seen from outside, that is from below, the disc is mirrored
        return Panel(name, flat * [1, -1], triangles[:, ::-1], points)
    return Panel(name, flat, triangles, points)


def _grid(
    around: int, rows: int, begin: float, end: float, length: float, kind: str
) -> tuple[Floats, Ints]:
    unit, triangles = grid(around, rows, "right" if kind == "structured" else kind)
    return unit * [(end - begin) / around, length / rows] + [begin, 0.0], triangles
