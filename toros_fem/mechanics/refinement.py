"""Supports, chambers and forces on a refined pattern."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from toros_fem._types import Floats
from toros_fem.errors import ParameterError
from toros_fem.materials import Composite
from toros_fem.mechanics.chambers import Chambers
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import Refinement
from toros_fem.meshes.topology import edge_keys


def require_refinable(composite: Composite) -> None:
    """Check that the rest shape is known between the vertices.

    Raises:
        ParameterError: The sheet is moulded in its assembled shape.
    """
    if composite.bending is not None and composite.bending.rest == "assembled":
        raise ParameterError(
            "rest = 'assembled': between its vertices the moulded shape is not known. Make the "
            "finer pattern yourself and compare."
        )


def refined_supports(finer: Refinement, supports: Supports) -> Supports:
    """Return supports of a refined pattern: a middle is fixed if both its ends are.

    This is right for whole panels and straight borders.
    """
    fixed = np.asarray(supports.fixed[finer.ends].all(axis=1))
    displacement = None
    if supports.displacement is not None:
        displacement = supports.displacement[finer.ends].mean(axis=1)
    if not len(supports.guided):
        return Supports(fixed, displacement=displacement)
    count = len(supports.fixed)
    known = edge_keys(finer.ends[count:], count)
    middle = count + np.searchsorted(known, edge_keys(supports.guided, count))
    halves = np.stack([supports.guided, np.repeat(middle[:, None], 2, axis=1)], axis=2)
    normals = np.repeat(supports.normals, 2, axis=0)
    return Supports(fixed, halves.reshape(-1, 2), normals, displacement)


def refined_chambers(finer: Refinement, chambers: Chambers | None) -> Chambers | None:
    """Return chambers of a refined pattern: quarters belong to the chamber of their triangle."""
    return chambers and replace(chambers, of_cell=chambers.of_cell[finer.cell])


def refined_force(finer: Refinement, pattern: Pattern, force: Floats) -> Floats:
    """Return dead forces in N on a refined pattern, (n, 3), with the same resultant.

    Force per area is interpolated.

    Args:
        finer: The refinement.
        pattern: The coarse pattern.
        force: Forces on its assembled vertices, (m, 3).
    """
    density = finer.at_vertices(force / pattern.vertex_areas[:, None])
    return np.asarray(density * finer.pattern.vertex_areas[:, None])
