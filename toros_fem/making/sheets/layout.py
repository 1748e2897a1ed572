"""What is made of a design: panels nested on beds and sheets, and their seams."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import OutlineError, TorosError
from toros_fem.making.options import DEFAULT, ManufactureOptions
from toros_fem.making.panels.marks import CLEAR, HEIGHT, ruler
from toros_fem.making.panels.panel_drawing import PanelDrawing, panel_drawings, printed_face
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.seam_lines import SewnSeam, sewn_seams
from toros_fem.making.panels.svg import Box, Layer
from toros_fem.making.sheets.placement import Placement, nest
from toros_fem.meshes.pattern import Pattern, Regions

log = logging.getLogger(__name__)
# So many panels take minutes to be placed.
MANY = 60
# Layers from the lowest to the highest: the order in which most machines work, the cut at last. By
# their colours, in SVG and by number in DXF, cutters tell them apart.
LAYERS = {
    "print": ("#808080", 8),
    "seam": ("#0000ff", 5),
    "marks": ("#00a000", 3),
    "labels": ("#000000", 7),
    "cut": ("#ff0000", 1),
}


@dataclass(frozen=True, eq=False)
class Sheet:
    """Panels at their places on a sheet, of a width and depth in m."""

    size: tuple[float, float]
    drawings: Sequence[PanelDrawing]

    @cached_property
    def ruler(self) -> tuple[list[Floats], Label]:
        """Lines and text of the ruler that shows the scale, in m."""
        return ruler(shapely.union_all([one.footprint for one in self.drawings]), self.size)

    @property
    def box(self) -> Box:
        """What a drawing shows: the sheet, and below it the ruler if that has no room on it."""
        (base, *_), _ = self.ruler
        return 0.0, 0.0 if base[0, 1] > 0 else -HEIGHT - 4 * CLEAR, *self.size

    @cached_property
    def layers(self) -> dict[str, list[Layer]]:
        """What each layer shows, by its name; notches are cut, and belong to the cut."""
        layers: dict[str, list[Layer]] = {name: [] for name in LAYERS}
        for one in self.drawings:
            layers["print"].append(Layer(one.name, one.printed))
            layers["seam"].append(Layer(one.name, lines=[seam.line for seam in one.seams]))
            layers["marks"].append(Layer(one.name, lines=one.marks))
            layers["labels"].append(Layer(one.name, labels=one.labels))
            layers["cut"].append(Layer(one.name, one.cut, lines=list(one.notches)))
        lines, label = self.ruler
        layers["marks"].append(Layer("sheet", lines=lines))
        layers["labels"].append(Layer("sheet", labels=[label]))
        return layers


@dataclass(frozen=True, eq=False)
class Manufacture:
    """What is made of a design: panels on the printer's beds and on the sheets of fabric.

    Files, manifest and page show it. The fabric is fixed to the bed, printed, and cut afterwards.
    On a sheet larger than the bed several beds lie beside each other in a grid, and the fabric is
    moved on between two prints.

    Attributes:
        options: Settings of the files.
        seams: Seams between the panels.
        drawings: The panels in their own coordinates.
        placements: Their places on the beds; `Placement.sheet` is the number of the bed.
        bed, sheet: Width and depth in m of the part of the bed that is used, and of a sheet.
        grid: Numbers of beds on a sheet, along its width and its depth.
    """

    options: ManufactureOptions
    seams: Sequence[SewnSeam]
    drawings: Sequence[PanelDrawing]
    placements: Sequence[Placement]
    bed: tuple[float, float]
    sheet: tuple[float, float]
    grid: tuple[int, int]

    @cached_property
    def beds(self) -> list[Sheet]:
        """Each bed with the panels on it."""
        return self._placed(self.bed, self.placements)

    @cached_property
    def sheets(self) -> list[Sheet]:
        """Each sheet with the panels on it."""
        return self._placed(self.sheet, self.on_sheets)

    @cached_property
    def on_sheets(self) -> list[Placement]:
        """The places of the panels on the sheets."""
        found = []
        for place in self.placements:
            sheet, (x, y) = self.bed_on_sheet(place.sheet)
            moved = place.offset[0] + x, place.offset[1] + y
            found.append(Placement(place.panel, sheet, place.angle, moved))
        return found

    def _placed(self, size: tuple[float, float], placements: Sequence[Placement]) -> list[Sheet]:
        found: list[list[PanelDrawing]] = [[] for _ in range(1 + max(p.sheet for p in placements))]
        for drawing, place in zip(self.drawings, placements, strict=True):
            found[place.sheet].append(drawing.moved(place.to_sheet))
        return [Sheet(size, drawings) for drawings in found]

    def bed_on_sheet(self, bed: int) -> tuple[int, tuple[float, float]]:
        """Return the sheet that a bed lies on, from 0, and the bed's lower left corner in m."""
        sheet, window = divmod(bed, self.grid[0] * self.grid[1])
        row, column = divmod(window, self.grid[0])
        return sheet, (column * self.bed[0], row * self.bed[1])


def placing_fault(pattern: Pattern) -> str | None:
    """Return why the panels of a whole pattern fit on no sheet of the default size, or None."""
    try:
        manufacture(pattern, [MultiPolygon()] * len(pattern.panel_names), ManufactureOptions())
    except OutlineError as error:
        return str(error)
    except TorosError:  # of a package or of the pattern: told where the files are made
        return None
    return None


def manufacture(
    pattern: Pattern, regions: Regions, options: ManufactureOptions = DEFAULT
) -> Manufacture:
    """Return what is made of a design on a whole pattern; errors as of `sewn_seams` and `nest`.

    Copies of a panel follow after all panels, with a number after their name.
    """
    pattern, regions = printed_face(pattern, regions, options)
    drawings = [
        one if copy == 1 else replace(one, name=f"{one.name} ({copy})")
        for copy in range(1, options.copies + 1)
        for one in panel_drawings(pattern, regions, options)
    ]
    if len(drawings) > MANY:
        log.info("placing %d panels, which takes minutes", len(drawings))
    bed = options.bed_width, options.bed_depth
    sheet = options.sheet_width or bed[0], options.sheet_depth or bed[1]
    used = min(bed[0], sheet[0]), min(bed[1], sheet[1])
    outlines: dict[str, BaseGeometry] = {one.name: one.footprint for one in drawings}
    placements = nest(
        outlines,
        used,
        gap=options.panel_gap,
        margin=options.sheet_margin,
        grain=options.drawn_grain,
    )
    columns, rows = (int(whole / part + 1e-9) for whole, part in zip(sheet, used, strict=True))
    seams = sewn_seams(pattern)
    return Manufacture(options, seams, drawings, placements, used, sheet, (columns, rows))
