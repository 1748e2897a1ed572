"""Smooth changes of lines that were laid: of the widths of each family, and a warp of all lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import block_array, coo_array, csc_array, diags_array, sparray
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.laid_lines import LaidLines, LineChange
from toros_fem.design.lines.line_mesh import Complexes, LineMesh, coordinates
from toros_fem.meshes.mirror import plane_border
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points
from toros_fem.meshes.triangles import following, spd_factor

# Shift of the eigenvalue problems, over the inverse area of the mesh: a Laplacian may be singular.
SHIFT = -0.1


@dataclass(frozen=True, eq=False)
class SmoothChanges:
    """A basis of smooth changes: widths of each family by each function, and warps by each field.

    Attributes:
        families: Number K of families.
        functions: Functions at the vertices of the lines' mesh, (n, m), of mean square 1.
        fields: Tangent vectors there, (n, w), in the chart of each vertex's first corner, of mean
            square 1.
        units: Logarithm of a factor on the width, and warp in m, that an amount of 1 stands for.
    """

    families: int
    functions: Floats
    fields: Complexes
    units: tuple[float, float]

    @property
    def size(self) -> int:
        """Number of changes."""
        return self.families * self.functions.shape[1] + self.fields.shape[1]

    def change(self, amounts: Floats) -> LineChange:
        """Return the change of these amounts, those of widths first, family by family."""
        split = self.families * self.functions.shape[1]
        widths, warp = amounts[:split], amounts[split:]
        return LineChange(
            self.units[0] * (widths.reshape(self.families, -1) @ self.functions.T),
            self.units[1] * (self.fields @ warp),
        )

    def each(self) -> Iterator[LineChange]:
        """Yield the changes one by one."""
        return map(self.change, np.eye(self.size))


@dataclass(frozen=True, eq=False)
class PrintBorders:
    """Borders of the print of lines on its mesh, and how they follow the lines.

    Attributes:
        lines: The lines.
        normals: Way of the flat points where the borders move outwards by 1, (k, 2), as of
            `border_motion`.
        under: Whether a flat point is at the border of each family, (K, k).
        near: Weights of the corners of the lines' mesh at the flat points, (k, 3).
        cell: Triangle of the lines' mesh at the flat points, (k,).
    """

    lines: LaidLines
    normals: Floats
    under: Bools
    near: Floats
    cell: Ints

    def moves(self, change: LineChange) -> Floats:
        """Return the way of the flat points with the borders, (k, 2), in m."""
        mesh = self.lines.mesh
        vertex = mesh.vertex[self.cell]
        out: Floats = np.zeros(len(self.cell))
        for family, widths, own in zip(self.lines.families, change.widths, self.under, strict=True):
            out += own * (self.near * (family.radius * widths)[vertex]).sum(axis=1)
        turned = change.warp[vertex] * np.exp(1j * mesh.turn[self.cell])
        warp = coordinates((self.near * turned).sum(axis=1))
        at_border = np.any(self.normals != 0, axis=1)
        return out[:, None] * self.normals + at_border[:, None] * warp


def print_borders(
    lines: LaidLines,
    pattern: Pattern,
    under: Sequence[Sequence[BaseGeometry]],
    printed: Bools,
    normals: Floats,
) -> PrintBorders:
    """Return the borders of the print of lines on a pattern with the same panels.

    `under` are the regions under each family on each panel of it, in m. Its triangles are printed
    or not, (t,), and the normals are those of `border_motion`.
    """
    mesh, source = lines.mesh, lines.pattern
    flat = scaled_points(source, pattern)
    middles, centroids = mesh.corners.mean(axis=1), pattern.corners.mean(axis=1)
    cell: Ints = np.zeros(len(flat), dtype=np.int64)
    near: Floats = np.zeros((len(flat), 3))
    at: Bools = np.zeros((len(under), len(flat)), dtype=bool)
    for panel, name in enumerate(pattern.panel_names):
        there = np.flatnonzero(source.panel[mesh.cells] == source.panel_index(name))
        here = np.flatnonzero(pattern.panel_of_point == panel)
        if not len(there):
            continue
        cell[here] = there[cKDTree(middles[there]).query(flat[here])[1]]
        places = flat[here, 0] + 1j * flat[here, 1]
        weights = np.clip(mesh.barycentric(cell[here], places), 0, None)
        near[here] = weights / weights.sum(axis=1, keepdims=True)
        inside = pattern.cells_of(name)
        inside = inside[printed[inside]]
        for family, regions in enumerate(under):
            shapely.prepare(regions[panel])
            own = inside[shapely.contains_xy(regions[panel], *centroids[inside].T)]
            at[family, pattern.flat_triangles[own]] = True
    return PrintBorders(lines, normals, at, near, cell)


def smooth_functions(mesh: LineMesh, number: int) -> Floats:
    """Return the first eigenfunctions of the Laplacian at vertices, (n, number), of mean square 1.

    On a small mesh there are fewer.
    """
    return _smoothest(mesh.laplacian(mesh.weights), mesh.vertex_areas, number)


def smooth_fields(mesh: LineMesh, number: int, planes: Sequence[int]) -> Complexes:
    """Return the smoothest tangent fields at vertices, (n, number), of mean square 1.

    They are eigenfields of the connection's Laplacian, so that they go on across seams. They are 0
    at the border of the mesh, where lines end, and along the border in symmetry planes, at which
    the pattern is cut, as of `mirrored`. On a small mesh there are fewer.
    """
    size, inner = mesh.size, np.ones(mesh.size, dtype=bool)
    inner[mesh.edges.ends[mesh.edges.border]] = False
    along = _along_planes(mesh, planes)
    sliding = np.flatnonzero(along)
    free = np.flatnonzero(inner)
    rows = np.concatenate([free, free + size, sliding, sliding + size])
    width = 2 * len(free) + len(sliding)
    columns = np.concatenate([np.arange(2 * len(free)), *2 * [np.arange(2 * len(free), width)]])
    entries = np.concatenate([np.ones(2 * len(free)), along[sliding].real, along[sliding].imag])
    made = csc_array(coo_array((entries, (rows, columns)), shape=(2 * size, width)))
    bent = mesh.laplacian(mesh.weights, np.exp(1j * mesh.edge_angles))
    both = csc_array(block_array([[bent.real, -bent.imag], [bent.imag, bent.real]]))
    areas = (made * made).T @ np.tile(mesh.vertex_areas, 2)
    found = made @ _smoothest(csc_array(made.T @ both @ made), areas, number)
    scale = np.sqrt(mesh.vertex_areas.sum() / areas.sum())
    return np.asarray(scale * (found[:size] + 1j * found[size:]))


def _smoothest(matrix: sparray, areas: Floats, number: int) -> Floats:
    """Return the lowest eigenvectors of a Laplacian, (n, number), of mean square 1."""
    size, area = len(areas), float(areas.sum())
    start = np.random.default_rng(0).uniform(0.5, 1.5, size)  # any: results are repeatable
    mass, shift = csc_array(diags_array(areas)), SHIFT / area
    factor = spd_factor(csc_array(matrix - shift * mass))
    inverse = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    _, found = eigsh(
        csc_array(matrix), min(number, size - 2), M=mass, sigma=shift, v0=start, OPinv=inverse
    )
    return np.asarray(found * np.sqrt(area))


def _along_planes(mesh: LineMesh, planes: Sequence[int]) -> Complexes:
    """Return unit vectors along the border at vertices in one plane only, (n,); 0 elsewhere."""
    inside: Bools = np.zeros(len(mesh.border), dtype=bool)
    for axis in planes:
        inside |= np.isin(mesh.border, plane_border(mesh.pattern, axis))
    border = mesh.edges.twins[mesh.edges.border, 0]
    total: Complexes = np.zeros(mesh.size, dtype=np.complex128)
    elsewhere: Bools = np.zeros(mesh.size, dtype=bool)
    for corner in (border, following(border)):
        vertex = mesh.vertex.ravel()[corner]
        way = mesh.sides.ravel()[border] * np.exp(-1j * mesh.turn.ravel()[corner])
        np.add.at(total, vertex[inside], way[inside])
        elsewhere[vertex[~inside]] = True
    size = np.abs(total)
    return np.where(elsewhere | (size == 0), 0.0, total / np.where(size == 0, 1.0, size))
