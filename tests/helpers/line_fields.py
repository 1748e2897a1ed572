"""Patterns for line families."""

import numpy as np

from toros_fem.meshes import Pattern
from toros_fem.meshes.pattern import Panel


def two_sheets(turn: float) -> Pattern:
    """Two rectangles in one plane, sewn along a side; the chart of the second is turned."""
    n, h = 6, 5e-3
    u, v = (a.ravel() for a in np.meshgrid(*[h * np.arange(n + 1)] * 2))
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    triangles = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    panels = []
    for k, name in enumerate(("left", "right")):
        place = np.column_stack([u + k * n * h, v])
        angle = k * turn
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = np.column_stack([place, 0 * u])
        panels.append(Panel(name, place @ rotation.T, triangles, points))
    return Pattern.from_panels(panels, tolerance=1e-6)
