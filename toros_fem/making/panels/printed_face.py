"""Panels as they are seen with their printed face up."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.making.options import INSIDE, ManufactureOptions
from toros_fem.meshes.pattern import Pattern


def printed_face(
    pattern: Pattern, regions: Sequence[BaseGeometry], options: ManufactureOptions
) -> tuple[Pattern, list[BaseGeometry]]:
    """Return a pattern, and polygons on its panels, as seen with the printed face up.

    The panels of a pattern are seen from outside. For a print on the inside they are mirrored,
    (−x, y), and so is the assembled skin, which keeps it a valid pattern.

    Args:
        pattern: The pattern.
        regions: Polygons on each panel, in m.
        options: Which face is printed.
    """
    if options.print_side != INSIDE:
        return pattern, list(regions)
    seen = Pattern(
        flat_points=pattern.flat_points * [-1, 1],
        flat_triangles=pattern.flat_triangles[:, ::-1],
        panel=pattern.panel,
        sewn=pattern.sewn,
        points=pattern.points * [-1, 1, 1],
        panel_names=pattern.panel_names,
        seam_tolerance=pattern.seam_tolerance,
        moulded=pattern.moulded,
    )
    return seen, [mirrored_region(region) for region in regions]


def mirrored_region(region: BaseGeometry) -> BaseGeometry:
    """Return a region at (−x, y)."""
    return shapely.transform(region, lambda points: points * [-1, 1])
