"""Target shapes that the user deforms in another program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import on_first_rank
from toros_fem._types import Floats, Ints
from toros_fem.errors import TargetError
from toros_fem.meshes.mesh_file import load
from toros_fem.meshes.pattern import Pattern


def from_mesh(comm: MPI.Comm, path: Path, pattern: Pattern) -> Floats:
    """Read target positions from a deformed copy of the assembled skin (collective).

    `meshio.write_points_cells(path, pattern.points, [("triangle", pattern.triangles)])` writes the
    skin to be deformed. Vertices are matched by their order, which the program must keep. OBJ, PLY
    and VTU files keep it; STL files do not.

    Args:
        comm: Communicator.
        path: A file that meshio reads, in m.
        pattern: The pattern. The mesh must have its vertices, in their order, and its triangles,
            in any order.

    Returns:
        Position of each assembled vertex, (n, 3), in m.

    Raises:
        TargetError: The file cannot be read, has a position that is not finite, or its mesh is
            not the pattern's.
    """
    return on_first_rank(comm, lambda: _read(Path(path), pattern))


def _read(path: Path, pattern: Pattern) -> Floats:
    mesh = load(path, TargetError, "OBJ, PLY or VTU")
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.shape != pattern.points.shape:
        raise TargetError(
            f"{path} has {len(points)} vertices in {points.shape[1]} dimensions; the skin has "
            f"{len(pattern.points)} in 3. Deform the skin itself, and keep the order of its "
            "vertices."
        )
    wrong = ~np.isfinite(points).all(axis=1)
    if wrong.any():
        vertex = int(np.flatnonzero(wrong)[0])
        raise TargetError(
            f"vertex {vertex} of {path} lies at {points[vertex]}, which is not finite."
        )
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    theirs = np.concatenate(blocks) if blocks else np.zeros((0, 3), dtype=np.int64)
    if len(theirs) != len(pattern.panel):
        raise TargetError(
            f"{path} has {len(theirs)} triangles; the skin has {len(pattern.panel)}. Deform the "
            "skin itself, and do not remesh it."
        )
    ours = _lowest_first(pattern.triangles)
    both = np.concatenate([ours, _lowest_first(theirs)])
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    missing = np.flatnonzero(~np.isin(number[: len(ours)], number[len(ours) :]))
    if len(missing):
        cell = int(missing[0])
        raise TargetError(
            f"triangle {cell} of the skin, between the vertices {pattern.triangles[cell]}, is not "
            f"in {path}: the vertices are in another order, or the surface is inside out. Export "
            "it so that the order is kept."
        )
    return points


def _lowest_first(triangles: Ints) -> Ints:
    """Return the same triangles, each one starting with its lowest corner."""
    first = np.argmin(triangles, axis=1)[:, None]
    rotated = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return np.asarray(rotated, dtype=np.int64)
