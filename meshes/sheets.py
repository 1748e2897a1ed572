"""Sheets of one panel, open or closed to a tube: rectangles, discs, cylinders; moulded skins."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    Floats,
    Ints,
    checked_names,
    require_callable,
    require_choice,
    require_positive,
    shown,
    whole_numbers,
)
from toros_fem.meshes.panels import gmsh_model, meshed
from toros_fem.meshes.pattern import Panel, Pattern, checked_array, require_indices
from toros_fem.meshes.triangles import flat_areas, require_affordable

SHEET, WALL, BASE, TIP = "sheet", "wall", "base", "tip"
KINDS = ("right", "left", "equilateral", "crossed", "union-jack", "unstructured")
TUBE_KINDS = ("unstructured", "structured", "left", "union-jack", "crossed")
# Rounding of a coordinate, as a fraction of the tube's diameter or perimeter.
TINY = 1e-9
# Distance of neighbouring charts of a moulded skin over the longest edge: they do not touch.
PITCH = 1.1
Place = Callable[[Floats], Floats]


def one_panel(flat: Floats, triangles: Ints, place: Place | None = None) -> Pattern:
    """Make a pattern of one flat panel, `sheet`, without seams, at z = 0 or as `place` maps it."""
    return Pattern(
        flat_points=flat,
        flat_triangles=triangles,
        panel=np.zeros(len(triangles), dtype=np.int64),
        sewn=np.arange(len(flat)),
        points=np.column_stack([flat, np.zeros(len(flat))]) if place is None else place(flat),
        panel_names=(SHEET,),
    )


@on_root
def rectangle(
    comm: MPI.Comm,
    length: float,
    width: float,
    edge_length: float,
    mesh: str = "right",
    place: Place | None = None,
) -> Pattern:
    """Make a rectangle [0, length] × [0, width] in m (collective).

    The sides are divided evenly, in edges of about the edge length in m. The mesh has "right"
    triangles with diagonals that fall along the length, "left" with diagonals that rise,
    "equilateral" ones (halved at two borders), "crossed" (four around each square's centre),
    "union-jack" (diagonals that alternate), or is "unstructured" (gmsh). `place` maps flat
    positions (m, 2) to assembled ones, (m, 3), in m; by default the sheet is at z = 0.
    """
    require_positive(length=length, width=width)
    require_positive(edge_length=edge_length, at_most=min(length, width))
    require_choice("mesh", mesh, KINDS)
    _require_place(place)
    require_affordable(length * width, edge_length)
    along = round(length / edge_length)
    row = edge_length * np.sqrt(0.75) if mesh == "equilateral" else edge_length
    across = max(1, round(width / row))
    if mesh == "unstructured":
        corner = np.array([[0, 0], [length, 0], [length, width], [0, width]])
        sides = [along, across, along, across]
        return one_panel(*polygon_mesh(corner, edge_length, counts=sides), place)
    made = staggered(along, across) if mesh == "equilateral" else grid(along, across, mesh)
    return one_panel(made[0] * [length / along, width / across], made[1], place)


@on_root
def disc(
    comm: MPI.Comm,
    radius: float,
    edge_length: float,
    mesh: str = "structured",
    place: Place | None = None,
) -> Pattern:
    """Make a disc around the origin, with a regular polygon as its border (collective).

    Its corners are on a circle of the radius in m. The mesh is "structured" (rings around the
    centre) or "unstructured" (gmsh).
    """
    require_positive(radius=radius)
    require_positive(edge_length=edge_length, at_most=radius)
    require_choice("mesh", mesh, ("structured", "unstructured"))
    _require_place(place)
    require_affordable(np.pi * radius * radius, edge_length)
    around = round(2 * np.pi * radius / edge_length)
    if mesh == "structured":
        return one_panel(*ringed_disc(around, radius), place)
    return one_panel(*polygon_mesh(circle(around, radius), edge_length), place)


def _require_place(place: Place | None) -> None:
    if place is not None:
        require_callable("place", place, "a function of the flat positions (m, 2), or None")


@on_root
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
    regular n-gon inscribed in the given circle, n = round(π diameter / edge_length): rolling up the
    structured mesh is an exact isometry. The perimeter is smaller than π diameter by the fraction
    π²/(6 n²). Half a tube, or a quarter, is completed by `mirrored(part, (1,))` or
    `mirrored(part, (0, 1))`; n is then the nearest multiple of 2, or of 4.

    Args:
        length: Length of the tube in m.
        diameter: Diameter of the circle through the vertices, in m.
        mesh: "unstructured" (gmsh, frontal Delaunay); or rows of rectangles, each divided by the
            diagonal that falls along u ("structured", on which the curvature "average" is exact
            for quadratics), by the one that rises ("left"), by both in turn ("union-jack"), or in
            four ("crossed", which alone is rolled up with a small strain).
        caps: Ends that are closed: "both", "base", "tip", or None. An open end carries pressure
            only where a plane holds it, `symmetry_plane(pattern, 2, at=length)` at the tip.
        planes: Symmetry planes that cut the tube: () for the whole, (1,) for the half at y ≥ 0,
            (0, 1) for the quarter that also has x ≥ 0. The cut is not sewn.

    Raises:
        ParameterError: The edges are too long for a tube of six sides and two rows.
    """
    require_positive(length=length, diameter=diameter, edge_length=edge_length)
    require_choice("mesh", mesh, TUBE_KINDS)
    if caps is not None:
        require_choice("caps", caps, ("both", BASE, TIP))
    require_positive(edge_length=edge_length, at_most=min(np.pi * diameter / 5.5, length / 1.5))
    listed = isinstance(planes, list | tuple)
    if not listed or tuple(planes) not in ((), (1,), (0, 1), (1, 0)):
        raise ParameterError(
            f"planes = {shown(planes)} must be () for the whole tube, (1,) for the half at y ≥ 0, "
            "or (0, 1) for the quarter with x ≥ 0 as well."
        )
    parts = 2 ** len(planes)
    require_affordable(np.pi * diameter * (length + diameter / 2) / parts, edge_length)
    # Vertices must lie in all planes.
    around = parts * max(2, round(np.pi * diameter / edge_length / parts))
    sides, rows = around // parts, max(2, round(length / edge_length))
    radius = diameter / 2
    chord = 2 * radius * np.sin(np.pi / around)
    begin = around // 2 * chord if planes else 0.0
    end = begin + sides * chord

    def meshes() -> list[tuple[Floats, Ints]]:
        """Return flat points and triangles of the wall and, if there are any, of the caps."""
        if mesh != "unstructured":
            unit, triangles = grid(sides, rows, "right" if mesh == "structured" else mesh)
            flat = unit * [(end - begin) / sides, length / rows] + [begin, 0.0]
            return [(flat, triangles), *([ringed_disc(around, radius, parts)] if caps else [])]
        corner = np.array([[begin, 0], [end, 0], [end, length], [begin, length]])
        wall = polygon_mesh(corner, edge_length, counts=[sides, rows, sides, rows])
        if not caps:
            return [wall]
        rim, counts = sector(around, radius, parts), [1] * sides
        across = max(1, round(radius / edge_length))
        if parts == 2:
            counts.append(2 * across)
        elif parts == 4:
            rim, counts = np.concatenate([rim, np.zeros((1, 2))]), [*counts, across, across]
        return [wall, polygon_mesh(rim, edge_length, counts=counts)]

    wall, *cap = meshes()
    panels = [_wall_panel(*wall, radius, around * chord, begin)]
    for name, height in ((BASE, 0.0), (TIP, length)) if cap else ():
        if caps in ("both", name):
            flat, triangles = cap[0]
            points = np.column_stack([flat, np.full(len(flat), height)])
            if name == BASE:  # seen from outside, that is from below, the disc is mirrored
                flat, triangles = flat * [1, -1], triangles[:, ::-1]
            panels.append(Panel(name, flat, triangles, points))
    if planes:  # the cut is exactly in its plane
        for panel in panels:
            panel.points[np.abs(panel.points) < TINY * diameter] = 0.0
    return Pattern.from_panels(panels, tolerance=1e-3 * min(chord, length / rows))


def _wall_panel(flat: Floats, triangles: Ints, radius: float, width: float, begin: float) -> Panel:
    angle = np.pi + 2 * np.pi * flat[:, 0] / width
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # `mirrored` continues a panel across its first cut edge: it shall be that at x > 0.
    at_begin = (flat[triangles, 0] - begin < TINY * width).sum(axis=1) == 2
    triangles = triangles[np.argsort(~at_begin, kind="stable")] if begin else triangles
    return Panel(WALL, flat, triangles, np.column_stack([ring, flat[:, 1]]))


def moulded(
    points: npt.ArrayLike,
    triangles: npt.ArrayLike,
    panel: npt.ArrayLike | None = None,
    panel_names: Sequence[str] = ("skin",),
) -> Pattern:
    """Return a skin that is free of membrane stress in the given shape, however curved it is.

    Every triangle has a flat chart of its own, congruent to it in space; its first axis runs along
    its first edge. What needs cloth cut from flat panels is refused (docs/geometry.md): the cone
    filter, prints, lines, courses of a knit, transfer between meshes. For bending the rest shape
    is the choice of `Bending.rest`: "assembled" for a shell without moments in this shape.

    Points are (n, 3) in m, triangles (t, 3), counter-clockwise seen from outside. `panel`, (t,), is
    the number of the panel of each triangle, by which parts of the skin are named; None for one.
    """
    places = checked_array("points", points, float, 3, PatternError)
    corners = checked_array("triangles", triangles, int, 3, PatternError)
    require_indices(PatternError, triangles=(corners, len(places)))
    a, b, c = np.moveaxis(places[corners], 1, 0)
    length = np.linalg.norm(b - a, axis=1)
    if not (length > 0).all():
        k = int(np.argmin(length > 0))
        raise PatternError(f"triangle {k} has an edge of length {length[k]:g} m. Collapse it.")
    along = (b - a) / length[:, None]
    flat = np.zeros((len(corners), 3, 2))
    flat[:, 1, 0] = length
    flat[:, 2, 0] = np.einsum("ij,ij->i", c - a, along)
    flat[:, 2, 1] = np.linalg.norm(np.cross(along, c - a), axis=1)
    flat -= flat.min(axis=1, keepdims=True)
    number = np.arange(len(corners))
    columns = int(np.ceil(np.sqrt(len(corners))))
    place = np.stack([number % columns, number // columns], axis=1)
    flat += (PITCH * float(flat.max()) * place)[:, None]
    return Pattern(
        flat_points=flat.reshape(-1, 2),
        flat_triangles=np.arange(3 * len(corners)).reshape(-1, 3),
        panel=0 * number if panel is None else whole_numbers("panel", panel, "(t,)", PatternError),
        sewn=corners.ravel(),
        points=places,
        panel_names=checked_names("panel_names", panel_names, PatternError),
        moulded=True,
    )


# ------------------------------------------------------------------------- grids, rings, polygons


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

    `around` is the number of edges around the whole disc, the radius is in m. `parts` is 1 for the
    whole, 2 or 4 for the part of it between the angles 0 and 2π/parts.
    """
    rings = max(1, round(around / (2 * np.pi)))
    least = -(-3 // parts)
    # Edges of the part on each ring, from the outermost.
    counts = [max(least, round(around / parts * k / rings)) for k in range(rings, 0, -1)]
    circles = [sector(parts * n, radius * (rings - k) / rings, parts) for k, n in enumerate(counts)]
    # A whole ring has as many vertices as edges, a part of it one more.
    sizes = [len(points) for points in circles]
    start = np.cumsum([0, *sizes])
    triangles = []
    for k in range(rings - 1):  # all rings start at the same angle
        middles = np.concatenate([(np.arange(n) + 0.5) / n for n in counts[k : k + 2]])
        order = np.argsort(middles, kind="stable")
        outside = order < counts[k]  # whether the edge at this angle is on the outer ring
        outer: Ints = np.cumsum(outside) - outside
        inner: Ints = np.cumsum(~outside) - ~outside
        a, b = start[k] + outer % sizes[k], start[k + 1] + inner % sizes[k + 1]
        after = start[k] + (outer + 1) % sizes[k], start[k + 1] + (inner + 1) % sizes[k + 1]
        triangles.append(np.stack([a, np.where(outside, *after), b], axis=1))
    last, n = start[rings - 1], np.arange(counts[-1])
    centre = np.full(len(n), start[rings])
    triangles.append(np.stack([last + n, last + (n + 1) % sizes[-1], centre], axis=1))
    return np.concatenate([*circles, np.zeros((1, 2))]), np.concatenate(triangles).astype(np.int64)


def grid(along: int, across: int, kind: str) -> tuple[Floats, Ints]:
    """Mesh a rectangle of unit squares, each divided in two triangles or, if crossed, in four."""
    u, v = np.meshgrid(np.arange(along + 1.0), np.arange(across + 1.0))
    points = np.column_stack([u.ravel(), v.ravel()])
    node = np.arange(len(points)).reshape(across + 1, along + 1)
    a, b, d, c = (
        part.ravel() for part in (node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:])
    )
    if kind == "crossed":
        middle = len(points) + np.arange(len(a))
        points = np.concatenate([points, (points[a] + points[c]) / 2])
        parts: list[tuple[Ints, ...]] = [
            (a, b, middle), (b, c, middle), (c, d, middle), (d, a, middle)
        ]  # fmt: skip
    else:
        i, j = np.divmod(np.arange(len(a)), along)
        rising = ((i + j) % 2 == 1) if kind == "union-jack" else np.full(len(a), kind == "left")
        parts = [(a, b, np.where(rising, c, d)), (c, d, np.where(rising, a, b))]
    return points, np.array(parts).transpose(2, 0, 1).reshape(-1, 3)


def staggered(along: int, across: int) -> tuple[Floats, Ints]:
    """Mesh rows of unit height, every second one shifted by half an edge."""
    even, odd = np.arange(along + 1.0), np.clip(np.arange(along + 2) - 0.5, 0, along)
    rows = [odd if j % 2 else even for j in range(across + 1)]
    start = np.cumsum([0] + [len(u) for u in rows])
    points = np.concatenate([np.column_stack([u, np.full(len(u), j)]) for j, u in enumerate(rows)])
    i, triangles = np.arange(along + 1), []
    for j in range(across):
        e, o = i + start[j + j % 2], i + start[j + 1 - j % 2]
        strip = np.concatenate(
            [np.stack([e, e + 1, o + 1], axis=1)[:-1], np.stack([o + 1, o, e], axis=1)]
        )
        triangles.append(strip[:, ::-1] if j % 2 else strip)
    return points, np.concatenate(triangles)


def polygon_mesh(
    corners: Floats,
    edge_length: float,
    *,
    counts: Sequence[int] | None = None,
    faces: Sequence[Ints] | None = None,
) -> tuple[Floats, Ints]:
    """Mesh a flat polygon, or several ones that share corners and sides (one rank: gmsh is serial).

    The side that starts at each corner, (k, 2) in m, is divided evenly in its count of edges, by
    default one, so that two sides of equal length and count can be sewn together. Faces are the
    corners of each polygon, counter-clockwise; by default all are of one. Returned are flat points
    (m, 2) in m and counter-clockwise triangles (t, 3).
    """
    with gmsh_model(edge_length) as gmsh:
        geo = gmsh.model.geo
        points = [geo.addPoint(x, y, 0, edge_length) for x, y in corners]
        sides: dict[tuple[int, int], int] = {}
        for face in [np.arange(len(corners))] if faces is None else faces:
            loop = []
            for a, b in zip(map(int, face), map(int, np.roll(face, -1)), strict=True):
                if (b, a) not in sides:
                    sides[a, b] = geo.addLine(points[a], points[b])
                    geo.mesh.setTransfiniteCurve(sides[a, b], 1 + (int(counts[a]) if counts else 1))
                loop.append(sides[a, b] if (a, b) in sides else -sides[b, a])
            geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.synchronize()
        places, triangles, _ = meshed(gmsh)
    flat = places[:, :2]
    clockwise = flat_areas(flat[triangles]) < 0
    return flat, np.where(clockwise[:, None], triangles[:, ::-1], triangles)
