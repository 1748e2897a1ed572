"""Supports of symmetric parts."""

import numpy as np

from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern


def rests(pattern: Pattern, planes: tuple[int, ...]) -> Supports:
    """Held at the symmetry planes, at the body's middle, and against turning about z."""
    away = np.linalg.norm(pattern.points[:, :2], axis=1)
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    for panel in pattern.panel_names:
        vertices = pattern.vertices_of(panel)
        middle = vertices[np.argmin(away[vertices])]
        fixed[middle] = [True, True, panel == "bottom"]
    # The vertex on the x axis that is farthest out stays on it by symmetry.
    fixed[np.argmax(pattern.points[:, 0] - 1e3 * np.abs(pattern.points[:, 1])), 1] = True
    supports = Supports(fixed)
    for axis in planes:
        supports |= symmetry_plane(pattern, axis)
    return supports
