"""Seam allowance: the cut outline beyond the seam lines of a panel."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# A corner sharper than this many allowances is cut off.
MITRE = 2.0
# Gaps and spikes below this fraction of the allowance are rounding.
TINY = 1e-3


def cut_outline(outline: BaseGeometry, lines: Sequence[Floats], allowance: float) -> BaseGeometry:
    """Return a panel's outline with its allowance, a width in m, along some lines of its border.

    Corners are mitred, sharp ones cut off at twice the allowance. At the end of a line, points
    (n, 2) in m, the allowance ends at a right angle to it. Where the allowances of both sides of a
    dart or slit meet, the fabric between them stays.
    """
    if not len(lines):
        return outline
    around = outline.buffer(allowance, join_style="mitre", mitre_limit=MITRE)
    sewn = shapely.line_merge(shapely.multilinestrings([shapely.linestrings(k) for k in lines]))
    tiny = TINY * allowance
    free = outline.boundary.difference(sewn.buffer(tiny))
    if free.length <= tiny:
        return _solid(around, outline, tiny)
    bands = sewn.buffer(allowance, cap_style="flat", join_style="mitre", mitre_limit=MITRE)
    parts = shapely.get_parts(bands.intersection(around).difference(outline))
    # At a sharp corner the inner half of a band comes out of the panel: it only touches the line.
    beside = shapely.length(shapely.intersection(parts, sewn.buffer(tiny))) > 8 * tiny
    return _solid(shapely.union_all([outline, *parts[beside]]), outline, tiny)


def _solid(cut: BaseGeometry, outline: BaseGeometry, tiny: float) -> BaseGeometry:
    """Return the one polygon around a panel, without spikes and slits of rounding."""
    smooth = cut.buffer(tiny, join_style="mitre").buffer(-2 * tiny, join_style="mitre")
    smooth = smooth.buffer(tiny, join_style="mitre").union(outline)
    parts = shapely.get_parts(smooth)
    largest = max(parts, key=lambda part: part.intersection(outline).area)
    return shapely.remove_repeated_points(largest, tiny)
