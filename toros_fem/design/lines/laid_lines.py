"""Lines with their widths, the printed ribbons that they make, and smooth changes of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.sparse import block_array, coo_array, csc_array, diags_array, sparray
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import rounded
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.design.lines.centre_lines import (
    BORDER,
    LINE,
    PRINTED,
    CentreLine,
    LinesOfFamily,
    Stripes,
)
from toros_fem.design.lines.ends import touches
from toros_fem.design.lines.field import Complexes, LineMesh, LineOptions, coordinates
from toros_fem.meshes.panels import cut_by_triangles
from toros_fem.meshes.pattern import Pattern, plane_border
from toros_fem.meshes.transfer import scaled_points
from toros_fem.meshes.triangles import following, gradients, half_edges, linked, spd_factor

# Corners of a round end.
AROUND = 32
# Relative excess of the radii of opening and closing, since round corners are polygons.
EXCESS = 0.015
# Polygons are simplified by at most this fraction of the print width.
SIMPLER = 0.004
# Places and widths of lines are rounded to this part of the least width: the same lines then make
# the same polygons, and these the same mesh.
RESOLUTION = 1e-5
# Shift of the eigenvalue problems, over the inverse area of the mesh: a Laplacian may be singular.
SHIFT = -0.1


def capsules(points: Floats, radii: Floats) -> np.ndarray:
    """Return polygons around segments (m, 2, 2) with round ends of given radii (m, 2), (m,)."""
    way = points[:, 1] - points[:, 0]
    length = np.hypot(*way.T)[:, None]
    way = np.divide(way, length, out=np.tile([1.0, 0.0], (len(way), 1)), where=length > 0)
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)[:, None]
    angle = np.linspace(0, np.pi, AROUND // 2 + 1)[:, None]
    around = left * np.cos(angle) - way[:, None] * np.sin(angle)  # from the left to the right
    middles, radius = points[:, :, None], radii[:, :, None, None]
    ends = middles + radius * np.stack([around, -around], axis=1)
    return np.asarray(shapely.polygons(ends.reshape(-1, AROUND + 2, 2)))


@dataclass(frozen=True, eq=False)
class Joint:
    """A border of a panel across which the skin goes on: a seam, or a cut in a symmetry plane.

    Attributes:
        panel: Panel that gets a margin.
        source: Panel whose flat chart is moved to the other's.
        edges: Edges of the source along the border, (k, 2, 2), in m.
        turn: Orthogonal matrix of the motion, (k, 2, 2).
        shift: Translation of the motion, (k, 2), in m.
    """

    panel: int
    source: int
    edges: Floats
    turn: Floats
    shift: Floats

    def across(self, segments: Floats, margin: float) -> tuple[Ints, Floats]:
        """Return which segments (m, 2, 2) of the source are nearer than a margin, and them moved.

        The edge next to a segment's middle moves it.
        """
        tree = shapely.STRtree(shapely.linestrings(self.edges))
        near = tree.query(shapely.linestrings(segments), predicate="dwithin", distance=margin)[0]
        near = np.unique(near)
        middle = shapely.points(segments[near].mean(axis=1))
        edge = tree.query_nearest(middle, all_matches=False)[1]
        moved = np.einsum("kij,kej->kei", self.turn[edge], segments[near])
        return near, moved + self.shift[edge, None]


def joints_of(pattern: Pattern, planes: tuple[int, ...]) -> list[Joint]:
    """Return the connected borders of all panels at seams, and at planes, as of `mirrored`."""
    flat = half_edges(pattern.flat_triangles)
    inner = pattern.edges.twins[pattern.edges.inner]
    sewn = inner[np.any(flat[inner[:, 0]] != flat[inner[:, 1]][:, ::-1], axis=1)]
    cut = np.concatenate([np.empty(0, np.int64), *(plane_border(pattern, k) for k in planes)])
    here = np.concatenate([*sewn.T, cut])
    there = np.concatenate([*sewn.T[::-1], cut])
    sign = np.where(np.arange(len(here)) < 2 * len(sewn), 1.0, -1.0)
    target, source = pattern.flat_points[flat[here]], pattern.flat_points[flat[there]]
    source[sign > 0] = source[sign > 0][:, ::-1]
    # Turned to the target, or mirrored in its line.
    a, b = (np.arctan2(*(ends[:, 1] - ends[:, 0]).T[::-1]) for ends in (source, target))
    angle = b - sign * a
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([c, -sign * s, s, sign * c], axis=1).reshape(-1, 2, 2)
    shift = target.mean(axis=1) - np.einsum("kij,kj->ki", turn, source.mean(axis=1))
    # Connected edges of the source that lead to the same panel.
    size = len(pattern.flat_points)
    panel, other = pattern.panel[here // 3], pattern.panel[there // 3]
    joints = []
    for one, two in np.unique(np.stack([panel, other], axis=1), axis=0):
        part = np.flatnonzero((panel == one) & (other == two))
        begin, end = flat[there[part]].T
        chain = linked(begin, end, size)[begin]
        joints += [
            Joint(int(one), int(two), source[k], turn[k], shift[k])
            for k in (part[chain == number] for number in np.unique(chain))
        ]
    return joints


def straight_joints(pattern: Pattern) -> list[Joint]:
    """Return the seams at which one rigid motion leads from a flat chart to the other."""
    near = 1e-6 * pattern.size
    return [
        joint
        for joint in joints_of(pattern, ())
        if np.ptp(joint.turn, axis=0).max() < 1e-6 and np.ptp(joint.shift, axis=0).max() < near
    ]


def ribbons(
    panel: Ints, points: Floats, radii: Floats, joints: list[Joint], margin: float, panels: int
) -> list[BaseGeometry]:
    """Return the region of each panel, and of a margin in m around it, under lines with a width.

    They are segments (m, 2, 2) in the charts of their panels (m,), with half the width at start
    and end, (m, 2), in m.
    """
    parts = [(panel, points, radii)]
    for joint in joints:
        there = np.flatnonzero(panel == joint.source)
        near, moved = joint.across(points[there], margin)
        parts.append((np.full(len(near), joint.panel), moved, radii[there[near]]))
    panel, points, radii = (np.concatenate(part) for part in zip(*parts, strict=True))
    capsule = capsules(points, radii)
    return [shapely.union_all(capsule[panel == k]) for k in range(panels)]


def kept_width(print_width: float) -> float:
    """Return the least width in m of lines and gaps that `cleaned` keeps."""
    return (1 + 2 * EXCESS) * print_width


def cleaned(region: BaseGeometry, print_width: float, hole_area: float) -> BaseGeometry:
    """Return a region without lines and gaps, in m, holes and pieces, in m², that are too small."""
    radius = (1 + EXCESS) * print_width / 2
    for distance in (radius, -radius, -radius, radius):
        region = region.buffer(distance, quad_segs=8)
    kept = [
        shapely.Polygon(
            part.exterior, [r for r in part.interiors if shapely.Polygon(r).area >= hole_area]
        )
        for part in shapely.get_parts(region)
        if part.area >= hole_area
    ]
    return shapely.union_all(kept).simplify(SIMPLER * print_width, preserve_topology=False)


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


@dataclass(frozen=True, eq=False)
class SmoothChanges:
    """A basis of smooth changes: widths of each family by each function, and warps by each field.

    Attributes:
        families: Number K of families.
        functions: Functions at the vertices of the lines' mesh, (n, m), of mean square 1.
        fields: Tangent vectors there, (n, w), in the chart of each vertex's first corner, of mean
            square 1.
        units: Logarithm of a factor on the width, and warp in m, that an amount of 1 stands for.
    """

    families: int
    functions: Floats
    fields: Complexes
    units: tuple[float, float]

    @property
    def size(self) -> int:
        """Number of changes."""
        return self.families * self.functions.shape[1] + self.fields.shape[1]

    def change(self, amounts: Floats) -> LineChange:
        """Return the change of these amounts, those of widths first, family by family."""
        split = self.families * self.functions.shape[1]
        widths, warp = amounts[:split], amounts[split:]
        return LineChange(
            self.units[0] * (widths.reshape(self.families, -1) @ self.functions.T),
            self.units[1] * (self.fields @ warp),
        )

    def each(self) -> Iterator[LineChange]:
        """Yield the changes one by one."""
        return map(self.change, np.eye(self.size))


@dataclass(frozen=True, eq=False)
class PrintBorders:
    """Borders of the print of lines on its mesh, and how they follow the lines.

    Attributes:
        lines: The lines.
        normals: Way of the flat points where the borders move outwards by 1, (k, 2), as of
            `border_motion`.
        under: Whether a flat point is at the border of each family, (K, k).
        near: Weights of the corners of the lines' mesh at the flat points, (k, 3).
        cell: Triangle of the lines' mesh at the flat points, (k,).
    """

    lines: LaidLines
    normals: Floats
    under: Bools
    near: Floats
    cell: Ints

    def moves(self, change: LineChange) -> Floats:
        """Return the way of the flat points with the borders, (k, 2), in m."""
        mesh = self.lines.mesh
        vertex = mesh.vertex[self.cell]
        out: Floats = np.zeros(len(self.cell))
        for family, widths, own in zip(self.lines.families, change.widths, self.under, strict=True):
            out += own * (self.near * (family.radius * widths)[vertex]).sum(axis=1)
        turned = change.warp[vertex] * np.exp(1j * mesh.turn[self.cell])
        warp = coordinates((self.near * turned).sum(axis=1))
        at_border = np.any(self.normals != 0, axis=1)
        return out[:, None] * self.normals + at_border[:, None] * warp


def print_borders(
    lines: LaidLines,
    pattern: Pattern,
    under: Sequence[Sequence[BaseGeometry]],
    printed: Bools,
    normals: Floats,
) -> PrintBorders:
    """Return the borders of the print of lines on a pattern with the same panels.

    `under` are the regions under each family on each panel of it, in m. Its triangles are printed
    or not, (t,), and the normals are those of `border_motion`.
    """
    mesh, source = lines.mesh, lines.pattern
    flat = scaled_points(source, pattern)
    middles, centroids = mesh.corners.mean(axis=1), pattern.corners.mean(axis=1)
    cell: Ints = np.zeros(len(flat), dtype=np.int64)
    near: Floats = np.zeros((len(flat), 3))
    at: Bools = np.zeros((len(under), len(flat)), dtype=bool)
    for panel, name in enumerate(pattern.panel_names):
        there = np.flatnonzero(source.panel[mesh.cells] == source.panel_index(name))
        here = np.flatnonzero(pattern.panel_of_point == panel)
        if not len(there):
            continue
        cell[here] = there[cKDTree(middles[there]).query(flat[here])[1]]
        places = flat[here, 0] + 1j * flat[here, 1]
        weights = np.clip(mesh.barycentric(cell[here], places), 0, None)
        near[here] = weights / weights.sum(axis=1, keepdims=True)
        inside = pattern.cells_of(name)
        inside = inside[printed[inside]]
        for family, regions in enumerate(under):
            shapely.prepare(regions[panel])
            own = inside[shapely.contains_xy(regions[panel], *centroids[inside].T)]
            at[family, pattern.flat_triangles[own]] = True
    return PrintBorders(lines, normals, at, near, cell)


def smooth_functions(mesh: LineMesh, number: int) -> Floats:
    """Return the first eigenfunctions of the Laplacian at vertices, (n, number), of mean square 1.

    On a small mesh there are fewer.
    """
    return _smoothest(mesh.laplacian(mesh.weights), mesh.vertex_areas, number)


def smooth_fields(mesh: LineMesh, number: int, planes: Sequence[int]) -> Complexes:
    """Return the smoothest tangent fields at vertices, (n, number), of mean square 1.

    They are eigenfields of the connection's Laplacian, so that they go on across seams. They are 0
    at the border of the mesh, where lines end, and along the border in symmetry planes, at which
    the pattern is cut, as of `mirrored`. On a small mesh there are fewer.
    """
    size, inner = mesh.size, np.ones(mesh.size, dtype=bool)
    inner[mesh.edges.ends[mesh.edges.border]] = False
    along = _along_planes(mesh, planes)
    sliding = np.flatnonzero(along)
    free = np.flatnonzero(inner)
    rows = np.concatenate([free, free + size, sliding, sliding + size])
    width = 2 * len(free) + len(sliding)
    columns = np.concatenate([np.arange(2 * len(free)), *2 * [np.arange(2 * len(free), width)]])
    entries = np.concatenate([np.ones(2 * len(free)), along[sliding].real, along[sliding].imag])
    made = csc_array(coo_array((entries, (rows, columns)), shape=(2 * size, width)))
    bent = mesh.laplacian(mesh.weights, np.exp(1j * mesh.edge_angles))
    both = csc_array(block_array([[bent.real, -bent.imag], [bent.imag, bent.real]]))
    areas = (made * made).T @ np.tile(mesh.vertex_areas, 2)
    found = made @ _smoothest(csc_array(made.T @ both @ made), areas, number)
    scale = np.sqrt(mesh.vertex_areas.sum() / areas.sum())
    return np.asarray(scale * (found[:size] + 1j * found[size:]))


def _smoothest(matrix: sparray, areas: Floats, number: int) -> Floats:
    """Return the lowest eigenvectors of a Laplacian, (n, number), of mean square 1."""
    size, area = len(areas), float(areas.sum())
    start = np.random.default_rng(0).uniform(0.5, 1.5, size)  # any: results are repeatable
    mass, shift = csc_array(diags_array(areas)), SHIFT / area
    factor = spd_factor(csc_array(matrix - shift * mass))
    inverse = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    _, found = eigsh(
        csc_array(matrix), min(number, size - 2), M=mass, sigma=shift, v0=start, OPinv=inverse
    )
    return np.asarray(found * np.sqrt(area))


def _along_planes(mesh: LineMesh, planes: Sequence[int]) -> Complexes:
    """Return unit vectors along the border at vertices in one plane only, (n,); 0 elsewhere."""
    inside: Bools = np.zeros(len(mesh.border), dtype=bool)
    for axis in planes:
        inside |= np.isin(mesh.border, plane_border(mesh.pattern, axis))
    border = mesh.edges.twins[mesh.edges.border, 0]
    total: Complexes = np.zeros(mesh.size, dtype=np.complex128)
    elsewhere: Bools = np.zeros(mesh.size, dtype=bool)
    for corner in (border, following(border)):
        vertex = mesh.vertex.ravel()[corner]
        way = mesh.sides.ravel()[border] * np.exp(-1j * mesh.turn.ravel()[corner])
        np.add.at(total, vertex[inside], way[inside])
        elsewhere[vertex[~inside]] = True
    size = np.abs(total)
    return np.where(elsewhere | (size == 0), 0.0, total / np.where(size == 0, 1.0, size))
