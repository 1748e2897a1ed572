"""Symmetries of periodic rectangles, and unstructured meshes with these symmetries."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import require_choice
from toros_fem.meshes.gmsh_panels import polygon_mesh
from toros_fem.meshes.planar import without_bridges

_TURNS = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]])
_FLIP = np.array([[-1, 0], [0, 1]])
# The operations of each symmetry, matrices (g, 2, 2), the identity first. They act about the
# rectangle's middle or its corner, which is the same up to lattice vectors.
SYMMETRIES: dict[str, Ints] = {
    "none": _TURNS[:1],
    "orthotropic": np.array([_TURNS[0], _FLIP, -_FLIP, _TURNS[2]]),
    "chiral": _TURNS,
    "tetragonal": np.concatenate([_TURNS, _TURNS @ _FLIP]),
}
# Points closer than this fraction of an edge, and centroids than this fraction of a tile, coincide.
SAME = 1e-6


def check_symmetry(symmetry: str, sides: Floats) -> None:
    """Check that a rectangle with these sides in m can have a symmetry.

    Raises:
        ParameterError: The name is unknown, or the symmetry needs a square.
    """
    require_choice("symmetry", symmetry, tuple(SYMMETRIES))
    turned = np.abs(SYMMETRIES[symmetry]) @ sides
    if not np.allclose(turned, sides, rtol=1e-9, atol=0):
        raise ParameterError(
            f"a tile of {sides[0]:.6g} m × {sides[1]:.6g} m cannot be {symmetry}, which needs a "
            "square. Make the sides equal, or use 'orthotropic'."
        )


def unstructured(sides: Floats, counts: Ints, symmetry: str) -> tuple[Floats, Ints]:
    """Mesh [0, a] × [0, b] with opposite borders that match and with a symmetry.

    Only a fundamental region is meshed: all, a quarter, or an eighth. Its images are side by side
    and share no points; points on common lines coincide up to rounding. Call it on one rank.

    Args:
        sides: (a, b) in m.
        counts: Number of edges along each side, even if there is a symmetry.
        symmetry: One of `SYMMETRIES`. For "chiral" the mesh is tetragonal, which includes it.

    Returns:
        Points (m, 2) in m and counter-clockwise triangles (t, 3).
    """
    group = "tetragonal" if symmetry == "chiral" else symmetry
    high, half = sides / 2, counts // 2
    low = -high if group == "none" else np.zeros(2)
    if group == "tetragonal":
        corners = np.array([low, [high[0], low[1]], high])
        divisions = [half[0], half[0], round(np.sqrt(2) * half[0])]
    else:
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        divisions = [*(counts if group == "none" else half)] * 2
    near = SAME * (sides / counts).min()
    region, triangles = polygon_mesh(corners, (sides / counts).min(), counts=divisions)
    for axis in (0, 1):
        # An edge between parallel lines of symmetry would have the same ends as its image.
        lines = region[:, axis].min(), region[:, axis].max()
        on = (np.abs(region[:, axis, None] - lines) <= near).any(axis=1)
        region, triangles, _ = without_bridges(region, triangles, on, ())
    operations = SYMMETRIES[group]
    mirrors = np.linalg.det(operations) < 0
    return (
        np.concatenate([region @ operation.T for operation in operations]) + high,
        np.concatenate(
            [
                len(region) * k + (triangles[:, ::-1] if mirror else triangles)
                for k, mirror in enumerate(mirrors)
            ]
        ),
    )
