"""What is made of a design: panels nested on beds and sheets, and their seams."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import OutlineError, TorosError
from toros_fem.base.packages import required
from toros_fem.base.validation import Floats
from toros_fem.making.marks import CLEAR, HEIGHT, Label, SewnSeam, ruler, sewn_seams
from toros_fem.making.options import DEFAULT, ManufactureOptions
from toros_fem.making.panel_drawing import Box, Layer, PanelDrawing, panel_drawings, printed_face
from toros_fem.meshes.panels import Affine
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
class CutSheet:
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
    def beds(self) -> list[CutSheet]:
        """Each bed with the panels on it."""
        return self._placed(self.bed, self.placements)

    @cached_property
    def sheets(self) -> list[CutSheet]:
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

    def _placed(self, size: tuple[float, float], placements: Sequence[Placement]) -> list[CutSheet]:
        found: list[list[PanelDrawing]] = [[] for _ in range(1 + max(p.sheet for p in placements))]
        for drawing, place in zip(self.drawings, placements, strict=True):
            found[place.sheet].append(drawing.moved(place.to_sheet))
        return [CutSheet(size, drawings) for drawings in found]

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


# Direction of the grain on every sheet, in rad from x: along the roll.
ROLL = np.pi / 2
# Outlines are nested with corners left out, by at most this distance, in m.
SIMPLIFIED = 0.05e-3
# Panels of a flat plane move away from its middle by these shares of their distance to it.
SPREADS = tuple(np.linspace(0.0, 0.5, 26))
# Rounding of distances and sizes that is let pass, in m.
ROUNDING = 1e-6
MM = 1e3


@dataclass(frozen=True)
class Placement:
    """The place of a panel on a sheet: turned about the chart's origin, then moved.

    Attributes:
        sheet: Number of the sheet, from 0.
        angle: Counter-clockwise turn in rad.
        offset: Translation after the turn, in m.
    """

    panel: str
    sheet: int
    angle: float
    offset: tuple[float, float]

    @property
    def to_sheet(self) -> Affine:
        """Map from the panel's chart to the sheet."""
        return Affine.turn(self.angle, self.offset)


def nest(
    outlines: Mapping[str, BaseGeometry],
    size: tuple[float, float],
    *,
    gap: float,
    margin: float,
    grain: float | None = None,
) -> list[Placement]:
    """Return a place for each panel on as few sheets as are found; the same in every run.

    Panels that are apart in their flat plane and together fit on one sheet keep their places
    there; they are moved apart where their allowances meet. Others are nested by u-nesting, whose
    first-fit by no-fit polygons has no random part.

    Args:
        outlines: Polygon in m to place for each panel, its seam allowance included.
        size: Width and depth of a sheet in m.
        gap: Least distance of two panels in m.
        margin: Least distance of a panel from the border of its sheet in m.
        grain: Direction of the grain in rad on the flat panels, from their x axis; it comes to lie
            along the y axis of the sheet, so a panel has two possible turns. None leaves a panel
            free: quarter turns of its chart and of its narrowest rectangle.

    Raises:
        OutlineError: A panel fits on no sheet.
        MissingPackageError: u-nesting is not installed, and panels must be nested.
    """
    usable = np.array(size) - 2 * margin
    turns = {name: _turns(shape, grain) for name, shape in outlines.items()}
    for name, shape in outlines.items():
        _require_fit(name, shape, turns[name], usable, size)
    placed = _kept(outlines, turns, usable, gap)
    if not placed:
        placed = _nested(outlines, turns, usable, gap)
        _require_apart(outlines, placed, usable, gap)
    return [replace(p, offset=(p.offset[0] + margin, p.offset[1] + margin)) for p in placed]


def _turns(shape: BaseGeometry, grain: float | None) -> list[float]:
    """Return the turns in rad that a panel may take, the present place first."""
    if grain is not None:
        return [float((ROLL - grain + k * np.pi) % (2 * np.pi)) for k in (0, 1)]
    quarters = [k * np.pi / 2 for k in range(4)]
    corners = shapely.get_coordinates(shapely.oriented_envelope(shape))
    side = corners[1] - corners[0]
    upright = float(np.arctan2(side[1], side[0])) % (np.pi / 2)
    if min(upright, np.pi / 2 - upright) < 1e-9:
        return quarters
    return quarters + [quarter - upright for quarter in quarters]


def _box(shape: BaseGeometry, angle: float) -> tuple[Floats, Floats]:
    """Return lower left corner and size of a shape after a turn about the origin, in m."""
    points = Affine.turn(angle).points(shapely.get_coordinates(shape))
    return points.min(axis=0), np.ptp(points, axis=0)


def _require_fit(
    name: str,
    shape: BaseGeometry,
    turns: Sequence[float],
    usable: Floats,
    size: tuple[float, float],
) -> None:
    sizes = [_box(shape, angle)[1] for angle in turns]
    if any(np.all(box <= usable + ROUNDING) for box in sizes):
        return
    wide, deep = MM * sizes[0]
    turned = ", turned as its grain allows" if len(turns) == 2 else ""
    raise OutlineError(
        f"panel {name!r} is {wide:.1f} × {deep:.1f} mm with its allowance and crosses{turned}, and "
        f"does not fit on a sheet of {MM * size[0]:g} × {MM * size[1]:g} mm, of which "
        f"{MM * usable[0]:.1f} × {MM * usable[1]:.1f} mm are within the margin. Give a larger bed "
        "or sheet, a smaller margin or seam allowance, leave the grain free, or cut the panel in "
        "two by a seam."
    )


def _kept(
    outlines: Mapping[str, BaseGeometry],
    turns: Mapping[str, Sequence[float]],
    usable: Floats,
    gap: float,
) -> list[Placement]:
    """Return the places of the flat plane on one sheet; none where they do not serve.

    Panels that the plane has apart, but whose allowances meet, move away from the middle.
    """
    shapes = list(outlines.values())
    centres = np.array([shapely.get_coordinates(shape.envelope.centroid)[0] for shape in shapes])
    for spread in SPREADS:
        moves = spread * (centres - centres.mean(axis=0))
        moved = [translate(shape, *move) for shape, move in zip(shapes, moves, strict=True)]
        if all(one.distance(other) >= gap - ROUNDING for one, other in combinations(moved, 2)):
            break
    else:
        return []
    whole = shapely.GeometryCollection(moved)
    for angle in next(iter(turns.values())):
        low, box = _box(whole, angle)
        common = all(any(np.isclose(angle, t) for t in allowed) for allowed in turns.values())
        if common and np.all(box <= usable + ROUNDING):
            offsets = Affine.turn(angle).vectors(moves) - low
            return [
                Placement(name, 0, angle, (float(x), float(y)))
                for name, (x, y) in zip(outlines, offsets, strict=True)
            ]
    return []


def _nested(
    outlines: Mapping[str, BaseGeometry],
    turns: Mapping[str, Sequence[float]],
    usable: Floats,
    gap: float,
) -> list[Placement]:
    nesting = required("u_nesting")
    names = list(outlines)
    parts = [
        {
            "id": str(k),
            "polygon": (MM * shapely.get_coordinates(_hull(outlines[name]))[:-1]).tolist(),
            "rotations": np.degrees(turns[name]).tolist(),
        }
        for k, name in enumerate(names)
    ]
    # Without a limit of time the result is that of the method alone.
    config = {"strategy": "nfp", "spacing": MM * gap, "time_limit_ms": 0, "multi_sheet": True}
    width, height = MM * (usable + ROUNDING)
    answer = nesting.solve_2d(parts, {"width": width, "height": height}, config)
    if not answer["success"] or not answer["all_placed"]:
        left = ", ".join(repr(names[int(k)]) for k in answer.get("unplaced", []))
        raise OutlineError(
            f"no place was found for {left or 'the panels'} ({answer.get('error') or 'no room'}). "
            "Give a larger bed or sheet, or a smaller gap between panels."
        )
    found = {}
    for place in answer["placements"]:
        name = names[int(place["geometry_id"])]
        angle = min(turns[name], key=lambda turn: abs(np.sin((turn - place["rotation"][0]) / 2)))
        x, y = (value / MM for value in place["position"])
        found[name] = Placement(name, place["boundary_index"], angle, (x, y))
    return [found[name] for name in names]


def _hull(shape: BaseGeometry) -> BaseGeometry:
    """Return a polygon around a shape with fewer corners, as large as it is along its turns."""
    filled = shapely.union_all([shapely.Polygon(p.exterior) for p in shapely.get_parts(shape)])
    if filled.geom_type != "Polygon":
        filled = filled.convex_hull
    wide = filled.buffer(SIMPLIFIED, join_style="mitre").simplify(SIMPLIFIED)
    inner = wide.intersection(filled.envelope).intersection(shapely.oriented_envelope(filled))
    # Borders that nearly coincide leave corners 1e-17 m apart, which nesting refuses.
    return shapely.remove_repeated_points(inner, 1e-3 * ROUNDING)


def _require_apart(
    outlines: Mapping[str, BaseGeometry], placed: Sequence[Placement], usable: Floats, gap: float
) -> None:
    """Check what was nested against the outlines themselves."""
    sheet = shapely.box(0, 0, *usable).buffer(2 * ROUNDING, join_style="mitre")
    before: dict[int, list[BaseGeometry]] = defaultdict(list)
    for place in placed:
        region, others = place.to_sheet.region(outlines[place.panel]), before[place.sheet]
        if not sheet.covers(region) or any(
            region.distance(other) < gap - 2 * ROUNDING for other in others
        ):
            raise OutlineError(
                f"panel {place.panel!r} was nested beyond its sheet, or less than {MM * gap:g} mm "
                "from another one. Give a larger margin or gap."
            )
        others.append(region)
