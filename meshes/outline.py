"""Skins of two equal flat panels, sewn along their outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import OutlineError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import checked_axes, require_kind, shown
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.planar import Line, region_mesh

TOP, BOTTOM = "top", "bottom"
# Root mean square slope of the pillow. The mean strain of the assembled panels is half its square.
SLOPE = 0.02


@collective("comm")
def two_panels(
    comm: MPI.Comm,
    outline: npt.ArrayLike,
    edge_length: float,
    *,
    lines: Sequence[Line] = (),
    planes: Sequence[int] = (),
) -> Pattern:
    """Make two equal panels, "top" and "bottom", sewn along an outline (collective).

    Both have the same mesh, so that they fit vertex by vertex. The assembled skin lies in the plane
    z = 0, apart from a slight pillow with the top at z > 0, which defines the inside.
    The stress-free shape is flat. The first two coordinates of `Pattern.points` are the place in
    the outline on either panel. The flat coordinates of the bottom are mirrored, (x, −y).

    Args:
        comm: Communicator; gmsh runs on its first rank only.
        outline: Points (k, 2) in m of the whole closed outline: corners, and points on arcs. A
            point where it turns by more than 20° is a corner. Between corners it is divided evenly.
        edge_length: Target edge length in m.
        lines: Straight lines from border to border of the whole outline, ((x, y), (x, y)) in m,
            along which both panels get mesh edges.
        planes: Symmetry planes that cut the skin: 0 keeps x ≥ 0, 1 keeps y ≥ 0. The cut is not
            sewn: `symmetry_plane` supports it, `mirrored` completes the skin.

    Raises:
        OutlineError: The outline crosses itself, is not symmetric, or does not fit its lines or
            the edge length.
    """
    if not isinstance(lines, list | tuple):
        raise OutlineError(f"lines = {shown(lines)} must be a list of lines, () for none.")
    planes = checked_axes("planes", planes, (0, 1), OutlineError)

    def build() -> Pattern:
        flat, triangles, seam = region_mesh(outline, edge_length, lines, planes)
        count = len(flat)
        height = _pillow(flat, triangles, seam)
        below = np.where(seam, np.arange(count), count + np.cumsum(~seam) - 1)
        return Pattern(
            flat_points=np.concatenate([flat, flat * [1, -1]]),
            flat_triangles=np.concatenate([triangles, count + triangles[:, ::-1]]),
            panel=np.repeat([0, 1], len(triangles)),
            sewn=np.concatenate([np.arange(count), below]),
            points=np.concatenate(
                [np.column_stack([flat, height]), np.column_stack([flat, -height])[~seam]]
            ),
            panel_names=(TOP, BOTTOM),
        )

    return on_first_rank(comm, build)


def plane_centroids(pattern: Pattern) -> Floats:
    """Return the place of each triangle in the outline, (t, 2), in m, the same on both panels.

    `Pattern.centroids` are in each panel's own coordinates, which are mirrored on the bottom.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    return pattern.points[pattern.triangles, :2].mean(axis=1)


def _pillow(flat: Floats, triangles: Ints, seam: Bools) -> Floats:
    """Return heights (m,) of a membrane under pressure, −Δu = 1, fixed at the seam only."""
    count = len(flat)
    a, b, c = np.moveaxis(flat[triangles], 1, 0)
    opposite = np.stack([c - b, a - c, b - a], axis=1)
    area = (opposite[:, 0, 0] * opposite[:, 1, 1] - opposite[:, 0, 1] * opposite[:, 1, 0]) / 2
    gradients = opposite[:, :, ::-1] * [-1, 1] / (2 * area)[:, None, None]
    local = np.einsum("tid,tjd,t->tij", gradients, gradients, area)
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))
    stiffness = coo_array(
        (local.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count)
    ).tocsc()
    load = np.bincount(triangles.ravel(), np.repeat(area / 3, 3), minlength=count)
    inner = np.flatnonzero(~seam)
    height = np.zeros(count)
    height[inner] = spsolve(stiffness[inner][:, inner], load[inner])
    # ∫ |∇u|² = ∫ u hardly depends on the mesh. The steepest slope, at inner corners, would.
    return np.asarray(SLOPE * height / np.sqrt(load @ height / area.sum()))
