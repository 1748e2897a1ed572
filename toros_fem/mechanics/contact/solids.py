"""Rigid spheres, boxes and cylinders with even triangles, and bodies from mesh files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.base.validation import Floats, Ints, checked_floats, require_positive, unit_vector
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.meshes.files import read_surface
from toros_fem.meshes.triangles import (
    coincident,
    equilateral_edge,
    expected_triangles,
    require_affordable,
)

# Distance of facets from the round surface that default triangles keep to, over the radius and in
# m, as far as so many triangles allow it.
FLATNESS, SAGITTA, MOST = 0.01, 5e-5, 4000
# Golden ratio, of the icosahedron.
GOLDEN = (1 + np.sqrt(5)) / 2


def rigid_sphere(
    name: str,
    radius: float,
    centre: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    *,
    edge_length: float | None = None,
) -> RigidBody:
    """Return a sphere, an evenly subdivided icosahedron with the sphere's volume.

    So its vertices lie a little outside of the radius, the middles of its facets a little inside.
    Without an edge length facets lie within 1 % of the radius and 0.05 mm, but are at most some
    4000.
    """
    require_positive(radius=radius)
    area = 4 * np.pi * radius**2
    # A triangle with edges e lies at most e²/(6 R) below its circumscribed sphere.
    edge = _edge_length(edge_length, area, np.sqrt(6 * radius * _sagitta(radius)))
    corners = np.array([
        sign * np.roll([0.0, one, other * GOLDEN], turn)
        for turn in range(3) for sign in (1, -1) for one, other in ((1, 1), (1, -1))
    ])  # fmt: skip
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 2.1
    triples = np.array([
        (a, b, c) for a in range(12) for b in range(a) for c in range(b)
        if near[a, b] and near[b, c] and near[a, c]
    ])  # fmt: skip
    facing = np.linalg.det(corners[triples]) > 0
    triples = np.where(facing[:, None], triples, triples[:, ::-1])
    corners /= np.linalg.norm(corners[0])
    arc = np.arccos(corners[triples[0, 0]] @ corners[triples[0, 1]])
    count = max(1, round(float(np.sqrt(expected_triangles(area, edge) / 20))))
    rows, places, triangles = _divided_triangle(count)
    shares = np.column_stack([count - rows, rows - places, places]) / count
    # The weights of great circles on the edges; inside they keep the triangles even.
    points = np.einsum("pi,tij->tpj", np.sin(shares * arc), corners[triples])
    points /= np.linalg.norm(points, axis=2, keepdims=True)
    points, triangles = _joined(list(points), [triangles] * len(points), 0.1 / count)
    ball = RigidBody(name, points, triangles)
    scale = radius * (4 / 3 * np.pi / ball.volume) ** (1 / 3)
    return _made(name, scale * points, triangles, centre)


def rigid_box(
    name: str,
    size: Sequence[float] | Floats,
    centre: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    *,
    edge_length: float | None = None,
) -> RigidBody:
    """Return a box along the axes with given sides; `RigidBody.moved` turns it.

    Without an edge length there are some 1000 triangles of even size, or one a side where that is
    shorter.
    """
    sides = checked_floats("size", size, "three finite lengths, in m", (3,))
    require_positive(**{f"size[{k}]": float(side) for k, side in enumerate(sides)})
    area = 2 * float(sides @ np.roll(sides, 1))
    edge = _edge_length(edge_length, area, np.sqrt(2 * area / 1000))
    counts = np.maximum(1, np.rint(sides / edge).astype(int))
    points, triangles = [], []
    for k in range(3):
        one, other = (k + 1) % 3, (k + 2) % 3
        along, across = np.arange(counts[one] + 1), np.arange(counts[other] + 1)
        grid = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
        quads = _quads(counts[one], counts[other])
        for side in (1, -1):
            face = np.empty((len(grid), 3))
            face[:, [one, other]] = grid / counts[[one, other]] - 0.5
            face[:, k] = side / 2
            points.append(face)
            triangles.append(quads[:, ::side])
    whole = _joined(points, triangles, 0.1 / counts.max())
    return _made(name, whole[0] * sides, whole[1], centre)


def rigid_cylinder(
    name: str,
    radius: float,
    length: float,
    axis: Sequence[float] | Floats = (0.0, 0.0, 1.0),
    centre: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    *,
    edge_length: float | None = None,
) -> RigidBody:
    """Return a cylinder with flat ends, a prism with the cylinder's volume, as of `rigid_sphere`.

    Of the axis the length does not matter.
    """
    require_positive(radius=radius, length=length)
    upright = unit_vector("axis", axis, "that of the cylinder")
    area = 2 * np.pi * radius * (radius + length)
    # A chord e lies e²/(8 R) below the circle.
    edge = _edge_length(edge_length, area, np.sqrt(8 * radius * _sagitta(radius)))
    # Rings of 6, 12, 18 … vertices fill the ends with even triangles.
    rings = max(1, round(np.pi * radius / (3 * edge)))
    around, along = 6 * rings, max(1, round(length / edge))
    rows, places, cap = _divided_triangle(rings)
    turn = np.pi / 3 * (np.arange(6)[:, None] + places / np.maximum(rows, 1))
    sector = rows / rings * np.array([np.cos(turn), np.sin(turn)])
    ends = [
        np.column_stack([*sector[:, k], np.full(len(rows), side / 2)])
        for side in (1, -1) for k in range(6)
    ]  # fmt: skip
    turn, height = np.meshgrid(
        np.arange(around + 1) * (2 * np.pi / around), np.arange(along + 1) / along - 0.5,
        indexing="ij",
    )  # fmt: skip
    mantle = np.stack([np.cos(turn), np.sin(turn), height], axis=-1).reshape(-1, 3)
    points, triangles = _joined(
        [*ends, mantle],
        [cap] * 6 + [cap[:, ::-1]] * 6 + [_quads(around, along)],
        0.1 / max(around, along),
    )
    # The regular polygon has the circle's area.
    radius *= float(np.sqrt(2 * np.pi / (around * np.sin(2 * np.pi / around))))
    aside = np.cross(upright, np.eye(3)[np.argmin(np.abs(upright))])
    aside /= np.linalg.norm(aside)
    frame = np.array([radius * aside, radius * np.cross(upright, aside), length * upright])
    return _made(name, points @ frame, triangles, centre)


def rigid_mesh(
    comm: MPI.Comm,
    name: str,
    path: Path | str,
    *,
    scale: float = 1.0,
    component: int | None = None,
    centre: Sequence[float] | Floats | None = None,
) -> RigidBody:
    """Return a body from a mesh file of its closed surface, repaired as it is read (collective).

    Args:
        comm: Communicator; the first rank reads.
        name: The body's name.
        path: STL, OBJ, PLY, MSH, XDMF or another format of meshio.
        scale: Length of the file's unit in m, 1e-3 for mm.
        component: Connected component to read, 0 for the one of largest area. None: the file must
            have a single one.
        centre: Where its centroid shall be; None leaves it as in the file.

    Raises:
        SurfaceError: As of `read_surface` and `RigidBody`.
    """
    surface = read_surface(comm, path, scale, component)
    body = RigidBody(name, surface.points, surface.triangles)
    if centre is None:
        return body
    return _made(name, body.points - body.centre, body.triangles, centre)


def _made(
    name: str, points: Floats, triangles: Ints, centre: Sequence[float] | Floats
) -> RigidBody:
    place = checked_floats("centre", centre, "a finite point of three, in m", (3,))
    return RigidBody(name, points + place, triangles)


def _sagitta(radius: float) -> float:
    return min(FLATNESS * radius, SAGITTA)


def _edge_length(given: float | None, area: float, fine: float) -> float:
    """Return the length of the edges of a body's triangles in m.

    It is the given one, or one that is fine enough and grows where triangles would be too many.
    """
    if given is None:
        return float(max(fine, equilateral_edge(area / MOST)))
    require_positive(edge_length=given)
    require_affordable(area, given)
    return given


def _divided_triangle(count: int) -> tuple[Ints, Ints, Ints]:
    """Return a triangle divided into so many rows from one corner to the opposite side.

    That is the row of each vertex, from 0; its place in the row, 0 to the row's number; the
    triangles.
    """
    rows = np.repeat(np.arange(count + 1), np.arange(1, count + 2))
    begin = np.arange(count + 1) * np.arange(1, count + 2) // 2
    places = np.arange(len(rows)) - begin[rows]
    upper = np.arange(begin[count])  # all vertices with a row below them
    below = upper + rows[upper] + 1
    standing = np.column_stack([upper, below, below + 1])
    inner = upper[places[upper] < rows[upper]]
    hanging = np.column_stack([inner, inner + rows[inner] + 2, inner + 1])
    return rows, places, np.concatenate([standing, hanging])


def _quads(along: int, across: int) -> Ints:
    """Return triangles on a grid, counter-clockwise, with diagonals that alternate."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(along), np.arange(across), indexing="ij"))
    a = i * (across + 1) + j
    b, c, d = a + across + 1, a + across + 2, a + 1
    even = ((i + j) % 2 == 0)[:, None]
    one = np.where(even, np.column_stack([a, b, c]), np.column_stack([a, b, d]))
    two = np.where(even, np.column_stack([a, c, d]), np.column_stack([b, c, d]))
    return np.concatenate([one, two])


def _joined(
    points: Sequence[Floats], triangles: Sequence[Ints], reach: float
) -> tuple[Floats, Ints]:
    """Return pieces of a surface as one, with the vertices within `reach` of each other merged."""
    ahead = np.cumsum([0] + [len(piece) for piece in points])
    shifted = [piece + begin for piece, begin in zip(triangles, ahead, strict=False)]
    everything = np.concatenate(points)
    place = coincident(everything, reach)
    return everything[np.unique(place, return_index=True)[1]], place[np.concatenate(shifted)]
