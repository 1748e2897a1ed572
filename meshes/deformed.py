"""Target shapes that the user deforms in another program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import TargetError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import checked_path, real_numbers, require_kind
from toros_fem.meshes.mesh_file import load
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surface import Surface

# Corners that are apart by this fraction of the skin's size are different vertices.
APART = 1e-5


@collective("comm")
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
    path = checked_path("path", path, TargetError)
    require_kind("pattern", pattern, Pattern, "a Pattern")
    return on_first_rank(comm, lambda: _read(path, pattern))


def from_copy(
    comm: MPI.Comm, original: Path, deformed: Path, pattern: Pattern | Surface, scale: float
) -> Floats:
    """Read target positions from a deformed copy of the mesh file that a pattern comes from.

    Triangles are matched by their order, which a program that deforms keeps in all formats. It is
    collective.

    Args:
        comm: Communicator.
        original: Mesh file that the pattern was made from by `read_surface` and `unwrap`.
        deformed: The same mesh, deformed.
        pattern: The pattern, or the surface that it is made of.
        scale: Length of the unit of both files in m.

    Returns:
        Position of each assembled vertex, (n, 3), in m.

    Raises:
        TargetError: A file cannot be read, they have other triangles, corners that meet in one
            file are apart in the other, or a vertex of the pattern is none of the file.
    """
    return on_first_rank(comm, lambda: _copied(Path(original), Path(deformed), pattern, scale))


def _copied(original: Path, deformed: Path, pattern: Pattern | Surface, scale: float) -> Floats:
    before, after = _corners(original) * scale, _corners(deformed) * scale
    if len(before) != len(after):
        raise TargetError(
            f"{deformed} has {len(after) // 3} triangles, {original} has {len(before) // 3}. "
            "Deform the same mesh, and do not remesh it."
        )
    near = APART * float(np.linalg.norm(np.ptp(pattern.points, axis=0)))
    gap, first = cKDTree(before).query(pattern.points)
    if gap.max() > near:
        raise TargetError(
            f"vertex {int(np.argmax(gap))} of the skin is none of {original}, which is repaired "
            "when it is read. Save the repaired surface, and deform that one."
        )
    target = after[first]
    # Several triangles share a vertex: they must agree on where it goes.
    gap, vertex = cKDTree(pattern.points).query(before)
    apart = np.where(gap <= near, np.linalg.norm(after - target[vertex], axis=1), 0.0)
    if apart.max() > near:
        corner = int(np.argmax(apart))
        raise TargetError(
            f"triangle {corner // 3} of {deformed} does not meet its neighbours at the corner that "
            f"was at {before[corner]} m: the triangles are in another order than in {original}, or "
            "the surface is torn. Export it so that the order is kept."
        )
    return np.asarray(target)


def _corners(path: Path) -> Floats:
    """Read the corners of all triangles of a file, (3 t, 3), in its unit."""
    mesh = load(path, TargetError, "STL, OBJ, PLY or VTU")
    points = np.asarray(mesh.points, dtype=np.float64)
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    triangles = np.concatenate(blocks) if blocks else np.zeros((0, 3), dtype=np.int64)
    if not len(triangles) or points.ndim != 2 or points.shape[1] != 3:
        raise TargetError(f"{path} holds no triangles in space. Save the deformed surface.")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise TargetError(f"{path} has a triangle at a vertex that is not there. Export it again.")
    corners = points[triangles].reshape(-1, 3)
    if not np.isfinite(corners).all():
        raise TargetError(f"{path} holds coordinates that are not finite. Export it again.")
    return corners


def _read(path: Path, pattern: Pattern) -> Floats:
    mesh = load(path, TargetError, "OBJ, PLY or VTU")
    points = real_numbers(f"points of {path}", mesh.points, "(n, 3), in m", TargetError)
    if points.ndim != 2:
        raise TargetError(f"{path} holds no vertices. Save the deformed skin itself.")
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
