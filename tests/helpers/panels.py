"""Patterns of all kinds with a striped print, for machine files."""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from helpers.surfaces import sphere, torus
from toros_fem import meshes
from toros_fem.meshes import Pattern

KINDS = ("tube", "open tube", "walker", "gripper", "finger", "sphere", "torus", "sheet")
CLOSED = ("tube", "walker", "gripper", "finger", "sphere", "torus")


@cache
def pattern_of(kind: str) -> Pattern:
    """A coarse pattern of each kind that the package makes."""
    comm = MPI.COMM_SELF
    if kind == "tube":
        return meshes.cylinder(comm, 0.1, 0.04, 9e-3)
    if kind == "open tube":
        return meshes.cylinder(comm, 0.1, 0.04, 9e-3, caps="base")
    if kind == "sheet":
        return meshes.rectangle(comm, 0.06, 0.04, 8e-3)
    if kind in ("walker", "gripper", "finger"):
        return getattr(meshes, kind)(comm, 8e-3)
    surface = sphere(2, 0.04) if kind == "sphere" else torus(24, 12, 0.05, 0.02)
    return meshes.unwrap(comm, surface).pattern


def striped(pattern: Pattern) -> list[BaseGeometry]:
    """Stripes of 2 mm at a distance of 8 mm on each panel, one of them with a hole."""
    found = []
    for panel in range(len(pattern.panel_names)):
        outline = pattern.outline(panel)
        left, low, right, high = outline.bounds
        stripes = [shapely.box(left, y, right, y + 2e-3) for y in np.arange(low + 3e-3, high, 8e-3)]
        middle = outline.intersection(stripes[len(stripes) // 2]).representative_point()
        hole = middle.buffer(0.5e-3, cap_style="square")
        found.append(outline.intersection(shapely.union_all(stripes)).difference(hole))
    return found
