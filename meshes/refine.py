"""Uniform refinement of patterns: each triangle is divided in four."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangle_limit import require_fewer
from toros_fem.meshes.triangles import edges_of


@dataclass(frozen=True, eq=False)
class Refinement:
    """A refined pattern, and its relation to the coarse one.

    Attributes:
        pattern: The refined pattern: the same flat panels, the same seams.
        cell: Coarse triangle of which each triangle is a quarter, shape (4 t,).
        ends: Two coarse vertices with each assembled vertex in their middle, shape (n, 2); both
            are the same for a vertex of the coarse pattern.
    """

    pattern: Pattern
    cell: Ints
    ends: Ints

    def at_vertices(self, values: Floats) -> Floats:
        """Interpolate values at the coarse vertices, (n, …), to the refined ones."""
        return np.asarray(values[self.ends].mean(axis=1))


def refine(pattern: Pattern) -> Refinement:
    """Divide each triangle into four by the middles of its edges.

    Flat panels keep their outlines: a round panel stays the same polygon.

    Args:
        pattern: Any pattern.

    Raises:
        MeshSizeError: There would be more triangles than `triangle_limit` allows.
    """
    require_fewer(4 * len(pattern.panel), float(pattern.areas.sum()))
    flat, tri = pattern.flat_points, pattern.flat_triangles
    edges = edges_of(tri)
    # Two flat edges that are sewn together share their middle.
    sewn_ends = np.sort(pattern.sewn[edges.ends], axis=1)
    ends, sewn_middle = np.unique(sewn_ends, axis=0, return_inverse=True)
    count = len(pattern.points)
    a, b, c = tri.T
    ab, bc, ca = len(flat) + edges.of_triangle.T
    triangles = np.stack(
        [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)], axis=0
    ).transpose(2, 0, 1).reshape(-1, 3)  # fmt: skip
    vertices = np.concatenate([np.repeat(np.arange(count)[:, None], 2, axis=1), ends])
    return Refinement(
        pattern=Pattern(
            flat_points=np.concatenate([flat, flat[edges.ends].mean(axis=1)]),
            flat_triangles=triangles,
            panel=np.repeat(pattern.panel, 4),
            sewn=np.concatenate([pattern.sewn, count + sewn_middle.ravel()]),
            points=pattern.points[vertices].mean(axis=1),
            panel_names=pattern.panel_names,
            seam_tolerance=pattern.seam_tolerance,
            moulded=pattern.moulded,
        ),
        cell=np.repeat(np.arange(len(tri)), 4),
        ends=vertices,
    )
