"""Choice of a density filter by its name."""

from __future__ import annotations

from functools import cache

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.mpi import gather_by_index
from toros_fem.base.validation import require_choice, require_kind
from toros_fem.design.density.linear import Filter, Linear, Map, product
from toros_fem.design.density.neighbours import (
    Neighbourhood,
    Pairs,
    check_radius,
    neighbour_matrices,
)
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

FILTERS = ("cone", "helmholtz")


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
