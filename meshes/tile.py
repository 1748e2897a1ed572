"""Rectangular patches of cloth that repeat: sewn into a torus, side by side, symmetric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import (
    checked_floats,
    real_numbers,
    require_choice,
    require_count,
    require_positive,
)
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.planar import glued
from toros_fem.meshes.sheet import grid, one_panel
from toros_fem.meshes.tile_symmetry import SAME, SYMMETRIES, check_symmetry, unstructured
from toros_fem.meshes.triangle_limit import require_affordable, require_fewer

TILE = "tile"
KINDS = ("right", "crossed", "union-jack", "unstructured")

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
        """Return a tile made of copies of this one.

        Args:
            along: Number of copies along x. The first copy is in its own place.
            across: Number of copies along y.

        Raises:
            ParameterError: A number is not whole, or less than 1.
        """
        require_count(1, along=along, across=across)
        copies_area = float(self.pattern.areas.sum()) * int(along) * int(across)
        require_fewer(len(self.wraps) * int(along) * int(across), copies_area)
        j, i = np.divmod(np.arange(along * across), along)
        copies = np.stack([i, j], axis=1)
        wraps, home = np.divmod(copies[:, None, None] + self.wraps, [along, across])
        places = self.pattern.points[:, :2]
        vertices = self.pattern.triangles + len(places) * (home[..., 0] + along * home[..., 1])
        return Repeated(
            tile=_sewn(
                (places + (copies @ self.lattice)[:, None]).reshape(-1, 2),
                vertices.reshape(-1, 3),
                wraps.reshape(-1, 3, 2),
                self.lattice * [[along], [across]],
            ),
            cell=np.tile(np.arange(len(self.wraps)), len(copies)),
        )

    def sheet(self, along: int, across: int) -> tuple[Pattern, Ints]:
        """Return an open sheet made of copies of this tile.

        Args:
            along: Number of copies along x. The first copy is in its own place.
            across: Number of copies along y.

        Returns:
            The pattern, whose single panel `sheet` has no seams, and the triangle of this tile
            that each of its triangles copies, shape (t · along · across,).

        Raises:
            ParameterError: A number is not whole, or less than 1.
        """
        whole = self.repeated(along, across)
        pattern = whole.tile.pattern
        return one_panel(pattern.flat_points, pattern.flat_triangles), whole.cell

    def nearest(self, places: Floats) -> tuple[Ints, Floats]:
        """Return the triangles with the nearest centroids to flat places on the torus.

        Args:
            places: Places in m, (k, 2), on any copy of the tile.

        Returns:
            The triangle, and the distance of its centroid in m, (k,) each.
        """
        places = checked_floats(
            "places", places, "(k, 2), in m", lambda shape: len(shape) == 2 and shape[1] == 2
        )
        size = np.diagonal(self.lattice)
        tree = cKDTree(_home(self.pattern.centroids, size), boxsize=size)
        away, found = tree.query(_home(places, size))
        return np.asarray(found, dtype=np.int64), np.asarray(away)

    def symmetry_maps(self, symmetry: str) -> Ints:
        """Return the triangle onto which each operation of a symmetry maps each one, shape (g, t).

        Args:
            symmetry: One of `SYMMETRIES`, where the operations are in the same order.

        Raises:
            ParameterError: The symmetry is unknown, or needs a square tile.
            PatternError: The mesh does not have the symmetry.
        """
        size = np.diagonal(self.lattice)
        check_symmetry(symmetry, size)
        symmetry_maps = []
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
            symmetry_maps.append(found)
        return np.array(symmetry_maps, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Repeated:
    """A tile made of copies of another.

    Attributes:
        tile: The larger tile.
        cell: Triangle of the original tile that each triangle copies, shape (t,).
    """

    tile: Tile
    cell: Ints


@collective("comm")
def tile(
    comm: MPI.Comm,
    size: float | tuple[float, float],
    edge_length: float,
    mesh: str = "crossed",
    symmetry: str = "none",
) -> Tile:
    """Make a tile [0, a] × [0, b] (collective).

    Args:
        comm: Communicator.
        size: Its sides (a, b) in m, or the side of a square.
        edge_length: Target edge length in m. The sides are divided evenly, in 3 edges at least, and
            in an even number of edges for union-jack and symmetric unstructured meshes.
        mesh: "right", "crossed", "union-jack" or "unstructured", as in `rectangle`.
        symmetry: Symmetry that the mesh has at least: "none", "orthotropic" (reflections in both
            middle lines, and so in the borders), "chiral" (rotations by 90°) or "tetragonal" (both,
            and reflections in the diagonals). Crossed and union-jack meshes have all symmetries
            that the sides allow. A chiral unstructured mesh is tetragonal.

    Raises:
        ParameterError: A length is not positive or too large, a name is unknown, or tile or mesh
            cannot have the symmetry.
        MeshSizeError: There would be more triangles than `triangle_limit` allows.
    """
    sides = real_numbers("size", size, "one side of a square in m, or two (a, b)")
    if sides.shape not in ((), (2,)):
        raise ParameterError(f"size = {size!r} must be one side of a square in m, or two (a, b).")
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

    def build() -> Tile:
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
        wraps = np.floor((flat + near) / sides).astype(int)
        places = flat - wraps * sides
        places[np.abs(places) <= near] = 0.0
        points, vertices = glued([(places, triangles)], near)
        return _sewn(points, vertices, wraps[triangles], np.diag(sides))

    return on_first_rank(comm, build)


def _home(places: Floats, size: Floats) -> Floats:
    """Return places on a torus in [0, size). A remainder may be rounded up to the size itself."""
    inside = places % size
    return np.asarray(np.where(inside < size, inside, 0.0))


def _sewn(places: Floats, vertices: Ints, wraps: Ints, lattice: Floats) -> Tile:
    """Sew a tile from the places (n, 2) of its vertices, and vertex and wraps of each corner."""
    # The flat rectangle is closed: it repeats a vertex on its border for each way to wrap.
    shape = (len(places), 2, 2)
    corners = np.ravel_multi_index((vertices, wraps[..., 0], wraps[..., 1]), shape)
    flat, flat_triangles = np.unique(corners, return_inverse=True)
    vertex, *wrap = np.unravel_index(flat, shape)
    pattern = Pattern(
        flat_points=places[vertex] + np.stack(wrap, axis=1) @ lattice,
        flat_triangles=flat_triangles.reshape(-1, 3),
        panel=np.zeros(len(vertices), dtype=np.int64),
        sewn=vertex,
        points=np.column_stack([places, np.zeros(len(places))]),
        panel_names=(TILE,),
    )
    return Tile(pattern, lattice, wraps)
