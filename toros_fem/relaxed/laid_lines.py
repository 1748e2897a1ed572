"""Printable lines along the families of a relaxed design."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Bools, Floats, Ints
from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.transfer import scaled_points
from toros_fem.relaxed.centre_lines import CentreLine, trace
from toros_fem.relaxed.line_ends import BORDER, LINE, PRINTED, Family, close_ends
from toros_fem.relaxed.line_field import LineField
from toros_fem.relaxed.line_options import LineOptions
from toros_fem.relaxed.line_symmetry import Symmetry, make_symmetry
from toros_fem.relaxed.stripes import (
    Layout,
    Stripes,
    Waves,
    find_stripes,
    fitting_spacing,
    line_ends,
)
from toros_fem.relaxed.strips import EXCESS, Strip, cleaned, joints_of, ribbons
from toros_fem.relaxed.transport import LineMesh

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
# Corners of the pieces that a region is divided into before it is cut by triangles.
PIECE = 40


@dataclass(frozen=True)
class LaidFamily:
    """What became of one family of lines.

    Attributes:
        width: Width asked, in m.
        lines: Number of lines.
        length: Their total length in m.
        share: Part of the area, without that printed before, that the field asks for.
        laid: Part of it that the family covers.
        ends: How many ends lie at what.
    """

    width: float
    lines: int
    length: float
    share: float
    laid: float
    ends: dict[str, int]


@dataclass(frozen=True, eq=False)
class LaidLines:
    """Printable lines on the panels of a pattern.

    Attributes:
        pattern: The pattern that they were laid on: that of the field, refined.
        regions: Printed region of each panel, polygons in its chart, in m.
        centre_lines: Centre lines of each family, through triangles of `pattern`.
        families: What became of each family.
        layouts: Where the stripes of families lie, by the number of the family; those of mirror
            images are left out.
    """

    pattern: Pattern
    regions: tuple[BaseGeometry, ...]
    centre_lines: tuple[tuple[CentreLine, ...], ...]
    families: tuple[LaidFamily, ...]
    layouts: Mapping[int, Layout]

    @property
    def area(self) -> float:
        """Printed area in m²."""
        return float(sum(region.area for region in self.regions))

    def cover(self, pattern: Pattern) -> Floats:
        """Return the part of each triangle that is printed, (t,), by exact areas.

        Args:
            pattern: A pattern with the same panels, of any mesh.

        Raises:
            PanelError: Its panels are others.
        """
        flat = scaled_points(self.pattern, pattern)
        covered = np.zeros(len(pattern.panel))
        for name in pattern.panel_names:
            region = self.regions[self.pattern.panel_index(name)]
            cells = pattern.cells_of(name)
            covered[cells] = _covered(region, flat[pattern.flat_triangles[cells]])
        return covered


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
    """
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
    asked = np.zeros(field.families)
    families: list[Family] = []
    regions: tuple[BaseGeometry, ...] = _outlines(fine)
    laid = [0.0] * field.families
    layouts: dict[int, Layout] = {}
    if len(free):
        symmetry = make_symmetry(fine_field, free, planes, widths)
        mesh = symmetry.part
        known = {} if like is None else like.layouts
        families, layouts = _families(symmetry, fine_field, widths, options, known)
        families = close_ends(mesh, families, planes)
        strips = _strips(mesh, families)
        regions, laid = _regions(fine, mesh, strips, tuple(planes), options)
        asked = mesh.areas @ fine_field.shares[mesh.cells] / mesh.areas.sum()
    lines = tuple(
        tuple(replace(line, cell=free[line.cell]) for line in family.lines) for family in families
    )
    lines = lines or ((),) * field.families
    report = [
        LaidFamily(width, len(own), sum(line.length for line in own), float(a), b, _ends(own))
        for width, own, a, b in zip(widths, lines, asked, laid, strict=True)
    ]
    return LaidLines(fine, regions, lines, tuple(report), layouts)


def _ends(lines: Sequence[CentreLine]) -> dict[str, int]:
    """Return how many ends lie at what."""
    return dict(sorted(Counter(end for line in lines for end in line.ends or ()).items()))


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
    found: dict[int, tuple[list[CentreLine], Waves, Floats]] = {}
    layouts: dict[int, Layout] = {}
    families = []
    for k, width in enumerate(widths):
        own, image = symmetry.first(k)
        if own not in found:
            found[own], layouts[own] = _on_whole(
                symmetry, field, own, width, options, known.get(own)
            )
        lines, waves, radius = found[own]
        families.append(
            Family(
                symmetry.restricted(lines, image),
                symmetry.angles_to_part(waves, image),
                symmetry.vertices_to_part(waves.spacing, image),
                symmetry.vertices_to_part(radius, image),
                width,
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
) -> tuple[tuple[list[CentreLine], Waves, Floats], Layout]:
    """Return a family's lines on the whole, waves, half the width at vertices; their layout."""
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
    low = max((1 + 2 * EXCESS) * options.print_width, width / options.spread)
    high = np.maximum(low, np.minimum(width * options.spread, spacing - options.print_width))
    radius = np.clip(local * spacing, low, high) / 2
    return (lines, waves, radius), Layout(waves, stripes.phase)


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


def _strips(mesh: LineMesh, families: list[Family]) -> list[list[Strip]]:
    """Return the strips of the lines of each family.

    One that ends on a thinner line tapers to its width, so that it does not stand out behind it.
    """
    panel = mesh.pattern.panel[mesh.cells]
    lines = [(number, line) for number, family in enumerate(families) for line in family.lines]
    strips: list[list[Strip]] = [[] for _ in families]
    if not lines:
        return strips
    own = np.repeat(np.arange(len(lines)), [len(line.cell) for _, line in lines])
    cells = np.concatenate([line.cell for _, line in lines])
    segments = np.concatenate([line.points for _, line in lines])
    for k, (number, line) in enumerate(lines):
        radii = _radii(mesh, families[number], line.cell, line.points)
        for side, kind in enumerate(line.ends or ()):
            if kind != LINE:
                continue
            last = 0 if side == 0 else -1
            end = line.points[last, side]
            there = np.flatnonzero((cells == line.cell[last]) & (own != k))
            if not len(there):
                continue
            other = there[np.argmin(_distances(end, segments[there]))]
            onto = families[lines[int(own[other])][0]]
            bound = _radii(mesh, onto, line.cell[[last]], np.repeat(end[None, None], 2, axis=1))
            length = np.linalg.norm(line.points[:, 1] - line.points[:, 0], axis=1)
            along = np.concatenate([[0.0], np.cumsum(length if side == 0 else length[::-1])])
            along = along if side == 0 else along[::-1]
            away = np.stack([along[:-1], along[1:]], axis=1)
            radii = np.minimum(radii, bound[0, 0] + away)
        start, end_kind = line.ends or (LINE, LINE)
        beyond = start in (BORDER, PRINTED), end_kind in (BORDER, PRINTED)
        strips[number].append(Strip(panel[line.cell], line.points, radii, beyond))
    return strips


def _radii(mesh: LineMesh, family: Family, cell: Ints, points: Floats) -> Floats:
    """Return half the width of a family at the ends of segments (m, 2, 2), (m, 2), in m."""
    cells = np.repeat(cell, 2)
    at = mesh.barycentric(cells, points.reshape(-1, 2))
    radius = np.einsum("kc,kc->k", at, family.radius[mesh.vertex[cells]])
    return np.asarray(radius).reshape(-1, 2)


def _distances(point: Floats, segments: Floats) -> Floats:
    """Return the distance of a point from segments (m, 2, 2), (m,)."""
    return np.asarray(shapely.distance(shapely.linestrings(segments), shapely.Point(point)))


def _regions(
    pattern: Pattern,
    mesh: LineMesh,
    strips: list[list[Strip]],
    planes: tuple[int, ...],
    options: LineOptions,
) -> tuple[tuple[BaseGeometry, ...], list[float]]:
    """Return the printed region of each panel, and the part of the area under each family."""
    joints = joints_of(pattern, planes)
    free = np.zeros(len(pattern.panel), dtype=bool)
    free[mesh.cells] = True
    laid, regions = np.zeros(len(strips)), []
    for panel in range(len(pattern.panel_names)):
        here = pattern.panel == panel
        before = shapely.coverage_union_all(shapely.polygons(pattern.corners[here & ~free]))
        if not np.any(here & free):
            regions.append(before)
            continue
        bare = shapely.coverage_union_all(shapely.polygons(pattern.corners[here & free]))
        shapely.prepare(bare)
        unions = [
            shapely.union_all(ribbons(family, panel, joints, options.print_width))
            for family in strips
        ]
        laid += [union.intersection(bare).area for union in unions]
        region = cleaned(shapely.union_all(unions), options.print_width, options.hole_area)
        regions.append(shapely.union_all([region.intersection(bare), before]))
    return tuple(regions), (laid / mesh.areas.sum()).tolist()


def _covered(region: BaseGeometry, corners: Floats) -> Floats:
    """Return the part of triangles (t, 3, 2) that a region covers, (t,)."""
    triangles = shapely.polygons(corners)
    whole = shapely.area(triangles)
    pieces = np.array(_divided(region), dtype=object)
    found = np.zeros(len(corners))
    if not len(pieces):
        return found
    triangle, piece = shapely.STRtree(pieces).query(triangles, predicate="intersects")
    area = shapely.area(shapely.intersection(triangles[triangle], pieces[piece]))
    np.add.at(found, triangle, area)
    return np.clip(found / whole, 0.0, 1.0)


def _divided(region: BaseGeometry) -> list[BaseGeometry]:
    """Return pieces of a region with few corners each; they only share borders."""
    done: list[BaseGeometry] = []
    left = list(shapely.get_parts(region))
    while left:
        part = left.pop()
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if shapely.get_num_coordinates(part) <= PIECE:
            done.append(part)
            continue
        x, y, right, top = part.bounds
        if right - x > top - y:
            middle = (x + right) / 2
            halves = (x, y, middle, top), (middle, y, right, top)
        else:
            middle = (y + top) / 2
            halves = (x, y, right, middle), (x, middle, right, top)
        for half in halves:
            left += list(shapely.get_parts(shapely.intersection(part, shapely.box(*half))))
    return done
