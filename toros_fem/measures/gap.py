"""Gap between a skin and a body to be gripped: signed distance and objective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.mpi import dot
from toros_fem.base.validation import (
    Bools,
    Floats,
    checked_floats,
    require_choice,
    require_positive,
)
from toros_fem.measures.shape import Nodes
from toros_fem.meshes.pattern import Pattern

SHAPES = ("sphere", "box")


@dataclass(frozen=True)
class Body:
    """Sphere, or box along the axes with rounded edges.

    Attributes:
        shape: "sphere" or "box".
        size: Diameter or edge length in m.
        centre: Centre in m.
        rounding: Radius of a box's edges over half its size, in (0, 1].
    """

    shape: str
    size: float
    centre: tuple[float, float, float]
    rounding: float = 0.25

    def __post_init__(self) -> None:
        require_choice("shape", self.shape, SHAPES)
        require_positive(size=self.size)
        require_positive(rounding=self.rounding, at_most=1.0)
        x, y, z = checked_floats("centre", self.centre, "three finite numbers, in m", (3,))
        object.__setattr__(self, "centre", (float(x), float(y), float(z)))

    @property
    def radius(self) -> float:
        """Radius of the sphere, or of the box's edges, in m."""
        return self.size / 2 * (1.0 if self.shape == "sphere" else self.rounding)

    def distance(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the signed distance from the surface, (n,), in m, and its gradient, (n, 3).

        The distance is positive outside. Inside a box, where two sides are equally near, the
        gradient is that of one of them; at the centre of a body it is 0.
        """
        arm = points - self.centre
        # A sphere is a box whose flat sides have no width.
        core = self.size / 2 - self.radius
        over = np.abs(arm) - core
        out = np.maximum(over, 0.0)
        reach = np.linalg.norm(out, axis=1)
        deepest = over.max(axis=1)
        inside = np.minimum(deepest, 0.0)
        gradient = np.sign(arm) * out / np.maximum(reach, np.finfo(float).tiny)[:, None]
        deep = reach == 0
        side = np.argmax(over[deep], axis=1)
        gradient[deep] = np.sign(arm[deep]) * np.eye(3)[side]
        return reach + inside - self.radius, gradient


def mean_gap(body: Body, pattern: Pattern, positions: Floats, touching: Bools) -> float:
    """Return the mean distance in m of touching vertices, (n,), from a body, inside as outside.

    They count by their flat areas; the positions are those of all vertices, (n, 3), in m.
    """
    distance, _ = body.distance(positions[touching])
    return float(np.average(np.abs(distance), weights=pattern.vertex_areas[touching]))


class GapObjective:
    """T = ½ w Σᵥ wᵥ dᵥ² / (L² Σᵥ wᵥ), d the distance from a body's surface.

    wᵥ is a weight ≥ 0 times the flat area of a vertex, w the factor, and L the diagonal of the
    assembled skin's bounding box. Distances inside the body count as much as those outside:
    without contact a vertex may lie inside, where it would press on the body.
    """

    def __init__(self, skin: Nodes, body: Body, weights: Floats, factor: float = 1.0) -> None:
        pattern = skin.pattern
        areas = pattern.vertex_areas * weights
        self._comm, self._body = skin.comm, body
        self._weight = factor * areas[skin.owned_vertices] / (areas.sum() * pattern.size**2)

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        distance, _ = self._body.distance(positions)
        return 0.5 * dot(self._comm, distance, self._weight * distance)

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m."""
        distance, gradient = self._body.distance(positions)
        return np.asarray((self._weight * distance)[:, None] * gradient)
