"""Everything that is printed, cut, sewn and marked on one panel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.options import ALL, DEFAULT, INSIDE, ManufactureOptions
from toros_fem.making.panels.marks import CLEAR, cross_shapes, crosses, grain_arrow, notches
from toros_fem.making.panels.panel_labels import Label, edge_labels, panel_label
from toros_fem.making.panels.seam_lines import SewnSeam, edges_of, sewn_seams
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern, Regions

# A corner sharper than this many allowances is cut off.
MITRE = 2.0
# Gaps and spikes below this fraction of the allowance are rounding.
TINY = 1e-3


@dataclass(frozen=True, eq=False)
class Seam:
    """One edge of a panel that is sewn to an edge of the same or of another panel.

    Its number, from 1, is the same on both edges. Its line, (n, 2), in m, begins on both at the
    same end of the seam.
    """

    number: int
    line: Floats


@dataclass(frozen=True, eq=False)
class PanelDrawing:
    """Everything that is printed, cut, sewn and marked on one panel, in m.

    Attributes:
        outline: The seam line: border of the panel in the assembled skin.
        cut: The outline to cut, with the allowance.
        notches: Segments (k, 2, 2) from the cut into the allowance.
        grain: Lines of the arrow along the grain, (n, 2) each; none where the grain is free.
        crosses: Centres of the registration crosses, (k, 2), which print and cut share.
        cross_size: Their size in m.
    """

    name: str
    outline: BaseGeometry
    cut: BaseGeometry
    printed: BaseGeometry
    seams: tuple[Seam, ...]
    notches: Floats
    grain: tuple[Floats, ...]
    crosses: Floats
    cross_size: float
    labels: tuple[Label, ...]

    @property
    def marks(self) -> list[Floats]:
        """Lines of the grain arrow and of the crosses, (n, 2) each."""
        return [*self.grain, *cross_shapes(self.crosses, self.cross_size)]

    @property
    def footprint(self) -> BaseGeometry:
        """Room that the panel needs on a sheet: the cut outline, and squares around crosses."""
        half = self.cross_size / 2
        squares = [shapely.box(*(c - half), *(c + half)) for c in self.crosses]
        return shapely.union_all([self.cut, *squares])

    def moved(self, place: Affine) -> PanelDrawing:
        """Return the drawing after a rotation and translation; texts stay upright."""
        return replace(
            self,
            outline=place.region(self.outline),
            cut=place.region(self.cut),
            printed=place.region(self.printed),
            seams=tuple(replace(seam, line=place.points(seam.line)) for seam in self.seams),
            notches=place.points(self.notches),
            grain=tuple(place.points(line) for line in self.grain),
            crosses=place.points(self.crosses),
            labels=tuple(label.moved(place) for label in self.labels),
        )


def panel_drawings(
    pattern: Pattern, regions: Regions, options: ManufactureOptions = DEFAULT
) -> list[PanelDrawing]:
    """Return the drawing of each panel of a whole pattern in its own flat coordinates.

    For a print on the inside the pattern is that of `printed_face`. Errors are those of
    `sewn_seams`, and of `Pattern.require_regions`.
    """
    seams = sewn_seams(pattern)
    pattern.require_regions(regions)
    return [
        drawing_of(
            [(name,), (f"{options.print_side} up", "up")],
            pattern.outline(panel),
            regions[panel],
            edges_of(seams, panel),
            options,
        )
        for panel, name in enumerate(pattern.panel_names)
    ]


def printed_face(
    pattern: Pattern, regions: Regions, options: ManufactureOptions
) -> tuple[Pattern, Regions]:
    """Return a pattern, and polygons on its panels, as seen with the printed face up.

    The panels of a pattern are seen from outside. For a print on the inside they are mirrored,
    (−x, y), and so is the assembled skin, which keeps it a valid pattern.
    """
    if options.print_side != INSIDE:
        return pattern, regions
    mirror = Affine.mirror()
    seen = replace(
        pattern,
        flat_points=mirror.points(pattern.flat_points),
        flat_triangles=pattern.flat_triangles[:, ::-1],
        points=pattern.points * [-1, 1, 1],
    )
    return seen, [mirror.region(region) for region in regions]


def drawing_of(
    texts: Sequence[Sequence[str]],
    outline: BaseGeometry,
    printed: BaseGeometry,
    edges: Sequence[tuple[SewnSeam, int]],
    options: ManufactureOptions,
) -> PanelDrawing:
    """Return the drawing of one panel, by its seam line and its print.

    `texts` are written on it, its name first: of each the best wording, then shorter ones.
    """
    allowance = options.seam_allowance
    cut, cuts = outline, list[Floats]([np.empty((0, 2, 2))])
    if allowance is not None:
        lines = [seam.lines[side] for seam, side in edges]
        if options.allowance_at == ALL:
            rings = shapely.get_rings(shapely.get_parts(outline))
            lines = [shapely.get_coordinates(ring) for ring in rings]
        cut = cut_outline(outline, lines, allowance)
        cuts += [notches(*edge, cut, allowance, options.notch_distance) for edge in edges]
    centres = crosses(outline, cut, options.cross_size)
    reach = options.cross_size / 2 + CLEAR
    marks = [
        shapely.MultiLineString(list(np.concatenate(cuts))).buffer(CLEAR),
        shapely.MultiPoint(centres).buffer(reach, cap_style="square"),
    ]
    kept_free = shapely.union_all(marks)
    # Where nothing is yet: in the allowance, on bare fabric, on the panel with its print.
    room: list[BaseGeometry] = [
        cut.difference(outline).difference(kept_free).buffer(-CLEAR / 2),
        outline.difference(printed.buffer(CLEAR)).difference(kept_free).buffer(-CLEAR),
        outline,
    ]
    labels: list[Label] = []
    if allowance is not None:
        for edge in edges:
            numbers = edge_labels(*edge, room[0], allowance)
            labels, room = labels + numbers, _beside(room, numbers)
    for text in texts:
        label = panel_label(text, edges, room[0], room[1], outline, allowance)
        labels, room = [*labels, label], _beside(room, [label])
    grain = options.drawn_grain
    return PanelDrawing(
        name=texts[0][0],
        outline=outline,
        cut=cut,
        printed=printed,
        seams=tuple(Seam(seam.number, seam.lines[side]) for seam, side in edges),
        notches=np.concatenate(cuts),
        grain=() if grain is None else tuple(grain_arrow(room, grain)),
        crosses=centres,
        cross_size=options.cross_size,
        labels=tuple(labels),
    )


def _beside(room: Sequence[BaseGeometry], labels: Sequence[Label]) -> list[BaseGeometry]:
    """Return what is left of regions beside some texts."""
    taken = shapely.union_all([label.frame for label in labels])
    return [region.difference(taken) for region in room]


def cut_outline(outline: BaseGeometry, lines: Sequence[Floats], allowance: float) -> BaseGeometry:
    """Return a panel's outline with its allowance, a width in m, along some lines of its border.

    Corners are mitred, sharp ones cut off at twice the allowance. At the end of a line, points
    (n, 2) in m, the allowance ends at a right angle to it. Where the allowances of both sides of a
    dart or slit meet, the fabric between them stays.
    """
    if not len(lines):
        return outline
    around = outline.buffer(allowance, join_style="mitre", mitre_limit=MITRE)
    sewn = shapely.line_merge(shapely.multilinestrings([shapely.linestrings(k) for k in lines]))
    tiny = TINY * allowance
    free = outline.boundary.difference(sewn.buffer(tiny))
    if free.length <= tiny:
        return _solid(around, outline, tiny)
    bands = sewn.buffer(allowance, cap_style="flat", join_style="mitre", mitre_limit=MITRE)
    parts = shapely.get_parts(bands.intersection(around).difference(outline))
    # At a sharp corner the inner half of a band comes out of the panel: it only touches the line.
    beside = shapely.length(shapely.intersection(parts, sewn.buffer(tiny))) > 8 * tiny
    return _solid(shapely.union_all([outline, *parts[beside]]), outline, tiny)


def _solid(cut: BaseGeometry, outline: BaseGeometry, tiny: float) -> BaseGeometry:
    """Return the one polygon around a panel, without spikes and slits of rounding."""
    smooth = cut.buffer(tiny, join_style="mitre").buffer(-2 * tiny, join_style="mitre")
    smooth = smooth.buffer(tiny, join_style="mitre").union(outline)
    parts = shapely.get_parts(smooth)
    largest = max(parts, key=lambda part: part.intersection(outline).area)
    return shapely.remove_repeated_points(largest, tiny)
