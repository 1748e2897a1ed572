"""Neighbours inside a panel, and distributed sparse matrices of weights on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError, TorosWarning
from toros_fem.base.mpi import warn_together
from toros_fem.base.validation import checked_floats, require_positive
from toros_fem.design.density.linear import Linear, product
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import equilateral_edge

# Pairs searched for at once: the work arrays stay small beside the matrix.
PAIRS = 2_000_000
# Number of edge lengths below which a filter reaches hardly any neighbour.
RESOLVED = 1.5


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of a point and a triangle near it, ordered by point.

    Attributes:
        begin, rows: First point of these pairs, and their number of points.
        row: Point of each pair, counted from `begin`, ascending.
        cell: Pattern triangle of each pair.
        offset: From the point to the triangle's centroid, (k, 2), in m.
        distance: Its length.
    """

    begin: int
    rows: int
    row: Ints
    cell: Ints
    offset: Floats
    distance: Floats

    def sums(self, weight: Floats) -> Floats:
        """Return the sum of a weight over the pairs of each point, (rows,)."""
        return np.bincount(self.row, weight, minlength=self.rows).astype(np.float64)

    def fractions(self, weight: Floats) -> Floats:
        """Return a weight over its sum over the pairs of the same point."""
        return np.asarray(weight / self.sums(weight)[self.row])


class Neighbourhood:
    """Search for the centroids within a radius of points on the same panel.

    A print does not cross a seam, so distances are measured inside one panel; on a periodic tile
    they are measured on the torus, and on a part of a symmetric skin across its planes. A moulded
    skin is refused; the Helmholtz filter takes it.

    Args:
        beyond: What lies beyond the borders: of a periodic tile its two lattice vectors, (2, 2), in
            m (it must be wider than twice the radius), of a part the symmetric skin that it is a
            part of, from `meshes.mirrored`; None for nothing.
    """

    def __init__(
        self, pattern: Pattern, radius: float, beyond: Floats | Mirrored | None = None
    ) -> None:
        require_positive(radius=radius)
        pattern.require_flat_panels("a search on the panels (cone filter, perimeter)")
        self.radius = radius
        cells: Ints = np.arange(len(pattern.panel), dtype=np.int64)
        points, panel = pattern.centroids, pattern.panel
        if isinstance(beyond, Mirrored):
            cells, points, panel = beyond.cell, beyond.pattern.centroids, beyond.pattern.panel
        elif beyond is not None:
            what = "two vectors (2, 2), in m, or a skin of `mirrored`"
            lattice = checked_floats("beyond", beyond, what, lambda _: True)
            points, cells = _repeated(points, lattice, radius)
            panel = panel[cells]
        # A third coordinate separates the panels by more than the radius and their size.
        self._floor = 3 * radius + 2 * float(np.ptp(points, axis=0).max())
        self._cells = cells
        self._points = np.column_stack([points, self._floor * panel])
        self._tree = cKDTree(self._points)
        expected = np.pi * radius**2 / float(pattern.areas.mean())
        self._chunk = max(1, int(PAIRS / min(max(expected, 1.0), float(len(cells)))))

    def pairs(self, points: Floats, panel: Ints) -> Iterator[Pairs]:
        """Yield the neighbours of points, (k, 2), on given panels, (k,), some rows at a time."""
        lifted = np.column_stack([points, self._floor * panel])
        for begin in range(0, len(points), self._chunk):
            part = lifted[begin : begin + self._chunk]
            near = cKDTree(part).sparse_distance_matrix(
                self._tree, self.radius, output_type="ndarray"
            )
            near = near[np.argsort(near["i"] * len(self._points) + near["j"])]
            row, target = near["i"], near["j"]
            offset = self._points[target, :2] - part[row, :2]
            yield Pairs(begin, len(part), row, self._cells[target], offset, near["v"])

    def counts(self, points: Floats, panel: Ints) -> Ints:
        """Return the number of neighbours of points, (k, 2), on given panels, (k,)."""
        lifted = np.column_stack([points, self._floor * panel])
        return self._tree.query_ball_point(lifted, self.radius, return_length=True)

    def nearest(self, points: Floats, panel: Ints) -> Ints:
        """Return the triangle on the same panel whose centroid is nearest to each point."""
        _, found = self._tree.query(np.column_stack([points, self._floor * panel]))
        return self._cells[found]


def _repeated(points: Floats, lattice: Floats, radius: float) -> tuple[Floats, Ints]:
    """Return a tile's points with their copies within the radius, and the triangle of each."""
    area = abs(float(np.linalg.det(lattice)))
    width = area / max(float(np.linalg.norm(lattice, axis=1).max()), np.finfo(float).tiny)
    if not width > 2 * radius:
        raise ParameterError(
            f"the tile is {width:.3g} m wide and radius = {radius:.3g} m; the tile must be wider "
            "than twice the radius. Repeat the tile, or reduce the radius."
        )
    low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
    cells: Ints = np.arange(len(points), dtype=np.int64)
    copies, owners = [points], [cells]
    # A copy further away than this is out of reach, however oblique the lattice is.
    most = int(np.ceil(np.linalg.norm(high - low) / width))
    for i in range(-most, most + 1):
        for j in range(-most, most + 1):
            moved = points + i * lattice[0] + j * lattice[1]
            near = np.all((moved >= low) & (moved <= high), axis=1)
            if (i, j) != (0, 0) and near.any():
                copies.append(moved[near])
                owners.append(cells[near])
    return np.concatenate(copies), np.concatenate(owners)


def neighbour_matrices(
    skin: Skin,
    near: Neighbourhood,
    weigh: Callable[[Pairs], Sequence[Floats]],
    number: int = 1,
) -> list[Linear]:
    """Assemble matrices over the triangles of a skin, one for each weight (collective).

    Rows and columns are numbered like the densities; neighbours may belong to other ranks. `weigh`
    returns the weights of pairs, one array for each of the `number` matrices.
    """
    pattern, owned = skin.pattern, skin.owned_cells
    first = skin.density_space.dofmap.index_map.local_range[0]
    column = skin.gather_cells(first + np.arange(len(owned), dtype=np.float64))
    column = column.astype(PETSc.IntType)
    points, panel = pattern.centroids[owned], pattern.panel[owned]
    # A triangle and its copies may be counted, and are one column.
    counts = np.minimum(near.counts(points, panel), len(column)).astype(PETSc.IntType)
    size = (len(owned), len(column))
    # How many neighbours are owned is not known here; allocated rows that stay empty cost nothing.
    room = counts if skin.comm.size == 1 else (np.minimum(counts, len(owned)), counts)
    matrices = [
        PETSc.Mat().createAIJ((size, size), nnz=room, comm=skin.comm) for _ in range(number)
    ]
    # Rounding may find a pair at the radius that the count did not include.
    for matrix in matrices:
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    for pairs in near.pairs(points, panel):
        rows = np.arange(pairs.rows, dtype=PETSc.IntType) + pairs.begin + first
        start = np.searchsorted(pairs.row, np.arange(pairs.rows + 1)).astype(PETSc.IntType)
        for matrix, weight in zip(matrices, weigh(pairs), strict=True):
            # A triangle and its copy may both be near, so entries are added.
            matrix.setValuesIJV(start, column[pairs.cell], weight, addv=True, rowmap=rows)
    for matrix in matrices:
        matrix.assemble()
    return [product(matrix) for matrix in matrices]


def require_radius(radius: float, size: float) -> None:
    """Check a filter's radius against the size of the skin, both in m."""
    require_positive(**{"filter radius": radius})
    if radius > size:
        raise ParameterError(
            f"filter radius = {radius:.3g} m is larger than the skin of {size:.3g} m: every "
            "density would be the mean. Radii are two or three edge lengths; in m, not mm.",
            "filter_radius",
        )


def check_radius(skin: Skin, radius: float) -> None:
    """Check a filter's radius in m, and warn if it is too small for the mesh."""
    require_radius(radius, skin.pattern.size)
    edge = equilateral_edge(skin.pattern.areas.mean())
    if radius < RESOLVED * edge:
        warn_together(
            skin.comm,
            f"filter radius = {radius:.3g} m is under {RESOLVED} edge lengths ({edge:.3g} m "
            "each): it hardly filters and guarantees no width of a line. Refine the mesh to "
            f"edges of {radius / RESOLVED:.3g} m, or enlarge the radius.",
            TorosWarning,
        )
