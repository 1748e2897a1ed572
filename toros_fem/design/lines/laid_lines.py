"""Lines with their widths, and the printed regions that they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.rounding import rounded
from toros_fem.design.lines.centre_lines import BORDER, LINE, PRINTED, CentreLine, LinesOfFamily
from toros_fem.design.lines.ends import touches
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.lines.line_mesh import Complexes, LineMesh, coordinates
from toros_fem.design.lines.ribbons import Joint, cleaned, joints_of, kept_width, ribbons
from toros_fem.design.lines.stripes import Stripes
from toros_fem.meshes.panels import cut_by_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points
from toros_fem.meshes.triangles import gradients

# Places and widths of lines are rounded to this part of the least width: the same lines then make
# the same polygons, and these the same mesh.
RESOLUTION = 1e-5


@dataclass(frozen=True, eq=False)
class LineChange:
    """A change of lines that were laid.

    Attributes:
        widths: Logarithm of the factor on the width of each family at each vertex of the lines'
            mesh, (K, n).
        warp: Way of the lines there in m, (n,), x + iy in the chart of each vertex's first corner.
    """

    widths: Floats
    warp: Complexes

    def scaled(self, factor: float) -> LineChange:
        """Return a multiple of the change."""
        return LineChange(factor * self.widths, factor * self.warp)


@dataclass(frozen=True, eq=False)
class LaidLines:
    """Printable lines on the panels of a pattern.

    Attributes:
        mesh: Triangles that may carry lines, none where all is printed.
        families: Lines of each family, with their widths.
        stripes: Those of families on the whole skin, by the number of the family; those of mirror
            images are left out.
        planes: Symmetry planes at which the pattern is cut, as of `mirrored`.
        options: Widths and limits.
        warp: Way in m by which all lines have moved since, (n,), as of `LineChange`.
        regions: Printed region of each panel, polygons in its chart, in m.
    """

    mesh: LineMesh
    families: tuple[LinesOfFamily, ...]
    stripes: Mapping[int, Stripes]
    planes: tuple[int, ...]
    options: LineOptions
    warp: Complexes
    regions: tuple[BaseGeometry, ...] = ()

    @property
    def pattern(self) -> Pattern:
        """The pattern that they were laid on: that of the field, refined."""
        return self.mesh.pattern

    @property
    def area(self) -> float:
        """Printed area in m²."""
        return float(sum(region.area for region in self.regions))

    def cover(self, pattern: Pattern) -> Floats:
        """Return the part of each triangle that is printed, (t,), by exact areas.

        The pattern has the same panels, on any mesh; a PanelError says that they are others.
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


def with_regions(lines: LaidLines) -> LaidLines:
    """Return lines with the regions that they make."""
    pattern, options = lines.pattern, lines.options
    joints = joints_of(pattern, lines.planes)
    unions = [_ribbons(lines, family, joints) for family in lines.families]
    free = np.isin(np.arange(len(pattern.panel)), lines.mesh.cells)
    regions, under = [], []
    for panel, own in enumerate(zip(*unions, strict=True)):
        before, bare = (
            shapely.coverage_union_all(shapely.polygons(pattern.corners[cells]))
            for cells in ((pattern.panel == panel) & ~free, (pattern.panel == panel) & free)
        )
        under.append([union.intersection(bare) for union in own])
        region = cleaned(shapely.union_all(own), options.print_width, options.hole_area)
        regions.append(shapely.union_all([region.intersection(bare), before]))
    area = max(pattern.areas[free].sum(), np.finfo(float).tiny)
    families = tuple(
        replace(family, under=own, laid=float(sum(region.area for region in own) / area))
        for family, own in zip(lines.families, zip(*under, strict=True), strict=True)
    )
    return replace(lines, families=families, regions=tuple(regions))


def changed(lines: LaidLines, change: LineChange, *, draw: bool = True) -> LaidLines:
    """Return lines with other widths, and moved, within the bounds of the options and the spacing.

    Centre lines move, and are drawn anew with their widths. Where the warp brings lines nearer to
    each other their widths leave room for the gap. Without `draw` there are no regions.

    Raises:
        ParameterError: There are no lines.
    """
    if not lines.mesh.size:
        raise ParameterError("there are no lines that could be changed.")
    warp = lines.warp + change.warp
    strain = _strain(lines.mesh, warp)
    families = []
    for family, own in zip(lines.families, change.widths, strict=True):
        least, most = family.bounds
        # Where the gap bounds the width, it tells the spacing.
        gap, wide = kept_width(lines.options.print_width), lines.options.spread * family.width / 2
        bounded = most < (1 - RESOLUTION) * wide
        spacing = np.maximum(2 * most + gap, np.where(bounded, 0.0, family.spacing))
        nearer = (spacing * (1 + _across(lines.mesh, strain, family.angles)) - gap) / 2
        most = np.maximum(least, np.minimum(most, nearer))
        radius = np.clip(np.exp(own) * family.radius, least, most)
        families.append(replace(family, radius=radius))
    found = replace(lines, families=tuple(families), warp=warp)
    return with_regions(found) if draw else replace(found, regions=())


def change_between(before: LaidLines, after: LaidLines) -> LineChange:
    """Return the change that leads from lines to others with the same centre lines."""
    pairs = zip(before.families, after.families, strict=True)
    widths = np.array([np.log(b.radius / a.radius) for a, b in pairs])
    return LineChange(widths, after.warp - before.warp)


def _strain(mesh: LineMesh, warp: Complexes) -> Floats:
    """Return the symmetric gradient of a warp in each triangle, (t, 2, 2)."""
    way = coordinates(warp[mesh.vertex] * np.exp(1j * mesh.turn))
    slope = np.einsum("tci,tcj->tij", way, gradients(mesh.corners))
    return np.asarray(slope + np.swapaxes(slope, 1, 2)) / 2


def _across(mesh: LineMesh, strain: Floats, angles: Floats) -> Floats:
    """Return the strain across lines with given directions at the corners, at vertices, (n,)."""
    angle = np.angle(np.exp(2j * angles).sum(axis=1)) / 2
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return mesh.at_vertices(np.einsum("ti,tij,tj->t", normal, strain, normal))


def _ribbons(lines: LaidLines, family: LinesOfFamily, joints: list[Joint]) -> list[BaseGeometry]:
    """Return the region of each panel under a family; places and widths are rounded."""
    mesh, least = lines.mesh, lines.options.print_width
    parts: list[tuple[Ints, Floats, Floats]] = [
        (np.empty(0, np.int64), np.empty((0, 2, 2)), np.empty((0, 2)))
    ]
    for line in family.lines:
        panel = mesh.pattern.panel[mesh.cells[line.cell]]
        points = rounded(_warped(lines, line), RESOLUTION * least)
        radii = rounded(_tapered(lines, family, line), RESOLUTION * least)
        parts.append((panel, points, radii))
        # Where the panel ends, the ribbon runs on straight.
        for side in (s for s, kind in enumerate(line.ends) if kind in (BORDER, PRINTED)):
            end, radius = points[-side, side], radii[-side, side]
            way = end - points[-side, 1 - side]
            beyond = end + way / max(np.hypot(*way), 1e-300) * (4 * radius + 2 * least)
            parts.append((panel[[-side]], np.array([[end, beyond]]), np.full((1, 2), radius)))
    panel, points, radii = (np.concatenate(part) for part in zip(*parts, strict=True))
    margin = radii.max(initial=0.0) + 3 * least
    margin += float(np.abs(lines.warp).max(initial=0.0))
    return ribbons(panel, points, radii, joints, margin, len(lines.pattern.panel_names))


def _warped(lines: LaidLines, line: CentreLine) -> Floats:
    """Return the points of a line where the warp has moved them, (m, 2, 2), in m."""
    mesh, warp = lines.mesh, lines.warp
    at = mesh.barycentric(line.cell[:, None], line.places)
    way = warp[mesh.vertex[line.cell]] * np.exp(1j * mesh.turn[line.cell])
    return coordinates(line.places + np.einsum("mkc,mc->mk", at, way))


def _tapered(lines: LaidLines, family: LinesOfFamily, line: CentreLine) -> Floats:
    """Return half the width at start and end of the segments of a line, (m, 2), in m.

    If it ends on a thinner line it tapers to its width, so that it does not stand out behind it.
    """
    mesh, radii = lines.mesh, _radii(lines.mesh, family, line.cell, line.places)
    for side in (s for s, kind in enumerate(line.ends) if kind == LINE):
        there = line if side == 1 else line.reversed
        away = np.stack([there.to_end, np.append(there.to_end[1:], 0.0)], axis=1)
        away = away if side == 1 else away[::-1, ::-1]
        for onto, other in ((f, other) for f in lines.families for other in f.lines):
            segments = other.places[other.cell == there.cell[-1]]
            if other is not line and touches(mesh, there, segments):
                bound = _radii(mesh, onto, there.cell[-1:], there.places[-1:, 1:])
                radii = np.minimum(radii, bound + away)
    return radii


def _radii(mesh: LineMesh, family: LinesOfFamily, cell: Ints, places: Complexes) -> Floats:
    """Return half the width of a family at the places (m, k) in triangles, (m, k), in m."""
    at = mesh.barycentric(cell[:, None], places)
    return np.asarray(np.einsum("mkc,mc->mk", at, family.radius[mesh.vertex[cell]]))
