"""Density filters by name, eq. (11): linear maps with transposes, and neighbours in panels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc
from scipy.spatial import cKDTree

from toros_fem.base.errors import ParameterError, TorosWarning
from toros_fem.base.fenicsx import compiled
from toros_fem.base.mpi import gather_by_index, warn_together
from toros_fem.base.validation import (
    Floats,
    Ints,
    checked_floats,
    require_choice,
    require_kind,
    require_positive,
)
from toros_fem.meshes.pattern import Mirrored, Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import equilateral_edge

Map = Callable[[Floats], Floats]
# Pairs searched for at once: the work arrays stay small beside the matrix.
PAIRS = 2_000_000
# Number of edge lengths below which a filter reaches hardly any neighbour.
RESOLVED = 1.5
FILTERS = ("cone", "helmholtz")


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear map of owned values and its transpose, which takes gradients back (collective)."""

    forward: Map
    backward: Map

    def after(self, first: Linear) -> Linear:
        """Return the map that applies `first`, then this one."""
        return Linear(
            lambda values: self.forward(first.forward(values)),
            lambda gradient: first.backward(self.backward(gradient)),
        )


@dataclass(frozen=True, eq=False)
class Filter(Linear):
    """Map from the design density ρ to the filtered density ρ̃, at owned triangles.

    Attributes:
        name: "cone" or "helmholtz".
        radius: R in m.
        slope: Map from ρ to ∇ρ̃ at the centroids, (2, k), in 1/m.
        at_points: Function that returns ρ̃ at all flat points of the pattern, (m,), on every rank
            from ρ (collective).
    """

    name: str
    radius: float
    slope: Linear
    at_points: Map

    def after(self, first: Linear) -> Filter:
        """Return the filter of what another map makes of a density."""
        value = super().after(first)
        return Filter(
            value.forward,
            value.backward,
            self.name,
            self.radius,
            self.slope.after(first),
            lambda density: self.at_points(first.forward(density)),
        )


def product(matrix: PETSc.Mat) -> Linear:
    """Return the product with a matrix.

    Its vectors are made once: those that are dropped on several ranks stay in memory until all
    ranks clean up together.
    """
    right, left = matrix.createVecs()

    def forward(values: Floats) -> Floats:
        right.array[:] = values
        matrix.mult(right, left)
        return left.array.copy()

    def backward(values: Floats) -> Floats:
        left.array[:] = values
        matrix.multTranspose(left, right)
        return right.array.copy()

    return Linear(forward, backward)


def group_mean(skin: Skin, symmetry_maps: Ints) -> Linear:
    """Return the mean over a symmetry group of a tile: `filter.after` it makes symmetric designs.

    ρ̃ is then symmetric for every density, if the filter commutes with the symmetry. The maps are
    those of `Tile.symmetry_maps`.
    """

    def mean(density: Floats) -> Floats:
        whole = skin.gather_cells(density)
        return np.asarray(whole[symmetry_maps].mean(axis=0)[skin.owned_cells])

    return Linear(mean, mean)  # the group contains each operation's inverse


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


def make_filter(
    name: str,
    skin: Skin,
    radius: float,
    beyond: Floats | Mirrored | None = None,
) -> Filter:
    """Return the filter of a given name with a radius in m (collective).

    "cone" is `cone_filter`, with what lies beyond the borders, as of `Neighbourhood`. "helmholtz"
    is `helmholtz_filter`, which need not know: it crosses all seams, and its free borders act as
    planes of symmetry.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    require_choice("filter", name, FILTERS)
    if name == "cone":
        return cone_filter(skin, radius, beyond)
    return helmholtz_filter(skin, radius)


def cone_filter(skin: Skin, radius: float, beyond: Floats | Mirrored | None = None) -> Filter:
    """Return the filter ρ̃ᵢ = Σⱼ ωᵢⱼ Āⱼ ρⱼ / Σⱼ ωᵢⱼ Āⱼ with ωᵢⱼ = max(R − ‖x̄ᵢ − x̄ⱼ‖, 0), eq. (11).

    Rows sum to 1, so that a uniform density does not change. The weights form a sparse matrix that
    is built once; those of the slope, the exact gradient of (11) at the centroid, are built on
    first use. A matrix takes about 90 (R/h)² bytes per triangle, where h is the edge length: for
    250 000 triangles 0.2 GiB at R = 3 h and 2 GiB at 10 h; the slope takes twice that in addition.
    For larger radii use the Helmholtz filter. `beyond` is that of `Neighbourhood`.

    Warns:
        TorosWarning: The radius is under 1.5 edge lengths and hardly filters.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    check_radius(skin, radius)
    near, areas = Neighbourhood(skin.pattern, radius, beyond), skin.pattern.areas

    def cone(pairs: Pairs) -> Floats:
        return (radius - pairs.distance) * areas[pairs.cell]

    def weights(pairs: Pairs) -> list[Floats]:
        return [pairs.fractions(cone(pairs))]

    def weight_slopes(pairs: Pairs) -> list[Floats]:
        """Return the gradient of the weights with respect to the point that they belong to."""
        weight, area = cone(pairs), areas[pairs.cell]
        whole = pairs.sums(weight)[pairs.row]
        # At the centroid itself the kernel has a tip; its mean slope there is 0.
        far = np.where(pairs.distance > 0, pairs.distance, np.inf)
        slopes = [area * offset / far for offset in pairs.offset.T]
        return [(one - weight / whole * pairs.sums(one)[pairs.row]) / whole for one in slopes]

    @cache
    def gradient() -> list[Linear]:
        return neighbour_matrices(skin, near, weight_slopes, 2)

    def slope(density: Floats) -> Floats:
        return np.array([one.forward(density) for one in gradient()])

    def slope_backward(by_slope: Floats) -> Floats:
        parts = zip(gradient(), by_slope, strict=True)
        return np.asarray(sum(one.backward(part) for one, part in parts))

    def at_points(density: Floats) -> Floats:
        pattern, every = skin.pattern, skin.gather_cells(density)
        at = pattern.flat_points, pattern.panel_of_point
        # Where no centroid is within the radius, the nearest one gives the value.
        values = every[near.nearest(*at)]
        for pairs in near.pairs(*at):
            weight = cone(pairs)
            total, found = pairs.sums(weight), pairs.sums(weight * every[pairs.cell])
            part = values[pairs.begin : pairs.begin + pairs.rows]
            np.divide(found, total, out=part, where=total > 0)
        return values

    (mean,) = neighbour_matrices(skin, near, weights)
    return Filter(
        mean.forward, mean.backward, "cone", radius, Linear(slope, slope_backward), at_points
    )


def helmholtz_filter(skin: Skin, radius: float) -> Filter:
    """Return the filter −r² ∇²ρ̃ + ρ̃ = ρ on the sewn skin, r = R/(2√3).

    Lazarov & Sigmund 2011, eqs. 3, 7. ρ̃ is continuous and piecewise linear; its value in a
    triangle is that at the centroid. The filter crosses seams, so that the print on one panel
    affects the next. The cost grows with the number of triangles and does not depend on the radius.
    The mass is lumped at the vertices, so that ρ̃ stays in [0, 1] on meshes without obtuse angles;
    on other meshes the projection clips it. The cone of the same radius R, in m, filters as much.

    Warns:
        TorosWarning: The radius is under 1.5 edge lengths and hardly filters.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    check_radius(skin, radius)
    space = fem.functionspace(skin.mesh, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    cell = ufl.TestFunction(skin.density_space)
    r = fem.Constant(skin.mesh, radius / (2 * np.sqrt(3)))
    lumped = ufl.dx(metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
    form = r**2 * ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx + u * v * lumped
    solve, areas = _inverse(_matrix(form)), skin.pattern.areas[skin.owned_cells]
    # Integrals over each triangle of a function that vertices hold, and of its slope.
    integral = product(_matrix(cell * u * ufl.dx))
    slopes = [product(_matrix(cell * u.dx(axis) * ufl.dx)) for axis in range(2)]

    def vertices(density: Floats) -> Floats:
        return solve(integral.backward(density))

    def forward(density: Floats) -> Floats:
        return integral.forward(vertices(density)) / areas

    def backward(gradient: Floats) -> Floats:
        return integral.forward(solve(integral.backward(gradient / areas)))

    def slope(density: Floats) -> Floats:
        at_vertices = vertices(density)
        return np.array([one.forward(at_vertices) for one in slopes]) / areas

    def slope_backward(by_slope: Floats) -> Floats:
        parts = zip(slopes, by_slope / areas, strict=True)
        return integral.forward(solve(np.asarray(sum(one.backward(part) for one, part in parts))))

    vertex = np.zeros(space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts, int)
    vertex[space.dofmap.list] = skin.vertex[skin.position_space.dofmap.list]
    owned = vertex[: space.dofmap.index_map.size_local]

    def at_points(density: Floats) -> Floats:
        pattern = skin.pattern
        every = gather_by_index(skin.comm, owned, vertices(density), len(pattern.points))
        return every[pattern.sewn]

    return Filter(forward, backward, "helmholtz", radius, Linear(slope, slope_backward), at_points)


def _matrix(form: ufl.Form) -> PETSc.Mat:
    matrix = assemble_matrix(compiled(form))
    matrix.assemble()
    return matrix


def _inverse(matrix: PETSc.Mat) -> Map:
    """Return the solution with a symmetric matrix, which is factorised once."""
    solver = PETSc.KSP().create(matrix.comm)
    solver.setOptionsPrefix("toros_filter_")
    solver.setOperators(matrix)
    solver.setType(PETSc.KSP.Type.PREONLY)
    solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
    solver.getPC().setFactorSolverType("mumps")
    solver.setFromOptions()
    right, left = matrix.createVecs()

    def solve(values: Floats) -> Floats:
        right.array[:] = values
        solver.solve(right, left)
        return left.array.copy()

    return solve
