"""Drawings of panels: outlines, allowances and print; as SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.files import replace_file
from toros_fem.base.validation import Floats
from toros_fem.making.marks import (
    CLEAR,
    Label,
    SewnSeam,
    cross_shapes,
    crosses,
    edge_labels,
    edges_of,
    grain_arrow,
    notches,
    panel_label,
    sewn_seams,
)
from toros_fem.making.options import ALL, DEFAULT, INSIDE, ManufactureOptions
from toros_fem.meshes.panels import Affine, panel_places
from toros_fem.meshes.pattern import Pattern, Regions

# A corner sharper than this many allowances is cut off.
MITRE = 2.0
# Gaps and spikes below this fraction of the allowance are rounding.
TINY = 1e-3
# Left, lower, right and upper end in m.
Box = tuple[float, float, float, float]
# Gap between panels that are packed here, and margin, in m.
GAP, MARGIN = 10e-3, 5e-3
# Height of capitals over the size of a font without serifs.
CAPITAL = 0.72
# Ends of a line that are closer than this, in m, are the same.
CLOSED = 1e-6
NOTHING = shapely.Polygon()


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


@dataclass(frozen=True, eq=False)
class Layer:
    """What a layer of a drawing shows, in m, of one panel or, "sheet", of the sheet itself."""

    of: str
    region: BaseGeometry = NOTHING
    lines: Sequence[Floats] = ()
    labels: Sequence[Label] = ()


class Svg:
    """A drawing in true scale: one user unit is 1 mm.

    It takes lengths in m with the y axis up; in the file y points down.

    Args:
        box: What the drawing shows, in m.
        top: The height in m that has y = 0 in the file.
        digits: Decimals of coordinates in mm.
        about: What is shown, for readers that do not see it. Such a drawing is as large as its
            page gives it room; without these words its width and height are those of the box.
    """

    def __init__(self, box: Box, top: float, *, digits: int = 4, about: str = "") -> None:
        self._place = Affine(np.diag([1e3, -1e3]), np.array([0.0, 1e3 * top]))
        self._digits = digits
        left, low, right, high = box
        x, y = self._place.points([left, high]) + 0.0
        width, height = 1e3 * (right - left), 1e3 * (high - low)
        size = {"width": f"{width:.3f}mm", "height": f"{height:.3f}mm"}
        if about:
            size = {"role": "img", "aria-label": about}
        view = f"{round(x, 3):g} {round(y, 3):g} {width:.3f} {height:.3f}"
        space = "http://www.w3.org/2000/svg"
        self.root = ET.Element("svg", {"xmlns": space, **size, "viewBox": view})

    def group(self, attributes: Mapping[str, str], parent: ET.Element | None = None) -> ET.Element:
        """Return a new group in another one, or in the drawing."""
        return ET.SubElement(self.root if parent is None else parent, "g", dict(attributes))

    def region(
        self, parent: ET.Element, region: BaseGeometry, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add polygons as one path, for a group that is filled by the even-odd rule."""
        if data := region_data(self._place.region(region), self._digits):
            ET.SubElement(parent, "path", {**(attributes or {}), "d": data})

    def line(
        self, parent: ET.Element, line: Floats, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add a line through points (n, 2), closed where it ends at its first point."""
        data = line_data(self._place.points(line), self._digits)
        ET.SubElement(parent, "path", {**(attributes or {}), "d": data})

    def disc(self, parent: ET.Element, centre: Floats, radius: float, fill: str) -> None:
        """Add a disc; its fill is a colour of CSS."""
        x, y = self._place.points(centre)
        place = {"cx": f"{x:.3f}", "cy": f"{y:.3f}", "r": f"{1e3 * radius:.3f}"}
        ET.SubElement(parent, "circle", {**place, "style": f"fill:{fill}"})

    def text(
        self, parent: ET.Element, label: Label, attributes: Mapping[str, str] | None = None
    ) -> None:
        """Add a text; its group must have `text-anchor` in the middle."""
        # The place is that of the baseline, so down from the middle by half of the capitals.
        down = np.array([np.sin(label.angle), -np.cos(label.angle)]) * label.height / 2
        x, y = self._place.points(label.place + down)
        turn = f"translate({x:.3f} {y:.3f}) rotate({round(-np.degrees(label.angle), 3) + 0:.3f})"
        look = {"transform": turn, "font-size": f"{1e3 * label.height / CAPITAL:.3f}"}
        ET.SubElement(parent, "text", {**(attributes or {}), **look}).text = label.text

    def add(self, layer: Layer, parent: ET.Element) -> None:
        """Add the region, the lines and the texts of a layer."""
        self.region(parent, layer.region)
        for line in layer.lines:
            self.line(parent, line)
        for label in layer.labels:
            self.text(parent, label)

    def __str__(self) -> str:
        """Return the drawing as a part of a page."""
        return ET.tostring(self.root, encoding="unicode")

    def encoded(self) -> bytes:
        """Return the drawing as a file."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="utf-8", xml_declaration=True)


def region_data(region: BaseGeometry, digits: int = 4) -> str:
    """Return the path data of polygons in mm, to be filled by the even-odd rule."""
    rings = shapely.get_rings(shapely.get_parts(region))
    return " ".join(line_data(shapely.get_coordinates(ring), digits) for ring in rings)


def line_data(line: Floats, digits: int = 4) -> str:
    """Return the path data of a line through points in mm, (n, 2)."""
    points, closed = open_line(line, 1e3 * CLOSED)
    return "M" + " L".join(f"{x:.{digits}f},{y:.{digits}f}" for x, y in points) + " Z" * closed


def open_line(line: Floats, near: float = CLOSED) -> tuple[Floats, bool]:
    """Return a line without the point that repeats its first, and whether there is one."""
    closed = len(line) > 2 and bool(np.abs(line[0] - line[-1]).max() <= near)
    return (line[:-1] if closed else line), closed


def write_svg(path: Path, pattern: Pattern, regions: Regions) -> None:
    """Write the panels and their print as an SVG drawing in true scale (one rank).

    One user unit is 1 mm. Each panel is a group with the path "cut" (its border, red, unfilled)
    and the path "print" (the print, black, filled by the even-odd rule). Panels keep the places of
    the flat pattern where they do not overlap there.
    """
    inward = Affine.shift([MARGIN, MARGIN])
    places = [inward @ place for place in panel_places(pattern, GAP)]
    outlines = [place.region(one) for place, one in zip(places, pattern.outlines, strict=True)]
    width, height = shapely.total_bounds(outlines)[2:] + MARGIN
    svg = Svg((0.0, 0.0, width, height), height)
    filled = {"class": "print", "fill": "black", "fill-rule": "evenodd", "stroke": "none"}
    bare = {"class": "cut", "fill": "none", "stroke": "red", "stroke-width": "0.1"}
    for name, place, outline, printed in zip(
        pattern.panel_names, places, outlines, regions, strict=True
    ):
        group = svg.group({"id": name})
        ET.SubElement(group, "title").text = name
        svg.region(group, place.region(printed), filled)
        svg.region(group, outline, bare)
    replace_file(path, svg.encoded())
