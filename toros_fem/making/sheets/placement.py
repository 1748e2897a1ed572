"""Places of panels on sheets: nested once, and used by every file."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import OutlineError
from toros_fem.base.packages import required
from toros_fem.meshes.affine import Affine

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
