"""Polygons on the panels of another mesh, on a whole skin, and on the part that is designed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError
from toros_fem.base.files import Archive
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.lines.laid_lines import straight_joints
from toros_fem.design.loop.case import Case
from toros_fem.meshes.panels import Affine, polygons_of
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import scaled_points

# Print beyond a seam that is seen with a panel, over the least width and the smoothing length.
BEYOND = 8.0
# What closes slits of rounding, over the width of a strip.
SLIT = 1e-7
REGIONS = ("region_bytes", "region_sizes")


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
