"""Lines drawn by hand on the tube, for comparison: nothing of this enters a design."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Bools
from toros_fem.base.validation import require_count, require_positive
from toros_fem.meshes import Pattern
from toros_fem.meshes.cylinder import WALL


def helices(pattern: Pattern, count: int, angle: float, width: float) -> Bools:
    """Return which triangles lie on helical lines around the tube, (t,).

    Args:
        pattern: The tube.
        count: Number of lines around.
        angle: Their angle to the axis in rad, positive if right-handed.
        width: Width of each line in m.
    """
    require_count(1, count=count)
    require_positive(width=width)
    u, v = pattern.centroids.T
    cells = pattern.cells_of(WALL)
    pitch = np.ptp(pattern.corners[cells, :, 0]) / count
    phase = (u - np.tan(angle) * v) % pitch
    off = np.minimum(phase, pitch - phase) * np.cos(angle)
    return np.asarray((pattern.panel == pattern.panel_index(WALL)) & (off < width / 2))
