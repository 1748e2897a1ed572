"""Smooth changes of the widths of lines that stay where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.laid_lines import Drawing
from toros_fem.design.lines.line_mesh import LineMesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points

# Shift of the eigenvalue problem, over the inverse area of the mesh: the Laplacian is singular.
SHIFT = -0.1


@dataclass(frozen=True, eq=False)
class WidthChanges:
    """Relative changes of the widths of lines: each is one family's, by one smooth function.

    Attributes:
        functions: Functions at the vertices of the lines' mesh, (n, m), of mean square 1.
        vertices: Vertices of the line mesh's triangle at each triangle of the print's, (t, 3).
        under: Whether a line of each family covers the triangles of the print's mesh, (K, t).
    """

    functions: Floats
    vertices: Ints
    under: Bools

    def densities(self, cells: Ints, free: Bools) -> list[Floats]:
        """Return the changes in stiffness of triangles, as changes of their density.

        Args:
            cells: Triangles of the print's mesh.
            free: Whether the width of each family may change at each vertex, (K, n).
        """
        rows: list[Floats] = []
        for k, may in enumerate(free):
            for function in self.functions.T:
                alone = np.zeros(free.shape)
                alone[k] = function * may
                rows.append(self.density(cells, alone))
        return rows

    def density(self, cells: Ints, change: Floats) -> Floats:
        """Return the change in stiffness of triangles, as a change of their density.

        A line that is wider by a fraction is as stiff as one whose density is larger by it.

        Args:
            cells: Triangles of the print's mesh.
            change: Relative change of the width of each family at each vertex, (K, n).
        """
        at_cells = change[:, self.vertices[cells]].mean(axis=2)
        return np.asarray((at_cells * self.under[:, cells]).sum(axis=0))

    def change(self, amounts: Floats) -> Floats:
        """Return the relative change of the width of each family at each vertex, (K, n).

        Args:
            amounts: How much of each change, (K m,).
        """
        return np.asarray(amounts.reshape(len(self.under), -1) @ self.functions.T)


def width_changes(
    drawing: Drawing,
    pattern: Pattern,
    under: Sequence[Sequence[BaseGeometry]],
    functions: int,
) -> WidthChanges:
    """Return smooth changes of the widths of lines, and what they change on the mesh of a print.

    The functions are the first eigenfunctions of the Laplacian on the lines' mesh.

    Args:
        drawing: The lines.
        pattern: The pattern of the print, with the same panels.
        under: Region under each family on each panel of it, in m.
        functions: Number of functions.
    """
    mesh, source = drawing.mesh, drawing.mesh.pattern
    points = scaled_points(source, pattern)[source.flat_triangles[mesh.cells]].mean(axis=1)
    middles = pattern.corners.mean(axis=1)
    nearest = np.empty(len(middles), dtype=np.int64)
    covered = np.zeros((len(under), len(middles)), dtype=bool)
    for panel, name in enumerate(pattern.panel_names):
        here = pattern.cells_of(name)
        there = np.flatnonzero(source.panel[mesh.cells] == source.panel_index(name))
        # A panel without lines changes nothing, whatever the triangle.
        nearest[here] = there[cKDTree(points[there]).query(middles[here])[1]] if len(there) else 0
        for family, regions in enumerate(under):
            shapely.prepare(regions[panel])
            covered[family, here] = shapely.contains_xy(regions[panel], *middles[here].T)
    return WidthChanges(smooth_functions(mesh, functions), mesh.vertex[nearest], covered)


def within_bounds(drawing: Drawing, change: Floats) -> Floats:
    """Return relative changes of widths, (K, n), cut off where widths would leave their bounds.

    Args:
        drawing: The lines.
        change: Logarithms of factors on the widths, (K, n).
    """
    found = [
        np.log(np.clip(np.exp(own) * family.radius, *family.bounds) / family.radius)
        for family, own in zip(drawing.families, change, strict=True)
    ]
    return np.array(found)


def smooth_functions(mesh: LineMesh, number: int) -> Floats:
    """Return the first eigenfunctions of the Laplacian at vertices, (n, number), of mean square 1.

    Args:
        mesh: Any line mesh.
        number: Number of functions; on a small mesh there are fewer.
    """
    number = min(number, mesh.size - 2)
    area = float(mesh.vertex_areas.sum())
    start = np.random.default_rng(0).uniform(0.5, 1.5, mesh.size)  # any: results are repeatable
    _, found = eigsh(
        mesh.laplacian(mesh.weights),
        number,
        M=csc_array(diags_array(mesh.vertex_areas)),
        sigma=SHIFT / area,
        v0=start,
    )
    return np.asarray(found * np.sqrt(area))
