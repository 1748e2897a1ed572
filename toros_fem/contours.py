"""Outlines of panels and of the reinforcement, as polygons on the flat panels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.meshes.pattern import Pattern

Floats = npt.NDArray[np.float64]


def panel_outline(pattern: Pattern, panel: int) -> BaseGeometry:
    """The cloth of a panel as a polygon, in m."""
    corners = pattern.corners[pattern.panel == panel]
    return shapely.coverage_union_all(shapely.polygons(corners))


def reinforcement(pattern: Pattern, density: Floats, panel: int, threshold: float) -> BaseGeometry:
    """Where a panel is reinforced: the region density > threshold, in m.

    The density of the triangles is averaged to the panel's flat vertices by area and
    interpolated linearly, so that lines have smooth borders instead of the mesh's teeth.

    Args:
        pattern: The pattern.
        density: Filtered density ρ̃ of all triangles, (t,). Its contour at η is the design's.
        panel: Number of the panel.
        threshold: η.
    """
    cells = np.flatnonzero(pattern.panel == panel)
    nodes = pattern.flat_triangles[cells]
    count = len(pattern.flat_points)
    area = np.repeat(pattern.areas[cells], 3)
    weight = np.bincount(nodes.ravel(), area, minlength=count)
    sums = np.bincount(nodes.ravel(), area * np.repeat(density[cells], 3), minlength=count)
    value: Floats = sums / np.maximum(weight, np.finfo(float).tiny) - threshold
    # Values of exactly 0 would make polygons of no area.
    value = np.where(value == 0, np.finfo(float).eps, value)
    inside = value[nodes] > 0
    pieces = list(shapely.polygons(pattern.flat_points[nodes[inside.all(axis=1)]]))
    for triangle, within in zip(nodes, inside, strict=True):
        if within.any() and not within.all():
            pieces.append(shapely.Polygon(_clip(pattern.flat_points, value, triangle)))
    return shapely.coverage_union_all(pieces)


def _clip(points: Floats, value: Floats, triangle: npt.NDArray[np.int64]) -> list[Floats]:
    """Corners of the part of a triangle where the linear interpolant is positive."""
    ring = []
    for a, b in zip(triangle, np.roll(triangle, -1), strict=True):
        if value[a] > 0:
            ring.append(points[a])
        if (value[a] > 0) != (value[b] > 0):
            low, high = min(a, b), max(a, b)  # the same rounding from both sides of the edge
            share = value[low] / (value[low] - value[high])
            ring.append(points[low] + share * (points[high] - points[low]))
    return ring


def layout(pattern: Pattern, gap: float) -> list[Floats]:
    """Offset (2,) of each panel in m that puts all panels in one row, without overlap."""
    offsets, right = [], 0.0
    for panel in range(len(pattern.panel_names)):
        corners = pattern.corners[pattern.panel == panel].reshape(-1, 2)
        low, high = corners.min(axis=0), corners.max(axis=0)
        offsets.append(np.array([right - low[0], -low[1]]))
        right += high[0] - low[0] + gap
    return offsets
