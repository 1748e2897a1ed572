"""Quadratic bubbles on edges: the displacement in a triangle's plane is quadratic there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.jets import Jet, Scalar, Vector, compose
from toros_fem.forms.kinematics import edge_products

# Points that integrate quadratic functions on a triangle, as barycentric coordinates; their weights
# are equal.
POINTS = ((2 / 3, 1 / 6, 1 / 6), (1 / 6, 2 / 3, 1 / 6), (1 / 6, 1 / 6, 2 / 3))
# Gradients of the barycentric coordinates on the reference triangle.
SLOPES = ((-1.0, -1.0), (1.0, 0.0), (0.0, 1.0))
# Edges opposite the corners by those from the first corner.
EDGES = ((-1.0, 1.0), (0.0, -1.0), (1.0, 0.0))


@dataclass(frozen=True)
class Bubbles:
    """Unknowns α, β of a triangle's three edges, which displace the middle of each edge.

    Edge E, opposite corner k, has the displacement 4 Lᵢ Lⱼ (α E + β E⊥) s/ℓ in the triangle, with
    the barycentric coordinates L of its ends, its flat length ℓ, and E⊥, which is E turned by 90°
    in the plane of the triangle. Both triangles of an edge have the same, apart from the fold
    between them. A line one triangle wide does not lock in bending in its plane then. As the
    displacement goes with the deformed edges, a rigid motion leaves α and β, which are lengths, as
    they are.

    Attributes:
        first: Number of the first of two vectors, among a triangle's nodes, which hold α and β of
            all edges: (α₀, β₀, α₁), (β₁, α₂, β₂).
        scales: s/ℓ of each edge in 1/m, three; s = ±1 opposite in the two triangles of an edge.
    """

    first: int
    scales: Any

    def metric(self, point: Sequence[float], geometric: Any, *given: Vector) -> list[Jet]:
        """Return (g₁·g₁, g₂·g₂, g₁·g₂) in m² at a point, of what the reference axes become.

        Vectors are those of the two edges, and the two that hold α and β. Where `geometric` is 0
        the second derivatives are those of the edges' products alone.
        """
        one, two, *unknown = given
        inputs = [*edge_products((one, two)), *unknown[0], *unknown[1]]
        return [
            compose(lambda *of, k=k: self._metric(point, of)[k], inputs, bend=geometric)
            for k in range(3)
        ]

    def _metric(self, point: Sequence[float], of: Sequence[Scalar]) -> tuple[Scalar, ...]:
        a, b, c, *held = of
        G = gradient_at(point, (a, b, c), held, self.scales, ufl.sqrt)

        def product(m: int, n: int) -> Scalar:
            (p, q), (r, s) = (G[0][m], G[1][m]), (G[0][n], G[1][n])
            return a * p * r + b * q * s + c * (p * s + q * r)

        return product(0, 0), product(1, 1), product(0, 1)


def gradient_at(
    point: Sequence[float],
    products: Sequence[Any],
    held: Sequence[Any],
    scales: Any,
    root: Callable[[Any], Any],
) -> list[list[Any]]:
    """Return G with columns gⱼ = Σᵢ Gᵢⱼ eᵢ, what the reference axes become at a point.

    Of numbers in UFL or of arrays: products e₁·e₁, e₂·e₂, e₁·e₂ of the edges from the first corner,
    unknowns α, β of each edge, its scale, and the square root.
    """
    a, b, c = products
    area = root(a * b - c * c)
    G: list[list[Any]] = [[1.0, 0.0], [0.0, 1.0]]
    for k, (x, y) in enumerate(EDGES):
        alpha, beta = scales[k] * held[2 * k], scales[k] * held[2 * k + 1]
        turned = beta / area
        u, v = alpha * x - turned * (c * x + b * y), alpha * y + turned * (a * x + c * y)
        i, j = (k + 1) % 3, (k + 2) % 3
        for m in range(2):
            slope = 4 * (point[i] * SLOPES[j][m] + point[j] * SLOPES[i][m])
            G[0][m], G[1][m] = G[0][m] + slope * u, G[1][m] + slope * v
    return G
