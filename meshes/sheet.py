"""Open sheets of one panel: rectangles and discs with meshes of several kinds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import require_callable, require_choice, require_positive
from toros_fem.meshes.gmsh_panels import polygon_mesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangle_limit import require_affordable

SHEET = "sheet"
KINDS = ("right", "left", "equilateral", "crossed", "union-jack", "unstructured")

Place = Callable[[Floats], Floats]


def one_panel(flat: Floats, triangles: Ints, place: Place | None = None) -> Pattern:
    """Make a pattern of one flat panel, `sheet`, without seams.

    Args:
        flat: Flat positions, (m, 2), in m.
        triangles: Corners among the flat positions, (t, 3), counter-clockwise.
        place: Maps flat positions to assembled ones, (m, 3). None: the sheet is in the plane z = 0.
    """
    points = np.column_stack([flat, np.zeros(len(flat))]) if place is None else place(flat)
    return Pattern(
        flat_points=flat,
        flat_triangles=triangles,
        panel=np.zeros(len(triangles), dtype=np.int64),
        sewn=np.arange(len(flat)),
        points=points,
        panel_names=(SHEET,),
    )


@collective("comm")
def rectangle(
    comm: MPI.Comm,
    length: float,
    width: float,
    edge_length: float,
    mesh: str = "right",
    place: Place | None = None,
) -> Pattern:
    """Make a rectangle [0, length] × [0, width] (collective).

    Args:
        comm: Communicator.
        length, width: Size in m.
        edge_length: Target edge length in m; the sides are divided evenly.
        mesh: "right" triangles with diagonals that fall along the length, "left" with diagonals
            that rise, "equilateral" ones (halved at two borders), "crossed" (four around each
            square's centre), "union-jack" (diagonals that alternate), or "unstructured" (gmsh).
        place: As in `one_panel`.

    Raises:
        ParameterError: A length is not positive, or the kind of mesh is unknown.
        MeshSizeError: There would be more triangles than `triangle_limit` allows.
    """
    require_positive(length=length, width=width)
    require_positive(edge_length=edge_length, at_most=min(length, width))
    require_choice("mesh", mesh, KINDS)
    _require_place(place)
    require_affordable(length * width, edge_length)

    def build() -> Pattern:
        along = round(length / edge_length)
        row = edge_length * np.sqrt(0.75) if mesh == "equilateral" else edge_length
        across = max(1, round(width / row))
        if mesh == "unstructured":
            corner = np.array([[0, 0], [length, 0], [length, width], [0, width]])
            sides = [along, across, along, across]
            return one_panel(*polygon_mesh(corner, edge_length, counts=sides), place)
        if mesh == "equilateral":
            unit, triangles = _staggered(along, across)
        else:
            unit, triangles = grid(along, across, mesh)
        return one_panel(unit * [length / along, width / across], triangles, place)

    return on_first_rank(comm, build)


@collective("comm")
def disc(
    comm: MPI.Comm,
    radius: float,
    edge_length: float,
    mesh: str = "structured",
    place: Place | None = None,
) -> Pattern:
    """Make a disc around the origin, with a regular polygon as its border (collective).

    Args:
        comm: Communicator.
        radius: Radius in m of the circle through the corners.
        edge_length: Target edge length in m.
        mesh: "structured" (rings around the centre) or "unstructured" (gmsh).
        place: As in `one_panel`.

    Raises:
        ParameterError: A length is not positive, or the kind of mesh is unknown.
        MeshSizeError: There would be more triangles than `triangle_limit` allows.
    """
    require_positive(radius=radius)
    require_positive(edge_length=edge_length, at_most=radius)
    require_choice("mesh", mesh, ("structured", "unstructured"))
    _require_place(place)
    require_affordable(np.pi * radius * radius, edge_length)

    def build() -> Pattern:
        around = round(2 * np.pi * radius / edge_length)
        if mesh == "structured":
            return one_panel(*ringed_disc(around, radius), place)
        return one_panel(*polygon_mesh(circle(around, radius), edge_length), place)

    return on_first_rank(comm, build)


def _require_place(place: Place | None) -> None:
    if place is not None:
        require_callable("place", place, "a function of the flat positions (m, 2), or None")


def circle(count: int, radius: float) -> Floats:
    """Return the corners of a regular polygon on a circle, (count, 2), starting at the angle π."""
    angle = np.pi + 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def sector(count: int, radius: float, parts: int) -> Floats:
    """Return the corners of `circle`, or of a part of it from the angle 0, both ends included."""
    if parts == 1:
        return circle(count, radius)
    place = (count // 2 + np.arange(count // parts + 1)) % count
    return circle(count, radius)[place]


def ringed_disc(around: int, radius: float, parts: int = 1) -> tuple[Floats, Ints]:
    """Mesh a disc by rings of vertices; neighbouring rings are connected in the order of angles.

    Args:
        around: Number of edges around the whole disc.
        radius: Radius in m.
        parts: 1 for the whole; 2 or 4 for the part of it between the angles 0 and 2π/parts.
    """
    rings = max(1, round(around / (2 * np.pi)))
    least = -(-3 // parts)
    # Edges of the part on each ring, from the outermost.
    counts = [max(least, round(around / parts * k / rings)) for k in range(rings, 0, -1)]
    points = np.concatenate(
        [sector(parts * n, radius * (rings - k) / rings, parts) for k, n in enumerate(counts)]
        + [np.zeros((1, 2))]
    )
    # A whole ring has as many vertices as edges, a part of it one more.
    sizes = [n + (parts > 1) for n in counts]
    start = np.cumsum([0, *sizes])
    triangles = []
    for k in range(rings - 1):  # all rings start at the same angle
        outer, inner = counts[k], counts[k + 1]
        i = j = 0
        while i < outer or j < inner:
            o, p = start[k] + i % sizes[k], start[k + 1] + j % sizes[k + 1]
            if (i + 0.5) / outer <= (j + 0.5) / inner:
                triangles.append([o, start[k] + (i + 1) % sizes[k], p])
                i += 1
            else:
                triangles.append([o, start[k + 1] + (j + 1) % sizes[k + 1], p])
                j += 1
    last, n, size = start[rings - 1], counts[-1], sizes[-1]
    triangles += [[last + i, last + (i + 1) % size, start[rings]] for i in range(n)]
    return points, np.array(triangles, dtype=np.int64)


def grid(along: int, across: int, kind: str) -> tuple[Floats, Ints]:
    """Mesh a rectangle of unit squares, each divided in two triangles or, if crossed, in four."""
    u, v = np.meshgrid(np.arange(along + 1.0), np.arange(across + 1.0))
    points = np.column_stack([u.ravel(), v.ravel()])
    node = np.arange(len(points)).reshape(across + 1, along + 1)
    a, b, d, c = (part.ravel() for part in
                  (node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]))  # fmt: skip
    if kind == "crossed":
        middle = len(points) + np.arange(len(a))
        points = np.concatenate([points, (points[a] + points[c]) / 2])
        corners = [(a, b), (b, c), (c, d), (d, a)]
        parts = [np.stack([one, two, middle], axis=1) for one, two in corners]
    else:
        i, j = np.divmod(np.arange(len(a)), along)
        rising = ((i + j) % 2 == 1) if kind == "union-jack" else np.full(len(a), kind == "left")
        parts = [
            np.stack([a, b, np.where(rising, c, d)], axis=1),
            np.stack([c, d, np.where(rising, a, b)], axis=1),
        ]
    return points, np.stack(parts, axis=1).reshape(-1, 3)


def _staggered(along: int, across: int) -> tuple[Floats, Ints]:
    """Mesh rows of unit height, every second one shifted by half an edge."""
    rows: list[Ints] = []
    points: list[tuple[float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for j in range(across + 1):
        inner = np.arange(along + 1.0) if j % 2 == 0 else np.arange(along) + 0.5
        u = inner if j % 2 == 0 else np.concatenate([[0], inner, [along]])
        rows.append(len(points) + np.arange(len(u)))
        points += [(x, float(j)) for x in u]
    for j in range(across):
        even, odd = (rows[j], rows[j + 1]) if j % 2 == 0 else (rows[j + 1], rows[j])
        up = j % 2 == 0  # whether the even row lies below
        strip = [(even[i], even[i + 1], odd[i + 1]) for i in range(along)]
        strip += [(odd[i + 1], odd[i], even[i]) for i in range(along + 1)]
        triangles += strip if up else [corners[::-1] for corners in strip]
    return np.array(points), np.array(triangles, dtype=np.int64)
