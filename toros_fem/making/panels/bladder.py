"""The bladder: sheets of film, welded around, with a tab for the tube."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import PanelError
from toros_fem.base.validation import checked_floats
from toros_fem.making.options import ALL, DEFAULT, ManufactureOptions
from toros_fem.making.panels.panel_drawing import PanelDrawing, Seam, drawing_of
from toros_fem.making.panels.seam_lines import SewnSeam, edges_of, sewn_seams
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern

# A border that differs by less than this fraction of an allowance is the same.
TINY = 1e-3
# Number of places that are tried along a weld.
TRIED = 500
# Difference of the curves of two edges that counts as none, over their length.
ALIKE = 0.05
EMPTY = shapely.Polygon()


@dataclass(frozen=True, eq=False)
class BladderSheets:
    """Sheets of film in their own coordinates, to be welded along their seam lines.

    `tab_seam` is the seam of the skin where the tab leaves; None without a tab, and for a tube,
    whose sheets have a weld of their own. Where nothing is sewn there are no sheets.
    """

    drawings: list[PanelDrawing]
    tab_seam: int | None


class _Sheets(NamedTuple):
    """Sheets of film before they have a tab: their weld lines, and what is welded to what.

    The weld with the tab is given with the arc length in m of the tab's middle.
    """

    names: Sequence[str]
    outlines: Sequence[BaseGeometry]
    welds: Sequence[SewnSeam]
    tab: tuple[SewnSeam, float]


def bladder_sheets(
    pattern: Pattern,
    options: ManufactureOptions = DEFAULT,
    connector: tuple[str, Floats] | None = None,
) -> BladderSheets:
    """Return the bladder of a whole skin.

    A tube, one panel sewn to itself with caps or without, gets two flat sheets. They are half its
    perimeter wide, and longer than the wall by the radius of each cap, over which they fold. Other
    skins get one sheet for each panel, of the same outline: two for flat robots. So the bladder is
    as large as the skin at rest, and must stretch with it. The weld has an allowance all around.
    Both sheets have a tab for the tube at the same place of their weld; it is open at its end.

    Args:
        connector: Name of a panel and a point (2,) in m on it: the tab is at the weld nearest to
            it where both edges have the same curve. None takes the middle of the largest panel. The
            two sheets of a tube have theirs in the middle of an end, the clamped one.

    Raises:
        PanelError: There is no such panel, or nothing is sewn to it.
        PatternError: The skin is moulded.
    """
    seams = sewn_seams(pattern)
    if not seams:
        return BladderSheets([], None)
    sheets = _tube(pattern, seams) or _panels(pattern, seams, connector, options)
    allowance = options.weld_allowance
    plain = options.updated(seam_allowance=allowance, allowance_at=ALL, grain=None)
    drawings = []
    for k, name in enumerate(sheets.names):
        edges = edges_of(sheets.welds, k)
        drawing = drawing_of([(name,)], sheets.outlines[k], EMPTY, edges, plain)
        drawings.append(replace(drawing, crosses=np.empty((0, 2))))
    if options.connector_width is None:
        return BladderSheets(drawings, None)
    weld, arc = sheets.tab
    size = options.connector_width, options.connector_length
    for side, k in enumerate(weld.panels):
        drawings[k] = _with_tab(drawings[k], weld, side, arc, allowance, size)
    return BladderSheets(drawings, weld.number if weld in seams else None)


def _tube(pattern: Pattern, seams: Sequence[SewnSeam]) -> _Sheets | None:
    """Return the two flat sheets for a tube; None where the skin is none."""
    own = [seam for seam in seams if seam.panels[0] == seam.panels[1]]
    if len(own) != 1:
        return None
    wall = own[0].panels[0]
    apart = np.linalg.norm(own[0].lines[0] - own[0].lines[1], axis=1)
    others = [seam for seam in seams if seam is not own[0]]
    caps = [sum(seam.panels) - wall for seam in others]
    lone = all(wall in seam.panels for seam in others) and len(set(caps)) == len(caps) <= 2
    if not lone or apart.min() < 0.5 * apart.max():
        return None
    radii = [shapely.minimum_bounding_radius(pattern.outline(cap)) for cap in caps]
    size = np.array([apart.mean() / 2, own[0].length + sum(radii)])
    # The weld begins at a corner, so that its double notch is not where the tab is.
    corners = np.array([[0.5, 0], [0.5, 1], [-0.5, 1], [-0.5, 0], [0, 0], [0.5, 0]]) * size
    weld = SewnSeam(1, (0, 1), np.stack([corners, corners * [-1, 1]]), (0, 0))
    box = shapely.Polygon(corners)
    names = ["bladder front", "bladder back"]
    return _Sheets(names, [box, box], [weld], (weld, float(weld.arc[4])))


def _panels(
    pattern: Pattern,
    seams: list[SewnSeam],
    connector: tuple[str, Floats] | None,
    options: ManufactureOptions,
) -> _Sheets:
    """Return a sheet for each panel."""
    outlines = pattern.outlines
    if connector is None:
        panel = int(np.argmax(shapely.area(outlines)))
        point = shapely.get_coordinates(outlines[panel].centroid)[0]
    else:
        panel = pattern.panel_index(connector[0])
        point = checked_floats("connector", connector[1], "a point (2,), in m", (2,))
    edges = edges_of(seams, panel)
    if not edges:
        raise PanelError(
            f"nothing is sewn to panel {pattern.panel_names[panel]!r}, so its bladder has no weld "
            "for the tab. Choose another panel, or leave the tab out."
        )
    reach = options.weld_allowance + (options.connector_width or 0) / 2
    places = [(weld, *_best_place(weld, side, point, reach)) for weld, side in edges]
    weld, arc, _ = min(places, key=lambda place: place[2])
    names = [f"bladder {name}" for name in pattern.panel_names]
    return _Sheets(names, outlines, seams, (weld, arc))


def _best_place(
    weld: SewnSeam, side: int, point: Floats, reach: float
) -> tuple[float, tuple[bool, float, float]]:
    """Return where on a weld a tab is best, as an arc length in m, and a rank: the less the better.

    The tab should have its whole width there; both edges should have the same curve, as straight
    ones do, so that tabs on both fit together; and the place should be near to a point.
    """
    arc: Floats = np.linspace(0, weld.length, TRIED)[1:-1].astype(np.float64)
    unlike = np.zeros(len(arc))
    for step in np.linspace(-reach, reach, 9):
        out = [
            np.sum(
                (weld.at(one, arc + step) - weld.at(one, arc)) * weld.outward(one, arc, reach), 1
            )
            for one in (0, 1)
        ]
        unlike = np.maximum(unlike, np.abs(out[0] - out[1]) // (ALIKE * reach))
    beyond = (arc < reach) | (arc > weld.length - reach)
    far = np.linalg.norm(weld.at(side, arc) - point, axis=1)
    best = int(np.lexsort([far, unlike, beyond])[0])
    return float(arc[best]), (bool(beyond[best]), float(unlike[best]), float(far[best]))


def _with_tab(
    drawing: PanelDrawing,
    weld: SewnSeam,
    side: int,
    arc: float,
    allowance: float,
    size: tuple[float, float],
) -> PanelDrawing:
    """Return a sheet with a tab at one of its welds."""
    width, length = size
    foot = weld.at(side, np.array([arc]))[0]
    out = weld.outward(side, np.array([arc]), width)[0]
    # From a frame at the middle of the tab's foot, whose y axis points out of the sheet.
    place = Affine(np.column_stack([[out[1], -out[0]], out]), foot)
    reach, wide = allowance + length, width / 2 + allowance
    tab = place.region(shapely.box(-width / 2, -width / 2, width / 2, reach))
    end = shapely.LineString(place.points([[-width / 2, reach], [width / 2, reach]]))
    outline = drawing.outline.union(tab)
    cut = drawing.cut.union(place.region(shapely.box(-wide, 0.0, wide, reach)))
    tiny = TINY * allowance
    others = [seam for seam in drawing.seams if seam.number != weld.number]
    rest = [shapely.LineString(seam.line) for seam in others]
    left = outline.boundary.difference(shapely.union_all([end, *rest]).buffer(tiny))
    parts = shapely.get_parts(shapely.line_merge(left))
    lines = [shapely.get_coordinates(part) for part in parts if part.length > 2 * tiny]
    near = tab.buffer(allowance)
    notched = shapely.intersects(shapely.linestrings(drawing.notches), near)
    return replace(
        drawing,
        outline=outline,
        cut=cut,
        seams=(*others, *(Seam(weld.number, line) for line in lines)),
        notches=drawing.notches[~notched],
        labels=tuple(label for label in drawing.labels if not label.frame.intersects(near)),
    )
