"""Helmholtz filter, a partial differential equation on the sewn skin."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.mpi import gather_by_index
from toros_fem.base.validation import require_kind
from toros_fem.design.density.linear import Filter, Linear, Map, product
from toros_fem.design.density.neighbours import check_radius
from toros_fem.meshes.skin import Skin


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
