"""Printable lines along the families of a relaxed design."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_axes, require_kind
from toros_fem.design.lines.centre_lines import Family, trace
from toros_fem.design.lines.ends import close_ends
from toros_fem.design.lines.field import LineField, LineOptions
from toros_fem.design.lines.laid_lines import LaidLines, with_regions
from toros_fem.design.lines.line_mesh import Values, make_line_mesh
from toros_fem.design.lines.ribbons import kept_width
from toros_fem.design.lines.stripes import Stripes, Waves, find_stripes, fitting_spacing
from toros_fem.design.lines.symmetry import Symmetry, make_symmetry
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import equilateral_edge

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
    count = len(field.pattern.panel)
    covered = np.zeros(count, bool) if printed is None else np.asarray(printed)
    if covered.shape != (count,) or covered.dtype != np.bool_:
        raise ParameterError(
            f"printed has shape {covered.shape} and type {covered.dtype}; it must be {count} "
            "truth values, one for each triangle."
        )
    areas = field.pattern.areas * ~covered
    means = areas @ field.shares / max(areas.sum(), np.finfo(float).tiny)
    widths = [options.width_of(k, field.families, float(mean)) for k, mean in enumerate(means)]
    fine, cell = _fine(field, widths, options, like)
    field = LineField(fine, field.shares[cell], field.angles[cell])
    active = ~covered[cell]
    if active.any():
        symmetry = make_symmetry(field, active, planes, widths)
        mesh = symmetry.part
        families, stripes = _families(symmetry, field, planes, widths, options, like)
    else:
        mesh, stripes, none = make_line_mesh(fine, active), {}, np.empty(0)
        families = [Family(width, [], none, none, none, (0.0, none)) for width in widths]
    still = np.zeros(mesh.size, dtype=np.complex128)
    return with_regions(LaidLines(mesh, tuple(families), stripes, planes, options, still))


def _families(
    symmetry: Symmetry,
    field: LineField,
    planes: tuple[int, ...],
    widths: Sequence[float],
    options: LineOptions,
    like: LaidLines | None,
) -> tuple[list[Family], dict[int, Stripes]]:
    """Return the families of lines on the part, and the stripes of those found on the whole."""
    mesh, smoother = symmetry.part, cache(symmetry.whole.smoother)
    known = {} if like is None else like.stripes

    @cache
    def on_whole(family: int) -> tuple[Family, Stripes]:
        width, earlier = widths[family], known.get(family)
        return _on_whole(symmetry, field, family, width, options, smoother, earlier)

    first = [symmetry.first(k) for k in range(field.families)]
    open_ = [symmetry.to_part(on_whole(family)[0], image) for family, image in first]
    shares = mesh.areas @ field.shares[mesh.cells] / mesh.areas.sum()
    families = [
        replace(family, share=float(share))
        for family, share in zip(close_ends(mesh, open_, planes), shares, strict=True)
    ]
    return families, {family: on_whole(family)[1] for family, _ in first}


def _fine(
    field: LineField, widths: list[float], options: LineOptions, like: LaidLines | None
) -> tuple[Pattern, Ints]:
    """Return a mesh that is fine enough for the lines, and the field's triangle of each of its.

    It is as fine as that of earlier lines.
    """
    pattern = field.pattern
    cell: Ints = np.arange(len(pattern.panel))
    means = np.average(field.shares, axis=0, weights=pattern.areas)
    least = min(_spacing(share, width, options) for share, width in zip(means, widths, strict=True))
    while 4 * len(pattern.panel) <= MOST_TRIANGLES:
        edge = equilateral_edge(float(np.median(pattern.areas)))
        if edge <= FINE * least if like is None else len(pattern.panel) >= len(like.pattern.panel):
            break
        refined = refine(pattern)
        pattern, cell = refined.pattern, cell[refined.cell]
    return pattern, cell


def _spacing(share: Floats, width: float, options: LineOptions) -> Floats:
    """Return the distance in m between lines of a width that cover a share."""
    most = width / (width + kept_width(options.print_width))
    return np.asarray(width / np.clip(share, options.least_share, most))


def _on_whole(
    symmetry: Symmetry,
    field: LineField,
    family: int,
    width: float,
    options: LineOptions,
    smoother: Callable[..., Callable[[Values], Values]],
    like: Stripes | None,
) -> tuple[Family, Stripes]:
    """Return a family of lines on the whole, and its stripes; like earlier ones if there are any.

    The smoother is that of the whole; it keeps its factors.
    """
    mesh, part = symmetry.whole, symmetry.part.cells
    share = symmetry.of_whole(field.shares[part], family)
    angle = symmetry.angles_of_whole(field.angles[part], family)
    at_vertices = mesh.at_vertices(share)
    even, half, most = options.even, None, 1.0
    if even is not None:  # what changes from one line to the next cannot be followed
        mean_share = np.asarray(np.average(at_vertices, weights=mesh.vertex_areas))
        even = max(even, float(_spacing(mean_share, width, options)))
        # The other half of the spread is for widths that follow the share.
        half, most = even / 2, float(np.sqrt(options.spread))
    double = smoother(half, turned=True)(mesh.double_angles(angle, share))
    local, mean = smoother(half)(at_vertices), smoother(even)(at_vertices)
    number = np.asarray(2 * np.pi / _spacing(mean, width, options), dtype=np.float64)
    waves = Waves(mesh, np.angle(double) / 2, number)
    weight = np.maximum(mean, options.least_share)
    if even is not None:
        waves = fitting_spacing(waves, weight, ALONG * even, options.spread)
    if like is not None:
        waves = replace(waves, number=like.waves.number)
    present = np.min(local[mesh.edges.ends], axis=1) >= options.least_share
    symmetric, side = symmetry.symmetric(waves, family), symmetry.side(waves, family)

    def found(factor: float) -> Stripes:
        tried = replace(waves, number=factor * waves.number)
        return find_stripes(tried, weight, symmetric, side, like)

    stripes = found(1.0)
    if like is None:
        across = np.sqrt(mesh.areas.sum()) / np.average(waves.spacing, weights=weight)
        factors = 1 + np.array(OTHERS) / across
        factors = factors[(factors >= 1 / most) & (factors <= most)]
        stripes = _with_fewest_ends(stripes, map(found, factors), present)
    waves = stripes.waves
    stiffness = STIFF * float(np.average(waves.spacing, weights=mesh.vertex_areas))
    lines = trace(stripes, present, stiffness)
    # The true spacing: the phase grows faster or slower than wanted where lines close in a ring.
    products = stripes.change * stripes.wanted, stripes.wanted**2
    top, bottom = (smoother(even)(mesh.around(each)) for each in products)
    spacing = 2 * np.pi / (waves.number * np.clip(top / bottom, 0.5, 2.0))
    least = kept_width(options.print_width)
    low = max(least, width / options.spread)
    high = np.maximum(low, np.minimum(width * options.spread, spacing - least))
    radius, bounds = np.clip(local * spacing, low, high) / 2, (low / 2, high / 2)
    return Family(width, lines, waves.corner_angles(), waves.spacing, radius, bounds), stripes


def _with_fewest_ends(best: Stripes, others: Iterator[Stripes], present: Bools) -> Stripes:
    """Return stripes, or others whose lines have fewer ends; these are made as they are needed."""
    fewest = best.line_ends(present)
    while 0 < fewest <= FEW and (other := next(others, None)) is not None:
        ends = other.line_ends(present)
        if ends < fewest:
            best, fewest = other, ends
    return best
