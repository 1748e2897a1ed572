"""Panels as they are seen with their printed face up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from shapely.geometry.base import BaseGeometry

from toros_fem.making.options import INSIDE, ManufactureOptions
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern


def printed_face(
    pattern: Pattern, regions: Sequence[BaseGeometry], options: ManufactureOptions
) -> tuple[Pattern, list[BaseGeometry]]:
    """Return a pattern, and polygons on its panels, as seen with the printed face up.

    The panels of a pattern are seen from outside. For a print on the inside they are mirrored,
    (−x, y), and so is the assembled skin, which keeps it a valid pattern.

    Args:
        regions: Polygons on each panel, in m.
        options: Which face is printed.
    """
    if options.print_side != INSIDE:
        return pattern, list(regions)
    mirror = Affine.mirror()
    seen = replace(
        pattern,
        flat_points=mirror.points(pattern.flat_points),
        flat_triangles=pattern.flat_triangles[:, ::-1],
        points=pattern.points * [-1, 1, 1],
    )
    return seen, [mirror.region(region) for region in regions]
