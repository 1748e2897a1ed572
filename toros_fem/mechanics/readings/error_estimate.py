"""Errors of the mesh: half-widths of intervals, from coarser ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from toros_fem.base.validation import Floats
from toros_fem.measures.figures import split_key
from toros_fem.meshes.triangles import EQUILATERAL

# Part of the error that coarser meshes tell.
SHARE = 0.65
# What no coarser mesh tells, by unit: bending beside stiff lines above all, in layers of 0.2 mm. Of
# lengths it is a part of the skin's size, in m. Angles are those of a skin as slender, length over
# width, as the tubes of the study. All are of the study's edges in m, and shrink with shorter ones.
UNSEEN = {"deg": 0.5, "percent": 0.45, "ratio": 0.0045}
LENGTHS = {"m": 0.006, "mm": 6.0}
SLENDER = 2.1
EDGE = 1.2e-3


def half_width(
    changes: Mapping[float, float], key: str, extents: Sequence[float], edge: float
) -> float:
    """Return the half-width of an interval, from how far coarser meshes tell otherwise.

    An error that grows with the edge length as far as a coarser mesh tells is c/(r − 1), with the
    change c to edges r times as long. The half-width is a part of the largest of these, and what no
    coarser mesh tells. Both were fitted to prints of many kinds (docs/accuracy.md).

    Args:
        changes: The changes, by the edge length of the coarser mesh over that of the mesh.
        key: Name and unit of the value, such as "angle_deg".
        extents: Extents of the skin along three axes in m.
        edge: Edge length of the mesh in m, as of `edge_of`.
    """
    known, (_, wide, size) = split_key(key), sorted(extents)
    unit = known[1] if known else ""
    least = UNSEEN.get(unit, LENGTHS.get(unit, 0.0) * size)
    if unit == "deg":  # turns add up along the skin, those of its parts not alike
        least *= max(1.0, size / wide / SLENDER) ** 0.5
    told = max(change / (ratio - 1) for ratio, change in changes.items())
    return SHARE * told + least * min(1.0, edge / EDGE)


def edge_of(areas: Floats) -> float:
    """Return the edge length of equilateral triangles of the mean of areas, (t,), in m."""
    return float(np.sqrt(np.mean(areas) / EQUILATERAL))
