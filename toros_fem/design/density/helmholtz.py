"""Helmholtz filter, a partial differential equation on the sewn skin."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.mpi import gather_by_index
from toros_fem.base.validation import require_kind
from toros_fem.design.density.neighbours import check_radius
from toros_fem.meshes.skin import Skin


class HelmholtzFilter:
    """Filter −r² ∇²ρ̃ + ρ̃ = ρ on the sewn skin, r = R/(2√3) (Lazarov & Sigmund 2011, eqs. 3, 7).

    ρ̃ is continuous and piecewise linear; its value in a triangle is that at the centroid. The
    filter crosses seams, so that the print on one panel affects the next. The cost grows with the
    number of triangles and does not depend on the radius. The mass is lumped at the vertices, so
    that ρ̃ stays in [0, 1] on meshes without obtuse angles; on other meshes the projection clips it.

    Args:
        skin: The sewn skin.
        radius: R in m; the cone of this radius filters as much.

    Raises:
        ParameterError: The radius is not positive, or larger than the skin.

    Warns:
        ResolutionWarning: The radius is under 1.5 edge lengths and hardly filters.
    """

    name = "helmholtz"

    def __init__(self, skin: Skin, radius: float) -> None:
        require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
        check_radius(skin, radius)
        self.radius = radius
        self._skin = skin
        space = fem.functionspace(skin.mesh, ("Lagrange", 1))
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        r = fem.Constant(skin.mesh, radius / (2 * np.sqrt(3)))
        lumped = ufl.dx(metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
        form = r**2 * ufl.inner(ufl.grad(trial), ufl.grad(test)) * ufl.dx + trial * test * lumped
        self._matrix = assemble_matrix(compiled(form))
        self._matrix.assemble()
        self._ksp = PETSc.KSP().create(skin.comm)
        self._ksp.setOptionsPrefix("toros_filter_")
        self._ksp.setOperators(self._matrix)
        self._ksp.setType(PETSc.KSP.Type.PREONLY)
        self._ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
        self._ksp.getPC().setFactorSolverType("mumps")
        self._ksp.setFromOptions()
        self._right, self._left = self._matrix.createVecs()
        imap = space.dofmap.index_map
        self._work: Any = la.vector(imap, 1)
        self._size = imap.size_local
        owned = len(skin.owned_cells)
        cell = np.argsort(skin.density_space.dofmap.list[:owned, 0])
        self._nodes = space.dofmap.list[:owned][cell]
        self._vertex = np.zeros(len(self._work.array), dtype=np.int64)
        self._vertex[space.dofmap.list] = skin.vertex[skin.position_space.dofmap.list]
        self._third = np.repeat(skin.pattern.areas[skin.owned_cells] / 3, 3)
        corner = skin.mesh.geometry.x[: 3 * owned, :2].reshape(owned, 3, 2)[cell]
        chart = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=1)
        inverse = np.linalg.inv(chart)
        # Gradients of the three corner functions, (2, k, 3).
        self._grads = np.concatenate([-inverse.sum(axis=2)[:, :, None], inverse], axis=2)
        self._grads = np.ascontiguousarray(self._grads.transpose(1, 0, 2))

    def _gathered(self, corners: Floats) -> Floats:
        """Return sums at owned vertices of values at the corners of owned triangles, (k, 3)."""
        self._work.array[:] = np.bincount(
            self._nodes.ravel(), corners.ravel(), minlength=len(self._work.array)
        )
        self._work.scatter_reverse(la.InsertMode.add)
        return np.array(self._work.array[: self._size])

    def _corners(self, vertices: Floats) -> Floats:
        """Return values at the corners of owned triangles, (k, 3), from those at owned vertices."""
        self._work.array[: self._size] = vertices
        self._work.scatter_forward()
        return np.asarray(self._work.array[self._nodes])

    def _solve(self, right: Floats) -> Floats:
        self._right.array[:] = right
        self._ksp.solve(self._right, self._left)
        return self._left.array.copy()

    def _vertices(self, density: Floats) -> Floats:
        return self._solve(self._gathered((self._third * np.repeat(density, 3)).reshape(-1, 3)))

    def _vertices_backward(self, corners: Floats) -> Floats:
        at_corners = self._corners(self._solve(self._gathered(corners)))
        return np.asarray((self._third.reshape(-1, 3) * at_corners).sum(axis=1))

    def forward(self, density: Floats) -> Floats:
        """Return ρ̃ at owned triangles from ρ there (collective)."""
        return np.asarray(self._corners(self._vertices(density)).mean(axis=1))

    def backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return self._vertices_backward(np.repeat(gradient[:, None] / 3, 3, axis=1))

    def slope(self, density: Floats) -> Floats:
        """Return ∇ρ̃ in owned triangles, (2, k), in 1/m (collective)."""
        return np.einsum("dki,ki->dk", self._grads, self._corners(self._vertices(density)))

    def slope_backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective)."""
        return self._vertices_backward(np.einsum("dki,dk->ki", self._grads, gradient))

    def at_points(self, density: Floats) -> Floats:
        """Return ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        pattern = self._skin.pattern
        owned = self._vertices(density)
        vertex = self._vertex[: self._size]
        every = gather_by_index(self._skin.comm, vertex, owned, len(pattern.points))
        return every[pattern.sewn]
