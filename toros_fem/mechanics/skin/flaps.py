"""Flaps: the triangles across the edges of each triangle, in its own flat chart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, LocalInts
from toros_fem.mechanics.skin.hinges import flat_corners, guided_edges, neighbours, unfolded
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin


@dataclass(frozen=True, eq=False)
class Flaps:
    """What the local triangles see across their edges; of owned ones it is complete.

    Edge i of a triangle lies opposite its corner i and runs from corner i + 1 to i + 2, modulo 3.

    Attributes:
        flap: Node of the position space across each edge, (cells, 3), as of `Hinges`.
        neighbour: Local triangle across each edge, (cells, 3); at a free border and at a plane of
            symmetry, which mirrors it, the triangle itself.
        share: Area of that triangle over that of both, (cells, 3); 0 at a free border.
        across: Inverse of the matrix whose columns are the edge and the vector from its start to
            the flap in the own flat chart, (cells, 3, 2, 2), in 1/m.
        chart: The matrix B of `forms.smoothing.Smoothing` at each edge, (cells, 3, 2, 2).
    """

    flap: LocalInts
    neighbour: LocalInts
    share: Floats
    across: Floats
    chart: Floats


def find_flaps(skin: Skin, supports: Supports) -> Flaps:
    """Return the flaps of the triangles of a skin with planes of symmetry."""
    corner, flat = skin.position_space.dofmap.list, flat_corners(skin)
    neighbour, opposite = neighbours(skin)
    alone = neighbour == np.arange(len(corner))[:, None]
    _, mirrored = guided_edges(skin, corner, supports)
    own = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
    area = np.abs(np.linalg.det(own)) / 2
    share: Floats = area[neighbour] / (area[:, None] + area[neighbour])
    start, end = np.roll(flat, -1, axis=1), np.roll(flat, -2, axis=1)
    there = unfolded(flat, corner, neighbour, opposite)
    across = np.asarray(
        np.linalg.inv(np.stack([end - start, there - start], axis=3)), dtype=np.float64
    )
    flap = np.where(alone, corner, corner[neighbour, opposite]).astype(np.int32)
    share = np.where(alone & ~mirrored, 0.0, share)
    chart = np.asarray(across @ own[:, None], dtype=np.float64)
    return Flaps(flap, neighbour, share, across, chart)
