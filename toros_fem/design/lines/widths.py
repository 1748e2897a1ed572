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
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.line_mesh import LineMesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points

# Shift of the eigenvalue problem, over the inverse area of the mesh: the Laplacian is singular.
SHIFT = -0.1


@dataclass(frozen=True, eq=False)
class WidthChanges:
    """Relative changes of the widths of lines: each is one family's, by one smooth function.

    A line that is wider by a fraction is as stiff as one whose density is larger by it.

    Attributes:
        functions: Functions at the vertices of the lines' mesh, (n, m), of mean square 1.
        vertices: Vertices of the line mesh's triangle at each triangle of the print's, (t, 3).
        under: Whether a line of each family covers the triangles of the print's mesh, (K, t).
    """

    functions: Floats
    vertices: Ints
    under: Bools

    def change(self, amounts: Floats) -> Floats:
        """Return the relative change of the width of each family at each vertex, (K, n).

        Args:
            amounts: How much of each function, family by family, (K m,).
        """
        return np.asarray(amounts.reshape(len(self.under), -1) @ self.functions.T)

    def density(self, cells: Ints, change: Floats) -> Floats:
        """Return what changes (K, n) are in densities of triangles of the print's mesh."""
        at_cells = change[:, self.vertices[cells]].mean(axis=2)
        return np.asarray((at_cells * self.under[:, cells]).sum(axis=0))

    def densities(self, cells: Ints, free: Bools) -> list[Floats]:
        """Return the same of each function of each family, where its width may change, (K, n)."""
        units = np.eye(len(free))[:, :, None]
        return [
            self.density(cells, unit * may * function)
            for unit, may in zip(units, free, strict=True)
            for function in self.functions.T
        ]


def width_changes(
    mesh: LineMesh, pattern: Pattern, under: Sequence[Sequence[BaseGeometry]], functions: int
) -> WidthChanges:
    """Return smooth changes of the widths of lines, and what they change on the mesh of a print.

    Args:
        mesh: The lines' mesh.
        pattern: The pattern of the print, with the same panels.
        under: Region under each family on each panel of it, in m.
        functions: Number of smooth functions.
    """
    source = mesh.pattern
    points = scaled_points(source, pattern)[source.flat_triangles[mesh.cells]].mean(axis=1)
    middles = pattern.corners.mean(axis=1)
    # A panel without lines changes nothing, whatever the triangle.
    nearest = np.zeros(len(middles), dtype=np.int64)
    covered = np.zeros((len(under), len(middles)), dtype=bool)
    for panel, name in enumerate(pattern.panel_names):
        here = pattern.cells_of(name)
        there = np.flatnonzero(source.panel[mesh.cells] == source.panel_index(name))
        if len(there):
            nearest[here] = there[cKDTree(points[there]).query(middles[here])[1]]
        for family, regions in enumerate(under):
            shapely.prepare(regions[panel])
            covered[family, here] = shapely.contains_xy(regions[panel], *middles[here].T)
    return WidthChanges(smooth_functions(mesh, functions), mesh.vertex[nearest], covered)


def within_bounds(lines: LaidLines, change: Floats) -> Floats:
    """Return logarithms of factors on widths, (K, n), cut off where widths leave their bounds."""
    found = [
        np.log(np.clip(np.exp(own) * family.radius, *family.bounds) / family.radius)
        for family, own in zip(lines.families, change, strict=True)
    ]
    return np.array(found)


def smooth_functions(mesh: LineMesh, number: int) -> Floats:
    """Return the first eigenfunctions of the Laplacian at vertices, (n, number), of mean square 1.

    On a small mesh there are fewer.
    """
    area = float(mesh.vertex_areas.sum())
    start = np.random.default_rng(0).uniform(0.5, 1.5, mesh.size)  # any: results are repeatable
    _, found = eigsh(
        mesh.laplacian(mesh.weights),
        min(number, mesh.size - 2),
        M=csc_array(diags_array(mesh.vertex_areas)),
        sigma=SHIFT / area,
        v0=start,
    )
    return np.asarray(found * np.sqrt(area))
