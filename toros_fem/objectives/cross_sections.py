"""Cross-sections of slender skins, as groups of vertices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from toros_fem._types import Ints
from toros_fem._validate import require_count
from toros_fem.meshes.pattern import Pattern


def cross_sections(
    pattern: Pattern, vertices: Ints, along: npt.ArrayLike, count: int, *, border: bool = True
) -> Ints:
    """Section of each assembled vertex, (n,), in slabs of equal length along a direction.

    Args:
        pattern: The pattern.
        vertices: Which vertices are meant; all others are in no section, −1.
        along: Direction in the assembled skin, (3,).
        count: How many slabs.
        border: Whether the vertices farthest out, those of a tube's end, make one section more,
            the last.
    """
    require_count(1, count=count)
    label = np.full(len(pattern.points), -1)
    height = pattern.points[vertices] @ np.asarray(along, dtype=np.float64)
    share = (height - height.min()) / np.ptp(height)
    label[vertices] = np.minimum((share * count).astype(int), count - 1)
    if border:
        label[vertices[share > 1 - 1e-9]] = count
    return label


def section_vertices(label: Ints, least: int = 3) -> list[Ints]:
    """Vertices of each section, those of fewer than `least` left out."""
    found = [np.flatnonzero(label == k) for k in range(int(label.max(initial=-1)) + 1)]
    return [group for group in found if len(group) >= least]
