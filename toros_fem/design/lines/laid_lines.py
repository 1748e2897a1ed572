"""Lines with their widths, and the printed regions that they make."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.rounding import rounded
from toros_fem.design.lines.centre_lines import BORDER, LINE, PRINTED, CentreLine, Family
from toros_fem.design.lines.ends import touches
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.lines.line_mesh import Complexes, LineMesh
from toros_fem.design.lines.ribbons import Ribbons, cleaned, joints_of
from toros_fem.design.lines.stripes import Stripes
from toros_fem.meshes.cut_triangles import cut_by_triangles
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
        stripes: Those of families on the whole, by the number of the family; those of mirror
            images are left out.
        planes: Symmetry planes at which the pattern is cut, as of `mirrored`.
        options: Widths and limits.
    """

    mesh: LineMesh
    families: list[Family]
    shares: Floats
    stripes: Mapping[int, Stripes]
    planes: tuple[int, ...]
    options: LineOptions


@dataclass(frozen=True, eq=False)
class LaidFamily:
    """What became of one family of lines.

    Attributes:
        width: Width asked, in m.
        share: Part of the area, without that printed before, that the field asks for.
        laid: Part of it that the family covers.
        centre_lines: Its centre lines, through triangles of the lines' pattern.
        under: Region of each panel under it, before lines and gaps that are too thin are mended.
    """

    width: float
    share: float = 0.0
    laid: float = 0.0
    centre_lines: tuple[CentreLine, ...] = ()
    under: tuple[BaseGeometry, ...] = ()

    @property
    def lines(self) -> int:
        """Number of lines."""
        return len(self.centre_lines)

    @property
    def length(self) -> float:
        """Total length of the lines in m."""
        return float(sum(line.length for line in self.centre_lines))

    @property
    def ends(self) -> dict[str, int]:
        """How many ends lie at what."""
        return dict(sorted(Counter(k for line in self.centre_lines for k in line.ends).items()))


@dataclass(frozen=True, eq=False)
class LaidLines:
    """Printable lines on the panels of a pattern.

    Attributes:
        pattern: The pattern that they were laid on: that of the field, refined.
        regions: Printed region of each panel, polygons in its chart, in m.
        families: What became of each family.
        drawing: What the lines were made of; None where nothing was laid.
    """

    pattern: Pattern
    regions: tuple[BaseGeometry, ...]
    families: tuple[LaidFamily, ...]
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
        corners = scaled_points(self.pattern, pattern)[pattern.flat_triangles]
        covered = np.zeros(len(pattern.panel))
        for name in pattern.panel_names:
            cells = pattern.cells_of(name)
            region = self.regions[self.pattern.panel_index(name)]
            triangle, parts = cut_by_triangles(region, corners[cells])
            area = np.bincount(triangle, shapely.area(parts), minlength=len(cells))
            covered[cells] = area / shapely.area(shapely.polygons(corners[cells]))
        return np.clip(covered, 0.0, 1.0)


def laid(drawing: Drawing) -> LaidLines:
    """Return the printable lines of a drawing."""
    mesh, options, pattern = drawing.mesh, drawing.options, drawing.mesh.pattern
    ribbons, joints = _ribbons(drawing), joints_of(pattern, drawing.planes)
    free = np.isin(np.arange(len(pattern.panel)), mesh.cells)
    regions: list[BaseGeometry] = []
    under: list[list[BaseGeometry]] = []
    for panel in range(len(pattern.panel_names)):
        here = pattern.panel == panel
        before, bare = (
            shapely.coverage_union_all(shapely.polygons(pattern.corners[cells]))
            for cells in (here & ~free, here & free)
        )
        unions = [each.on(panel, joints, options.print_width) for each in ribbons]
        under.append([union.intersection(bare) for union in unions])
        region = cleaned(shapely.union_all(unions), options.print_width, options.hole_area)
        regions.append(shapely.union_all([region.intersection(bare), before]))
    families = tuple(
        LaidFamily(
            family.width,
            float(asked),
            sum(region.area for region in own) / float(mesh.areas.sum()),
            tuple(replace(line, cell=mesh.cells[line.cell]) for line in family.lines),
            own,
        )
        for family, asked, own in zip(
            drawing.families, drawing.shares, zip(*under, strict=True), strict=True
        )
    )
    return LaidLines(pattern, tuple(regions), families, drawing)


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
    return laid(replace(drawing, families=families))


def _ribbons(drawing: Drawing) -> list[Ribbons]:
    """Return the ribbons of each family, their places and widths rounded."""
    mesh, least = drawing.mesh, drawing.options.print_width
    unit, panel = RESOLUTION * least, mesh.pattern.panel[mesh.cells]
    found = []
    for family in drawing.families:
        parts: list[tuple[Ints, Floats, Floats]] = [
            (np.empty(0, np.int64), np.empty((0, 2, 2)), np.empty((0, 2)))
        ]
        for line in family.lines:
            points = rounded(line.points, unit)
            radii = rounded(_tapered(drawing, family, line), unit)
            parts.append((panel[line.cell], points, radii))
            # Where the panel ends, the ribbon runs on straight.
            for side in (s for s, kind in enumerate(line.ends) if kind in (BORDER, PRINTED)):
                end, radius = points[-side, side], radii[-side, side]
                way = end - points[-side, 1 - side]
                beyond = end + way / max(np.hypot(*way), 1e-300) * (4 * radius + 2 * least)
                ends = np.array([[end, beyond]])
                parts.append((panel[line.cell[[-side]]], ends, np.full((1, 2), radius)))
        found.append(Ribbons(*(np.concatenate(part) for part in zip(*parts, strict=True))))
    return found


def _tapered(drawing: Drawing, family: Family, line: CentreLine) -> Floats:
    """Return half the width at start and end of the segments of a line, (m, 2), in m.

    If it ends on a thinner line it tapers to its width, so that it does not stand out behind it.
    """
    mesh = drawing.mesh
    radii = _radii(mesh, family, line.cell, line.places)
    for side in (s for s, kind in enumerate(line.ends) if kind == LINE):
        there = line if side == 1 else line.reversed
        away = np.stack([there.to_end, np.append(there.to_end[1:], 0.0)], axis=1)
        away = away if side == 1 else away[::-1, ::-1]
        for onto, other in ((f, other) for f in drawing.families for other in f.lines):
            here = other.places[other.cell == there.cell[-1]]
            if other is not line and touches(mesh, there, here):
                bound = _radii(mesh, onto, there.cell[-1:], there.places[-1:, 1:])
                radii = np.minimum(radii, bound + away)
    return radii


def _radii(mesh: LineMesh, family: Family, cell: Ints, places: Complexes) -> Floats:
    """Return half the width of a family at the places (m, k) in triangles, (m, k), in m."""
    at = mesh.coordinates(cell[:, None], places)
    return np.asarray(np.einsum("mkc,mc->mk", at, family.radius[mesh.vertex[cell]]))
