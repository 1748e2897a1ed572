"""Rectangular patches of cloth that repeat: sewn into a torus, side by side, symmetric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_floats,
    require_choice,
    require_count,
    require_positive,
)
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.outlines import without_bridges
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import grid, one_panel, polygon_mesh
from toros_fem.meshes.triangles import coincident, require_affordable, require_fewer

TILE = "tile"
KINDS = ("right", "crossed", "union-jack", "unstructured")
_TURNS = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]])
_FLIP = np.array([[-1, 0], [0, 1]])
# The operations of each symmetry, matrices (g, 2, 2), the identity first. They act about the
# rectangle's middle or its corner, which is the same up to lattice vectors.
SYMMETRIES: dict[str, Ints] = {
    "none": _TURNS[:1],
    "orthotropic": np.array([_TURNS[0], _FLIP, -_FLIP, _TURNS[2]]),
    "chiral": _TURNS,
    "tetragonal": np.concatenate([_TURNS, _TURNS @ _FLIP]),
}
# Points closer than this fraction of an edge, and centroids than this fraction of a tile, coincide.
SAME = 1e-6
# With fewer edges along a side two edges of the torus would have the same ends.
LEAST = 3


@dataclass(frozen=True, eq=False)
class Tile:
    """A rectangular patch of cloth that repeats, sewn into a torus on its flat pattern.

    Attributes:
        pattern: One panel, `tile`, with opposite borders sewn to each other. Its flat points fill
            the closed rectangle [0, a] × [0, b]. Each assembled vertex has its own place in
            [0, a) × [0, b), z = 0, in m.
        lattice: The two vectors by which it repeats, rows of (2, 2), in m.
        wraps: Numbers of lattice vectors from the vertex's own place to each corner, shape
            (t, 3, 2): corner k of triangle t is at `points[vertex, :2] + wraps[t, k] @ lattice`.
    """

    pattern: Pattern
    lattice: Floats
    wraps: Ints

    def repeated(self, along: int, across: int) -> Repeated:
        """Return a tile of copies of this one along x and across, the first in its own place."""
        require_count(1, along=along, across=across)
        count = int(along) * int(across)
        require_fewer(len(self.wraps) * count, float(self.pattern.areas.sum()) * count)
        j, i = np.divmod(np.arange(count), along)
        copies = np.stack([i, j], axis=1)
        wraps, home = np.divmod(copies[:, None, None] + self.wraps, [along, across])
        places = self.pattern.points[:, :2]
        vertices = self.pattern.triangles + len(places) * (home[..., 0] + along * home[..., 1])
        larger = _sewn(
            (places + (copies @ self.lattice)[:, None]).reshape(-1, 2),
            vertices.reshape(-1, 3),
            wraps.reshape(-1, 3, 2),
            self.lattice * [[along], [across]],
        )
        return Repeated(larger, np.tile(np.arange(len(self.wraps)), count))

    def sheet(self, along: int, across: int) -> tuple[Pattern, Ints]:
        """Return an open sheet made of copies of this tile, as those of `repeated`.

        Its single panel `sheet` has no seams. The second array has the triangle of this tile that
        each triangle copies, shape (t · along · across,).
        """
        whole = self.repeated(along, across)
        pattern = whole.tile.pattern
        return one_panel(pattern.flat_points, pattern.flat_triangles), whole.cell

    def following(
        self,
        comm: MPI.Comm,
        region: BaseGeometry,
        edge_length: float | None = None,
        *,
        coarser: float = 1.0,
    ) -> tuple[Tile, Bools]:
        """Return the tile on a mesh whose edges are the borders of a region (collective).

        Opposite borders have the same vertices. The second array tells whether each triangle lies
        in the region, (t,).

        Args:
            comm: Communicator.
            region: Polygons in m, in the tile; what leaves it is cut off.
            edge_length, coarser: As of `bordered`.

        Raises:
            PatternError, ParameterError, MeshSizeError: As of `bordered`.
        """
        found, inside = bordered(comm, self.pattern, [region], edge_length, coarser=coarser)
        # Its assembled points mean nothing: some lie between vertices on opposite borders.
        made, sides = found.pattern, np.diagonal(self.lattice)
        _, first = np.unique(made.sewn, return_index=True)
        wraps, places = _home(made.flat_points, sides, SAME * sides.min())
        wraps = wraps[made.flat_triangles]
        return _sewn(places[first], made.triangles, wraps, self.lattice), inside

    def nearest(self, places: Floats) -> tuple[Ints, Floats]:
        """Return the triangles, (k,), with the nearest centroids to places on the torus, (k, 2).

        The second array has their distances in m. Places may be on any copy of the tile.
        """
        places = checked_floats(
            "places", places, "(k, 2), in m", lambda shape: len(shape) == 2 and shape[1] == 2
        )
        size = np.diagonal(self.lattice)

        def home(places: Floats) -> Floats:
            inside = places % size
            return np.asarray(np.where(inside < size, inside, 0.0))  # may be rounded up to size

        tree = cKDTree(home(self.pattern.centroids), boxsize=size)
        away, found = tree.query(home(places))
        return np.asarray(found, dtype=np.int64), np.asarray(away)

    def symmetry_maps(self, symmetry: str) -> Ints:
        """Return the triangle onto which each operation of `SYMMETRIES` maps each one, (g, t)."""
        size = np.diagonal(self.lattice)
        check_symmetry(symmetry, size)
        maps = []
        for operation in SYMMETRIES[symmetry]:
            found, away = self.nearest(self.pattern.centroids @ operation.T)
            away = away / size.min()
            worst = int(np.argmax(away))
            if away[worst] > SAME:
                raise PatternError(
                    f"the tile's mesh is not {symmetry}: {operation.tolist()} maps triangle "
                    f"{worst} to a place {away[worst]:.2g} of the tile away from the nearest one; "
                    f"the bound is {SAME:g}. Make the tile with symmetry={symmetry!r}, and a mesh "
                    "other than 'right'."
                )
            maps.append(found)
        return np.array(maps, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Repeated:
    """A tile made of copies of another, and the triangle that each of its own copies, (t,)."""

    tile: Tile
    cell: Ints


@on_root
def tile(
    comm: MPI.Comm,
    size: float | tuple[float, float],
    edge_length: float,
    mesh: str = "crossed",
    symmetry: str = "none",
) -> Tile:
    """Make a tile [0, a] × [0, b] (collective).

    Args:
        size: Its sides (a, b) in m, or the side of a square.
        edge_length: Target edge length in m. The sides are divided evenly, in 3 edges at least, and
            in an even number of edges for union-jack and symmetric unstructured meshes.
        mesh: "right", "crossed", "union-jack" or "unstructured", as in `rectangle`.
        symmetry: Symmetry that the mesh has at least: "none", "orthotropic" (reflections in both
            middle lines, and so in the borders), "chiral" (rotations by 90°) or "tetragonal" (both,
            and reflections in the diagonals). Crossed and union-jack meshes have all symmetries
            that the sides allow. A chiral unstructured mesh is tetragonal.

    Raises:
        ParameterError: A length is too large, or tile or mesh cannot have the symmetry.
    """
    what = "one side of a square in m, or two (a, b)"
    sides = checked_floats("size", size, what, lambda shape: shape in ((), (2,)))
    sides = np.broadcast_to(sides, 2)
    require_positive(**{f"size[{k}]": side for k, side in enumerate(sides)})
    # Anything longer would be rounded to fewer edges along the shorter side.
    require_positive(edge_length=edge_length, at_most=sides.min() / (LEAST - 0.5))
    require_choice("mesh", mesh, KINDS)
    check_symmetry(symmetry, sides)
    require_affordable(float(sides.prod()), edge_length)
    if mesh == "right" and symmetry != "none":
        raise ParameterError(
            f"mesh = 'right' cannot be {symmetry}: all its diagonals are parallel. Use 'crossed', "
            "'union-jack' or 'unstructured'."
        )
    if mesh == "union-jack" or (mesh == "unstructured" and symmetry != "none"):
        counts = np.maximum(2 * np.rint(sides / (2 * edge_length)).astype(int), LEAST + 1)
    else:
        counts = np.maximum(np.rint(sides / edge_length).astype(int), LEAST)
    if mesh == "unstructured":
        flat, triangles = unstructured(sides, counts, symmetry)
    else:
        unit, triangles = grid(int(counts[0]), int(counts[1]), mesh)
        flat = unit * (sides / counts)
    near = SAME * (sides / counts).min()
    wraps, places = _home(flat, sides, near)
    vertex = coincident(places, near)
    places = places[np.unique(vertex, return_index=True)[1]]
    return _sewn(places, vertex[triangles], wraps[triangles], np.diag(sides))


def _home(flat: Floats, sides: Floats, near: float) -> tuple[Ints, Floats]:
    """Return the wraps of flat points, (m, 2), and their own places; near 0 m they are 0 m."""
    wraps = np.floor((flat + near) / sides).astype(int)
    places = flat - wraps * sides
    places[np.abs(places) <= near] = 0.0
    return wraps, places


def _sewn(places: Floats, vertices: Ints, wraps: Ints, lattice: Floats) -> Tile:
    """Sew a tile from the places (n, 2) of its vertices, and vertex and wraps of each corner."""
    # The flat rectangle is closed: it repeats a vertex on its border for each way to wrap.
    corners = np.concatenate([vertices[..., None], wraps], axis=2).reshape(-1, 3)
    flat, flat_triangles = np.unique(corners, axis=0, return_inverse=True)
    vertex, wrap = flat[:, 0], flat[:, 1:]
    pattern = Pattern(
        flat_points=places[vertex] + wrap @ lattice,
        flat_triangles=flat_triangles.reshape(-1, 3),
        panel=np.zeros(len(vertices), dtype=np.int64),
        sewn=vertex,
        points=np.column_stack([places, np.zeros(len(places))]),
        panel_names=(TILE,),
    )
    return Tile(pattern, lattice, wraps)


def check_symmetry(symmetry: str, sides: Floats) -> None:
    """Check that a rectangle with these sides in m can have a symmetry."""
    require_choice("symmetry", symmetry, tuple(SYMMETRIES))
    turned = np.abs(SYMMETRIES[symmetry]) @ sides
    if not np.allclose(turned, sides, rtol=1e-9, atol=0):
        raise ParameterError(
            f"a tile of {sides[0]:.6g} m × {sides[1]:.6g} m cannot be {symmetry}, which needs a "
            "square. Make the sides equal, or use 'orthotropic'."
        )


def unstructured(sides: Floats, counts: Ints, symmetry: str) -> tuple[Floats, Ints]:
    """Mesh [0, a] × [0, b] with opposite borders that match and with a symmetry (one rank).

    Only a fundamental region is meshed: all, a quarter, or an eighth. Its images are side by side
    and share no points; points on common lines coincide up to rounding. Each side has a number of
    edges, an even one if there is a symmetry. A chiral mesh is tetragonal, which includes it.
    """
    group = "tetragonal" if symmetry == "chiral" else symmetry
    high, half = sides / 2, counts // 2
    low = -high if group == "none" else np.zeros(2)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    divisions = [*(counts if group == "none" else half)] * 2
    if group == "tetragonal":
        corners, divisions = corners[:3], [half[0], half[0], round(np.sqrt(2) * half[0])]
    near = SAME * (sides / counts).min()
    region, triangles = polygon_mesh(corners, (sides / counts).min(), counts=divisions)
    for axis in (0, 1):
        # An edge between parallel lines of symmetry would have the same ends as its image.
        lines = region[:, axis].min(), region[:, axis].max()
        on = (np.abs(region[:, axis, None] - lines) <= near).any(axis=1)
        region, triangles, _ = without_bridges(region, triangles, on, ())
    operations = SYMMETRIES[group]
    # A reflection turns triangles over.
    images = [
        len(region) * k + (triangles if np.linalg.det(operation) > 0 else triangles[:, ::-1])
        for k, operation in enumerate(operations)
    ]
    points = np.concatenate([region @ operation.T for operation in operations])
    return points + high, np.concatenate(images)
