"""Printability of a pattern: pieces, islands, holes, widths; a print as a file, on other meshes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError
from toros_fem.base.files import Archive, read_archive, write_archive
from toros_fem.base.keys import Area, Length, Table, key
from toros_fem.base.mpi import on_first_rank, on_root
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.design.lines.laid_lines import straight_joints
from toros_fem.design.loop.case import Case
from toros_fem.making.contours import Widths, measure_widths
from toros_fem.meshes.files import archive_of, pattern_of
from toros_fem.meshes.panels import Affine, cut_by_triangles, polygons_of
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import scaled_points
from toros_fem.meshes.triangles import linked

PRINT, KIND = "print.npz", "print"
# Number of points on each pair of sewn edges where the print on both sides is looked up.
SEAM_POINTS = 32
# Borders closer than this fraction of the skin's size are the same.
TOUCHING = 1e-7
# Pieces whose areas differ by a smaller part are images of each other.
SAME_AREA = 1e-3
# Number of samples in the smaller limit.
SAMPLES_PER_LIMIT = 20
# Farthest that a border may move where corners are left out, in m, and over the smaller limit: by
# so much lines and gaps of a cleaned print are wider than their limit.
SIMPLIFIED, SPARE = 2e-6, 0.005
# Print beyond a seam that is seen with a panel, over the least width and the smoothing length.
BEYOND = 8.0
# What closes slits of rounding, over the width of a strip.
SLIT = 1e-7
REGIONS = ("region_bytes", "region_sizes")


@dataclass(frozen=True, eq=False)
class PanelRegion:
    """A polygon in m on a panel, given by its number: a connected piece of print, or a hole in it.

    Attributes:
        main: Whether it is a main body, the largest piece of its panel. In a symmetric print there
            are several, the images of one. The others are islands.
        attached: Whether it is a main body, or is connected to one across seams. An island that is
            not attached is free.
    """

    panel: int
    polygon: BaseGeometry
    main: bool = False
    attached: bool = False

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(self.polygon.area)


def find_pieces(pattern: Pattern, regions: Regions, contact: float = 0.0) -> list[PanelRegion]:
    """Return the printed pieces of all panels, the largest first.

    They are connected where they meet at seams along a length in m, the contact.
    """
    parts, panel = shapely.get_parts(list(regions), return_index=True)
    order = np.argsort(-shapely.area(parts), kind="stable")
    order = order[~shapely.is_empty(parts[order])]
    parts, panel = parts[order], panel[order]
    largest = np.zeros(len(regions))
    np.maximum.at(largest, panel, shapely.area(parts))
    main = shapely.area(parts) > (1 - SAME_AREA) * largest[panel]
    links = _across_seams(pattern, parts, panel, contact)
    body = linked(links[:, 0], links[:, 1], len(parts)) if len(parts) else panel
    attached = np.isin(body, body[main])
    return [
        PanelRegion(int(p), part, bool(m), bool(a))
        for p, part, m, a in zip(panel, parts, main, attached, strict=True)
    ]


def find_holes(pattern: Pattern, regions: Regions) -> tuple[PanelRegion, ...]:
    """Return the fabric that print encloses, islands in it included, the smallest hole first.

    Cut-outs of the panel are no holes.
    """
    holes = []
    for panel, region in enumerate(regions):
        border = pattern.outline(panel).boundary
        shapely.prepare(border)
        rings = [ring for part in shapely.get_parts(region) for ring in part.interiors]
        cut = shapely.dwithin(border, rings, TOUCHING * pattern.size)
        holes += [
            PanelRegion(panel, shapely.Polygon(ring))
            for ring, at_cut in zip(rings, cut, strict=True)
            if not at_cut
        ]
    return tuple(sorted(holes, key=lambda hole: hole.area))


def _across_seams(
    pattern: Pattern, parts: npt.NDArray[np.object_], panel: Ints, contact: float
) -> Ints:
    """Return pairs of parts, (k, 2), that meet over a length where edges are sewn together."""
    fraction = (np.arange(SEAM_POINTS) + 0.5)[:, None] / SEAM_POINTS
    sides = []
    for edge in np.moveaxis(pattern.seams, 1, 0):
        start, end = np.moveaxis(pattern.flat_points[edge], 1, 0)[:, :, None]
        points = shapely.points((1 - fraction) * start + fraction * end).ravel()
        near = TOUCHING * pattern.size
        part, at = shapely.STRtree(points).query(parts, predicate="dwithin", distance=near)
        own = panel[part] == np.repeat(pattern.panel_of_point[edge[:, 0]], SEAM_POINTS)[at]
        found = np.full(len(points), -1)
        found[at[own]] = part[own]
        sides.append(found)
    pairs = np.sort(np.stack(sides, axis=1), axis=1)
    met = pairs[:, 0] >= 0
    edge = pattern.flat_points[pattern.seams[:, 0]]
    step = np.repeat(np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1) / SEAM_POINTS, SEAM_POINTS)
    found, which = np.unique(pairs[met], axis=0, return_inverse=True)
    return found[np.bincount(which.ravel(), step[met], minlength=len(found)) >= contact]


class PrintLimits(Table):
    """Limits of the printer and the fabric."""

    width: Length = key(0.6e-3, "width of the thinnest printable line")
    gap: Length = key(0.6e-3, "width of the thinnest gap that stays open")
    hole_area: Area = key(0.5e-6, "area of the smallest hole that stays open")

    @property
    def contact(self) -> float:
        """Length in m along which pieces must meet at a seam to be connected."""
        return self.width / 2

    @property
    def resolution(self) -> float:
        """Distance in m of the samples by which widths and gaps are measured."""
        return min(self.width, self.gap) / SAMPLES_PER_LIMIT

    @property
    def simplified(self) -> float:
        """Farthest that a border may move where corners are left out, in m."""
        return min(SIMPLIFIED, SPARE * min(self.width, self.gap))


DEFAULT_LIMITS = PrintLimits()


@dataclass(frozen=True, eq=False)
class Printability:
    """Measured printability of a pattern.

    Attributes:
        pieces: All printed pieces, the largest first.
        holes: Holes, the smallest first.
        lines, gaps: Widths of lines, and of the gaps between them.
        border_length: Length of the border of the print in m, without the cut edge of the panel.
    """

    pieces: tuple[PanelRegion, ...]
    holes: tuple[PanelRegion, ...]
    lines: Widths
    gaps: Widths
    border_length: float

    @property
    def islands(self) -> tuple[PanelRegion, ...]:
        """All pieces but the largest one of each panel."""
        return tuple(piece for piece in self.pieces if not piece.main)

    @property
    def free_islands(self) -> tuple[PanelRegion, ...]:
        """Islands that are not connected to a main body, not even across seams."""
        return tuple(island for island in self.islands if not island.attached)

    def summary(self) -> dict[str, Any]:
        """Return all results as plain numbers; each key ends in its unit."""
        thinnest = {
            f"smallest_{name}_{what}": found
            for name, place in (("width", self.lines.smallest), ("gap", self.gaps.smallest))
            for what, found in (
                ("mm", place and 1e3 * place.width),
                ("panel", place and place.panel),
                ("ends_mm", place and (1e3 * place.ends).tolist()),
            )
        }
        return {
            "pieces": len(self.pieces),
            "islands": len(self.free_islands),
            "island_areas_mm2": [1e6 * island.area for island in self.free_islands],
            "islands_attached_by_seam": len(self.islands) - len(self.free_islands),
            "holes": len(self.holes),
            "smallest_hole_mm2": 1e6 * self.holes[0].area if self.holes else None,
            "border_mm": 1e3 * self.border_length,
            **thinnest,
            "narrow_places": len(self.lines.narrow),
            "tight_places": len(self.gaps.narrow),
        }


def printability(
    pattern: Pattern, regions: Regions, limits: PrintLimits = DEFAULT_LIMITS
) -> Printability:
    """Measure the printability of a pattern; lines and gaps narrower than the limits are listed."""
    outlines = pattern.outlines
    # Lines and gaps go on across straight seams.
    longer = beyond_seams(pattern, regions, BEYOND * max(limits.width, limits.gap))
    widths = [
        measure_widths(*both, panel, limits.width, limits.gap, limits.resolution, outlines[panel])
        for panel, both in enumerate(zip(*longer, strict=True))
    ]
    lines, gaps = map(Widths.joined, zip(*widths, strict=True))
    return Printability(
        pieces=tuple(find_pieces(pattern, regions, limits.contact)),
        holes=find_holes(pattern, regions),
        lines=lines,
        gaps=gaps,
        border_length=sum(map(_inner_border, regions, outlines)),
    )


def _inner_border(region: BaseGeometry, outline: BaseGeometry) -> float:
    """Return the length in m of a region's border, without the border of the panel."""
    if region.is_empty:
        return 0.0
    size = np.hypot(*np.ptp(np.reshape(outline.bounds, (2, 2)), axis=0))
    return float(region.boundary.difference(outline.boundary.buffer(1e-7 * size)).length)


def printed_cells(pattern: Pattern, regions: Regions) -> Bools:
    """Return whether each triangle is printed, (t,): whether its centroid is."""
    printed = np.zeros(len(pattern.panel), dtype=bool)
    for panel, region in enumerate(regions):
        shapely.prepare(region)
        cells = pattern.panel == panel
        printed[cells] = shapely.contains_xy(region, pattern.centroids[cells])
    return printed


def printed_fractions(pattern: Pattern, regions: Regions) -> Floats:
    """Return the part of the area of each triangle that is printed, (t,)."""
    found = np.zeros(len(pattern.panel))
    for panel, region in enumerate(regions):
        cells = np.flatnonzero(pattern.panel == panel)
        shapely.prepare(region)
        triangles = shapely.polygons(pattern.corners[cells])
        cut = np.flatnonzero(shapely.intersects(region, triangles))
        inside = shapely.contains_properly(region, triangles[cut])
        found[cells[cut[inside]]] = 1.0
        cut = cut[~inside]
        triangle, parts = cut_by_triangles(region, pattern.corners[cells[cut]])
        areas = np.bincount(triangle, shapely.area(parts), minlength=len(cut))
        found[cells[cut]] = np.minimum(areas / pattern.areas[cells[cut]], 1.0)
    return found


@dataclass(frozen=True, eq=False)
class StoredPrint:
    """A print as it was written: the whole pattern, the print on it, and the printer's limits."""

    pattern: Pattern
    regions: list[BaseGeometry]
    limits: PrintLimits


def write_print_polygons(
    path: Path | str, pattern: Pattern, regions: Regions, limits: PrintLimits
) -> None:
    """Write a print on a whole pattern as an archive, a file ending in .npz (one rank).

    Its entries are those of `write_pattern`, the arrays of `packed_regions`, and "limits", those of
    the printer.
    """
    numbers = {"limits": asdict(limits)}
    write_archive(Path(path), archive_of(KIND, pattern, packed_regions(regions), numbers))


@on_root
def read_print_polygons(comm: MPI.Comm, run: Path | str) -> StoredPrint:
    """Read the print of a finished run, by its folder or file, the same on all ranks (collective).

    Raises:
        FileError: There is no such file, it is damaged, of another kind or format, or holds
            no valid print.
    """
    path = Path(run)
    path = path / PRINT if path.suffix != ".npz" else path
    remedy = f"Give the folder of a finished design, which has a {PRINT}."

    def make(archive: Archive) -> StoredPrint:
        limits = PrintLimits(**archive.numbers["limits"])
        pattern = pattern_of(archive)
        return StoredPrint(pattern, regions_of(archive, len(pattern.panel_names)), limits)

    return read_archive(path, KIND, make, FileError, remedy)


# ------------------------------------------------ polygons on other meshes, on a whole, on a part


def regions_on(
    source: Pattern, regions: Regions, target: Pattern, *, any_size: bool = False
) -> list[BaseGeometry]:
    """Return regions on another mesh of the same pattern, scaled where it has another size.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
    """
    source.require_regions(regions)
    if source is target:
        return list(regions)
    there = scaled_points(source, target, any_size=any_size)
    found = []
    for name in target.panel_names:
        points = np.unique(target.flat_triangles[target.cells_of(name)])
        place = Affine.fit(there[points], target.flat_points[points])
        number, outline = source.panel_index(name), target.outline(target.panel_index(name))
        own = place.region(source.outline(number))
        found.append(_up_to(outline, place.region(regions[number]), own))
    return found


def _up_to(outline: BaseGeometry, region: BaseGeometry, own: BaseGeometry) -> BaseGeometry:
    """Return a region whose print at its own outline goes on up to another one.

    Polygons with more or fewer sides differ by slivers, as those of a round cap do.
    """
    way, size = own.hausdorff_distance(outline), np.sqrt(outline.area)
    if region.is_empty or way < SLIT * size:
        return region
    at_outline = region & own.boundary.buffer(SLIT * size)
    more = outline.difference(own) & at_outline.buffer((1 + SLIT) * way, join_style="mitre")
    return shapely.MultiPolygon(list(polygons_of(region.union(more.buffer(SLIT * way)) & outline)))


def beyond_seams(
    pattern: Pattern, regions: Regions, margin: float
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Return print and outline of each panel with what lies beyond its straight seams.

    That is a strip as wide as a margin in m, of the panel to which one rigid motion leads.
    """
    found, outlines = list(regions), list(pattern.outlines)
    for seam in straight_joints(pattern):
        line = shapely.line_merge(shapely.union_all(shapely.linestrings(seam.edges)))
        strip = pattern.outline(seam.source) & line.buffer(margin, cap_style="flat")
        place = Affine(seam.turn[0], seam.shift[0])
        for whole, more in ((outlines, strip), (found, regions[seam.source] & strip)):
            # A little larger, or rounding would leave a slit.
            there = place.region(more).difference(pattern.outline(seam.panel))
            there = there.buffer(SLIT * margin, join_style="mitre")
            parts = polygons_of(whole[seam.panel].union(there))
            whole[seam.panel] = shapely.MultiPolygon(list(parts))
    return found, outlines


def part_regions(part: Pattern, regions: Regions) -> list[BaseGeometry]:
    """Return the regions of a part, whose panels are the first of the whole, at the same places."""
    return [regions[k] & part.outline(k) for k in range(len(part.panel_names))]


def with_more(
    own: BaseGeometry, other: BaseGeometry, outline: BaseGeometry, detail: float
) -> BaseGeometry:
    """Return a region with what only its image has inside an outline, but for narrow pieces."""
    more = (other & outline).difference(own).buffer(-detail / 2).buffer(detail)
    return own if more.is_empty else own.union(more & other) & outline


def case_of_print(
    comm: MPI.Comm, case: Case, pattern: Pattern, regions: Regions, *, coarser: float = 1.0
) -> Case:
    """Return a case whose mesh has the borders of a print, by `Case.following` (collective).

    The print is that of the whole skin on its own pattern, which is another mesh.
    """
    own = print_on(comm, case, pattern, regions)
    return case.following(comm, own, coarser=coarser)


def print_on(
    comm: MPI.Comm, case: Case, pattern: Pattern, regions: Regions, *, any_size: bool = False
) -> list[BaseGeometry]:
    """Return a print on the pattern of a case (collective).

    The print's own pattern is another mesh of the whole skin, perhaps of another size.

    Raises:
        PanelError: The panels or, unless they may, their sizes are others, or the number of
            regions is not theirs.
    """

    def laid() -> list[BaseGeometry]:
        there = regions_on(pattern, regions, case.whole.pattern, any_size=any_size)
        return part_regions(case.pattern, there)

    return on_first_rank(comm, laid)


def packed_regions(regions: Regions) -> dict[str, npt.NDArray]:
    """Return polygons of panels as arrays: well-known binary of all, in m, and sizes in bytes."""
    texts = [shapely.to_wkb(region) for region in regions]
    sizes = np.array([len(text) for text in texts])
    return dict(zip(REGIONS, (np.frombuffer(b"".join(texts), np.uint8), sizes), strict=True))


def regions_of(archive: Archive, panels: int) -> list[BaseGeometry]:
    """Return the regions in an archive, of so many panels."""
    data, sizes = (archive.arrays[name] for name in REGIONS)
    fits = len(sizes) == panels and sizes.min() >= 0
    if not fits or sizes.sum() != data.nbytes:
        raise FileError("the polygons do not fit the panels")
    text, stops = data.tobytes(), np.cumsum(sizes)
    return [shapely.from_wkb(text[b - n : b]) for b, n in zip(stops, sizes, strict=True)]
