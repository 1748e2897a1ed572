"""Deformation of a triangle of the sewn skin, from its corner positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl

# Everything is constant on a triangle, so one point integrates exactly.
CELL = {"quadrature_degree": 0}


def flat_area(jacobian: Any) -> Any:
    """Return the flat area Ā of a triangle in m², from the 2×2 Jacobian of its flat chart."""
    return abs(ufl.det(jacobian)) / 2


def deformation_gradient(corners: Sequence[Any], jacobian: Any) -> Any:
    """Return F = ∂x/∂x̄, shape (3, 2), from three corner positions in R³.

    Args:
        corners: Deformed positions of the corners, in the order of the reference triangle.
        jacobian: Jacobian of the flat chart, `ufl.Jacobian(skin)`.
    """
    a, b, c = corners
    edges = ufl.as_matrix([[b[k] - a[k], c[k] - a[k]] for k in range(3)])
    return ufl.dot(edges, ufl.inv(jacobian))


def right_cauchy_green(F: Any) -> Any:
    """Return C = FᵀF, shape (2, 2)."""
    return ufl.dot(ufl.transpose(F), F)


def stretch_invariants(C: Any) -> tuple[Any, Any]:
    """Return s = λ₁ + λ₂ and p = λ₁ λ₂.

    Both are smooth in C also where λ₁ = λ₂; the stretches themselves are not. p is smooth as
    long as the triangle has not collapsed (p > 0).
    """
    p = ufl.sqrt(ufl.det(C))
    return ufl.sqrt(ufl.tr(C) + 2 * p), p
