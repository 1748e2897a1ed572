"""Deformation of a triangle of the sewn skin: what the laws of its energy are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl

from toros_fem.forms.jets import Jet, Scalar, Vector, dot, minus
from toros_fem.forms.lines import Lines

# Everything is constant on a triangle, so one point integrates exactly.
CELL = {"quadrature_degree": 0}


def flat_area(jacobian: Any) -> Any:
    """Return the flat area Ā of a triangle in m², from the 2×2 Jacobian of its flat chart."""
    return abs(ufl.det(jacobian)) / 2


class Triangle:
    """What an energy term sees of a triangle.

    Attributes:
        nodes: Deformed positions in m as jets: three corners; with bending three flaps, flap i
            across the edge opposite corner i, and the rotations of the edges as a seventh vector.
            Unknown 3 n + k is component k of node n.
        jacobian: Jacobian of the flat chart.
        density: Projected density ρ̄.
        lines: Line families of a relaxed design; None for a design of densities alone.
    """

    def __init__(
        self, patch: Sequence[Any], jacobian: Any, density: Any, lines: Lines | None = None
    ) -> None:
        self.nodes: list[Vector] = [_node(n, at) for n, at in enumerate(patch)]
        self.jacobian, self.density, self.lines = jacobian, density, lines

    @property
    def corners(self) -> list[Vector]:
        """The three corners."""
        return self.nodes[:3]

    @property
    def edges(self) -> tuple[Vector, Vector]:
        """Vectors from the first corner to the other two."""
        first, second, third = self.corners
        return minus(second, first), minus(third, first)

    def strain(self, metric: Sequence[Scalar]) -> Strain:
        """Return the strain of a metric (e₁·e₁, e₂·e₂, e₁·e₂) of the deformed edges."""
        J = ufl.inv(self.jacobian)
        one, two, both = metric
        return Strain(
            [
                J[0, k] * J[0, m] * one
                + J[1, k] * J[1, m] * two
                + (J[0, k] * J[1, m] + J[1, k] * J[0, m]) * both
                for k, m in ((0, 0), (1, 1), (0, 1))
            ]
        )

    def mix(self, fabric: Any, reinforcement: Any) -> Any:
        """Return a stiffness of the sheet between the lines, from the same of both materials.

        Lines stiffen what is between them (`Lines.fabric_factor`).
        """
        value = interpolate(self.density, fabric, reinforcement)
        return value if self.lines is None else self.lines.fabric_factor * value

    @property
    def plain(self) -> Any:
        """Factor on what only the plain fabric has, and only the gaps between lines stretch."""
        value = interpolate(self.density, 1, 0)
        return value if self.lines is None else value * (1 / (1 - self.lines.cover))

    @property
    def printed(self) -> Any:
        """Part of the area under print of any kind."""
        return self.density if self.lines is None else self.density + self.lines.cover


class Strain:
    """Right Cauchy-Green tensor C = FᵀF and its invariants, without cancellation.

    All are smooth in C also where the stretches λ₁ and λ₂ are equal, as long as the triangle has
    not collapsed.

    Attributes:
        C: C₁₁, C₂₂, C₁₂ by the axes of the triangle's flat chart.
        p: λ₁ λ₂.
        s: λ₁ + λ₂.
        total: λ₁ + λ₂ − 2.
        square: (λ₁ − λ₂)², where s² − 4 p would lose its digits.
    """

    def __init__(self, C: Sequence[Scalar]) -> None:
        self.C = C
        self.p = ufl.sqrt(C[0] * C[1] - C[2] * C[2])
        self.s = ufl.sqrt(C[0] + C[1] + 2 * self.p)
        self.total = self.s - 2
        self.square = ((C[0] - C[1]) ** 2 + 4 * C[2] ** 2) / (self.s * self.s)


def edge_products(edges: tuple[Vector, Vector]) -> list[Jet]:
    """Return e₁·e₁, e₂·e₂ and e₁·e₂ of a triangle's deformed edges, in m²."""
    one, two = edges
    return [dot(one, one), dot(two, two), dot(one, two)]


def _node(n: int, at: Any) -> Vector:
    return Jet(at[0], {3 * n: 1}), Jet(at[1], {3 * n + 1: 1}), Jet(at[2], {3 * n + 2: 1})


def interpolate(density: Any, fabric: Any, reinforcement: Any) -> Any:
    """Return the linear mix (1 − ρ̄) fabric + ρ̄ reinforcement, eqs. (2, 3).

    Linear as in the paper: the projection, not a penalty exponent, drives ρ̄ to 0 and 1.
    """
    return fabric + density * (reinforcement - fabric)
