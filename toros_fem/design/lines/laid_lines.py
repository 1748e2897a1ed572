"""Lines with their widths, and the printed regions that they make."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.rounding import rounded
from toros_fem.design.lines.centre_lines import CentreLine
from toros_fem.design.lines.ends import BORDER, LINE, PRINTED, Family
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.lines.stripes import Layout
from toros_fem.design.lines.strips import Strip, cleaned, joints_of, ribbons
from toros_fem.design.lines.transport import LineMesh
from toros_fem.meshes.panels import cut_by_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points

# Places and widths of lines are rounded to this part of the least width: the same lines then make
# the same polygons, and these the same mesh.
RESOLUTION = 1e-5


@dataclass(frozen=True, eq=False)
class Drawing:
    """Lines on the triangles that may carry them, before they become polygons.

    Attributes:
        mesh: These triangles.
        families: Lines of each family, with their widths.
        shares: Part of the area that the field asks of each family.
        planes: Symmetry planes at which the pattern is cut, as of `mirrored`.
        options: Widths and limits.
    """

    mesh: LineMesh
    families: list[Family]
    shares: Floats
    planes: tuple[int, ...]
    options: LineOptions


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
        under: Region of each panel under each family, by family and panel, before lines and gaps
            that are too thin are mended.
        drawing: What they were made of; None where nothing was laid.
    """

    pattern: Pattern
    regions: tuple[BaseGeometry, ...]
    centre_lines: tuple[tuple[CentreLine, ...], ...]
    families: tuple[LaidFamily, ...]
    layouts: Mapping[int, Layout]
    under: tuple[tuple[BaseGeometry, ...], ...]
    drawing: Drawing | None

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


def laid(drawing: Drawing, layouts: Mapping[int, Layout]) -> LaidLines:
    """Return the printable lines of a drawing.

    Args:
        drawing: Lines and widths.
        layouts: Where the stripes of families lie.
    """
    mesh, planes = drawing.mesh, drawing.planes
    strips = _strips(mesh, drawing.families, RESOLUTION * drawing.options.print_width)
    regions, under, shares = _regions(mesh, strips, planes, drawing.options)
    lines = tuple(
        tuple(replace(line, cell=mesh.cells[line.cell]) for line in family.lines)
        for family in drawing.families
    )
    report = tuple(
        LaidFamily(
            family.width,
            len(own),
            sum(line.length for line in own),
            float(asked),
            float(share),
            _ends(own),
        )
        for family, own, asked, share in zip(
            drawing.families, lines, drawing.shares, shares, strict=True
        )
    )
    return LaidLines(mesh.pattern, regions, lines, report, layouts, under, drawing)


def widened(lines: LaidLines, factors: Floats) -> LaidLines:
    """Return the same lines with other widths, within the bounds of the options and the spacing.

    Args:
        lines: Lines that were laid.
        factors: Factor on the width of each family at each vertex of `lines.drawing.mesh`, (K, n),
            positive.

    Raises:
        ParameterError: The factors do not fit, or there are no lines.
    """
    drawing = lines.drawing
    if drawing is None:
        raise ParameterError("there are no lines whose widths could be changed.")
    shape = len(drawing.families), drawing.mesh.size
    if factors.shape != shape or not np.all(np.isfinite(factors) & (factors > 0)):
        raise ParameterError(
            f"factors has shape {factors.shape}; it must hold positive numbers of shape {shape}, "
            "one for each family and vertex."
        )
    families = [
        replace(family, radius=np.clip(factor * family.radius, *family.bounds))
        for family, factor in zip(drawing.families, factors, strict=True)
    ]
    return laid(replace(drawing, families=families), lines.layouts)


def _ends(lines: Sequence[CentreLine]) -> dict[str, int]:
    """Return how many ends lie at what."""
    return dict(sorted(Counter(end for line in lines for end in line.ends or ()).items()))


def _strips(mesh: LineMesh, families: list[Family], unit: float) -> list[list[Strip]]:
    """Return the strips of the lines of each family, their places and widths rounded to a unit.

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
        places = rounded(line.points, unit), rounded(radii, unit)
        strips[number].append(Strip(panel[line.cell], *places, beyond))
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
    mesh: LineMesh,
    strips: list[list[Strip]],
    planes: tuple[int, ...],
    options: LineOptions,
) -> tuple[tuple[BaseGeometry, ...], tuple[tuple[BaseGeometry, ...], ...], Floats]:
    """Return the printed region of each panel, that under each family, and its part of the area."""
    pattern = mesh.pattern
    joints = joints_of(pattern, planes)
    free = np.zeros(len(pattern.panel), dtype=bool)
    free[mesh.cells] = True
    regions: list[BaseGeometry] = []
    under: list[list[BaseGeometry]] = [[] for _ in strips]
    for panel in range(len(pattern.panel_names)):
        here = pattern.panel == panel
        before = shapely.coverage_union_all(shapely.polygons(pattern.corners[here & ~free]))
        if not np.any(here & free):
            regions.append(before)
            for own in under:
                own.append(shapely.Polygon())
            continue
        bare = shapely.coverage_union_all(shapely.polygons(pattern.corners[here & free]))
        shapely.prepare(bare)
        unions = [
            shapely.union_all(ribbons(family, panel, joints, options.print_width))
            for family in strips
        ]
        for own, union in zip(under, unions, strict=True):
            own.append(union.intersection(bare))
        region = cleaned(shapely.union_all(unions), options.print_width, options.hole_area)
        regions.append(shapely.union_all([region.intersection(bare), before]))
    shares = np.array([sum(region.area for region in own) for own in under]) / mesh.areas.sum()
    return tuple(regions), tuple(tuple(own) for own in under), shares


def _covered(region: BaseGeometry, corners: Floats) -> Floats:
    """Return the part of triangles (t, 3, 2) that a region covers, (t,)."""
    triangle, parts = cut_by_triangles(region, corners)
    area = np.bincount(triangle, shapely.area(parts), minlength=len(corners))
    return np.clip(area / shapely.area(shapely.polygons(corners)), 0.0, 1.0)
