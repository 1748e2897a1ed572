"""Printable lines along the families of a relaxed design."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_axes, require_kind
from toros_fem.design.lines.centre_lines import CentreLine, trace
from toros_fem.design.lines.ends import Family, close_ends
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.laid_lines import Drawing, LaidFamily, LaidLines, laid
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.lines.stripes import (
    Layout,
    Stripes,
    Waves,
    find_stripes,
    fitting_spacing,
    line_ends,
)
from toros_fem.design.lines.strips import EXCESS
from toros_fem.design.lines.symmetry import Symmetry, make_symmetry
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import refine

# Edges of the mesh that lines are laid on are at most this fraction of the least spacing, but it
# has at most so many triangles.
FINE = 0.4
MOST_TRIANGLES = 60_000
# Distance over which spacings are adapted to directions, as a multiple of `LineOptions.even`.
ALONG = 2.0
# If only so many ends of lines lie in the open, other spacings may do without: with how many more
# lines across the skin.
FEW = 4
OTHERS = (0.5, -0.5, 1.0, -1.0, 1.5, -1.5)
# Stiffness of the lines, as a multiple of their spacing.
STIFF = 0.3


def lay_lines(
    field: LineField,
    options: LineOptions | None = None,
    *,
    printed: Bools | None = None,
    planes: Sequence[int] = (),
    like: LaidLines | None = None,
) -> LaidLines:
    """Lay lines of printable width along the families of a field.

    All is done on one rank: under MPI, call it on the first one (`on_first_rank`).

    Args:
        field: Shares and directions.
        options: Widths and limits.
        printed: Triangles of the field's pattern that are printed all over, (t,). They carry no
            lines, and lines may end at them.
        planes: Symmetry planes at which the pattern is cut, as of `mirrored`.
        like: Lines that were laid on the same pattern before, for a field that was little
            different: their number stays, and widths take up changes of the shares.

    Raises:
        ParameterError: `printed` does not fit the pattern, or the options the field.
        PatternError: The skin is moulded.
    """
    require_kind("field", field, LineField, "a LineField")
    require_kind("options", options, (LineOptions, type(None)), "LineOptions, or None")
    require_kind("like", like, (LaidLines, type(None)), "LaidLines, or None")
    planes = checked_axes("planes", planes)
    field.pattern.require_flat_panels("laying lines")
    options = options or LineOptions()
    widths = [options.width_of(k, field.families) for k in range(field.families)]
    count = len(field.pattern.panel)
    covered = np.zeros(count, bool) if printed is None else np.asarray(printed)
    if covered.shape != (count,) or covered.dtype != np.bool_:
        raise ParameterError(
            f"printed has shape {covered.shape} and type {covered.dtype}; it must be {count} "
            "truth values, one for each triangle."
        )
    fine, cell = _fine(field, widths, options, None if like is None else len(like.pattern.panel))
    fine_field = LineField(fine, field.shares[cell], field.angles[cell])
    free = np.flatnonzero(~covered[cell])
    if not len(free):
        none = (shapely.Polygon(),) * len(fine.panel_names)
        report = tuple(LaidFamily(width, 0, 0.0, 0.0, 0.0, {}) for width in widths)
        empty, under = ((),) * field.families, (none,) * field.families
        return LaidLines(fine, _outlines(fine), empty, report, {}, under, None)
    symmetry = make_symmetry(fine_field, free, planes, widths)
    mesh = symmetry.part
    known = {} if like is None else like.layouts
    families, layouts = _families(symmetry, fine_field, widths, options, known)
    families = close_ends(mesh, families, planes)
    asked = mesh.areas @ fine_field.shares[mesh.cells] / mesh.areas.sum()
    return laid(Drawing(mesh, families, asked, tuple(planes), options), layouts)


def _outlines(pattern: Pattern) -> tuple[BaseGeometry, ...]:
    """Return the outline of each panel."""
    return tuple(
        shapely.coverage_union_all(shapely.polygons(pattern.corners[pattern.panel == panel]))
        for panel in range(len(pattern.panel_names))
    )


def _fine(
    field: LineField, widths: list[float], options: LineOptions, triangles: int | None
) -> tuple[Pattern, Ints]:
    """Return a mesh that is fine enough for the lines, and the field's triangle of each of its.

    With a number of triangles it is the one that has so many.
    """
    pattern = field.pattern
    cell: Ints = np.arange(len(pattern.panel), dtype=np.int64)
    means = np.average(field.shares, axis=0, weights=pattern.areas)
    spacings = [_spacing(share, width, options) for share, width in zip(means, widths, strict=True)]
    while 4 * len(pattern.panel) <= MOST_TRIANGLES:
        edge = np.sqrt(np.median(pattern.areas) * 4 / np.sqrt(3))
        fine = edge <= FINE * min(spacings)
        if fine if triangles is None else len(pattern.panel) >= triangles:
            break
        refined = refine(pattern)
        pattern, cell = refined.pattern, cell[refined.cell]
    return pattern, cell


def _spacing(share: Floats, width: float, options: LineOptions) -> Floats:
    """Return the distance in m between lines of a width that cover a share."""
    most = width / (width + options.print_width)
    return np.asarray(width / np.clip(share, options.least_share, most), dtype=np.float64)


def _least_width(width: float, options: LineOptions) -> float:
    """Return the least local width in m of lines of which a width is asked."""
    return max((1 + 2 * EXCESS) * options.print_width, width / options.spread)


def _families(
    symmetry: Symmetry,
    field: LineField,
    widths: list[float],
    options: LineOptions,
    known: Mapping[int, Layout],
) -> tuple[list[Family], dict[int, Layout]]:
    """Return the lines of each family on the part, and where they lie on the whole.

    Those of mirror images are found once.
    """
    found: dict[int, tuple[list[CentreLine], Waves, Floats, Floats]] = {}
    layouts: dict[int, Layout] = {}
    families = []
    for k, width in enumerate(widths):
        own, image = symmetry.first(k)
        if own not in found:
            found[own], layouts[own] = _on_whole(
                symmetry, field, own, width, options, known.get(own)
            )
        lines, waves, radius, largest = found[own]
        families.append(
            Family(
                symmetry.restricted(lines, image),
                symmetry.angles_to_part(waves, image),
                symmetry.vertices_to_part(waves.spacing, image),
                symmetry.vertices_to_part(radius, image),
                width,
                (
                    _least_width(width, options) / 2,
                    symmetry.vertices_to_part(largest, image),
                ),
            )
        )
    return families, layouts


def _on_whole(
    symmetry: Symmetry,
    field: LineField,
    family: int,
    width: float,
    options: LineOptions,
    like: Layout | None,
) -> tuple[tuple[list[CentreLine], Waves, Floats, Floats], Layout]:
    """Return a family's lines on the whole, waves, half the width and its bound; their layout."""
    mesh, part = symmetry.whole, symmetry.part.cells
    share = symmetry.of_whole(field.shares[part], family)
    angle = symmetry.angles_of_whole(field.angles[part], family)
    at_vertices = mesh.at_vertices(share)
    mean_share = float(np.average(at_vertices, weights=mesh.vertex_areas))
    even = options.even
    if even is not None:  # what changes from one line to the next cannot be followed
        even = max(even, float(_spacing(np.array(mean_share), width, options)))
    half = None if even is None else even / 2
    double = mesh.smooth_directions(mesh.double_angles(angle, share), half)
    local, mean = mesh.smooth(at_vertices, half), mesh.smooth(at_vertices, even)
    direction = np.angle(double).astype(np.float64) / 2
    waves = Waves(mesh, direction, np.asarray(2 * np.pi / _spacing(mean, width, options)))
    weight = np.maximum(mean, options.least_share)
    if even is not None:
        waves = fitting_spacing(waves, weight, ALONG * even, options.spread)
    enough = local >= options.least_share
    i, j = mesh.edges.ends.T
    present = enough[i] & enough[j]
    images, side = symmetry.images(waves, family), symmetry.side(waves, family)

    def found(tried: Waves) -> Stripes:
        return find_stripes(tried, weight, images, side, like)

    # The other half of the spread is for widths that follow the share.
    most = np.sqrt(options.spread) if even is not None else 1.0
    if like is None:
        waves, stripes = _with_fewest_ends(waves, weight, present, found, most)
    else:
        waves = replace(waves, number=like.waves.number)
        stripes = found(waves)
    stiffness = STIFF * float(np.average(waves.spacing, weights=mesh.vertex_areas))
    lines = trace(mesh, stripes, present, stiffness)
    # The true spacing: the phase grows faster or slower than wanted where lines close in a ring.
    products = stripes.change * stripes.wanted, stripes.wanted**2
    top, bottom = (mesh.smooth(mesh.around(product), even) for product in products)
    spacing = 2 * np.pi / (waves.number * np.clip(top / bottom, 0.5, 2.0))
    low = _least_width(width, options)
    high = np.maximum(low, np.minimum(width * options.spread, spacing - options.print_width))
    radius = np.clip(local * spacing, low, high) / 2
    return (lines, waves, radius, high / 2), Layout(waves, stripes.phase)


def _with_fewest_ends(
    waves: Waves,
    weight: Floats,
    present: Bools,
    find: Callable[[Waves], Stripes],
    most: float,
) -> tuple[Waves, Stripes]:
    """Return waves and their stripes, denser or wider ones if fewer lines end so.

    Args:
        waves: The waves wanted.
        weight: How much stripes count at each vertex, (n,).
        present: Whether there are lines at each edge, (e,).
        find: Finds the stripes of waves.
        most: Largest factor by which spacings may be changed.
    """
    mesh = waves.mesh
    best, stripes = waves, find(waves)
    fewest = line_ends(mesh, stripes, present)
    across = np.sqrt(mesh.areas.sum()) / float(np.average(waves.spacing, weights=weight))
    for more in OTHERS:
        factor = 1 + more / across
        if not 0 < fewest <= FEW:
            break
        if not 1 / most <= factor <= most:
            continue
        other = replace(waves, number=factor * waves.number)
        tried = find(other)
        ends = line_ends(mesh, tried, present)
        if ends < fewest:
            best, stripes, fewest = other, tried, ends
    return best, stripes
