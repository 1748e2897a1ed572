"""Meshes of flat pieces: grids, rings, and polygons by gmsh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.gmsh_model import gmsh_model, meshed
from toros_fem.meshes.triangles import flat_areas


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
