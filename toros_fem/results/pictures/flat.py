"""Pictures of flat panels: print and faults, design, lines, wrinkles, and an unwrapped surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Floats
from toros_fem.design.lines.field import LineField
from toros_fem.making.marks import sewn_seams
from toros_fem.making.printability import Printability, PrintLimits
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField
from toros_fem.meshes.panels import Affine, panel_places
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.unwrapped import Unwrapped
from toros_fem.results.pictures import style
from toros_fem.results.pictures.raster import DrawnSurface, Image, View
from toros_fem.results.pictures.shown import Axonometry, visible
from toros_fem.results.pictures.style import INK, SIGNED, Word, bar_below, write_title

# Space between panels over the size of the pattern.
GAP = 0.08
# The same in points, about, where names must fit between them.
NAME_GAP = 36.0
# Size in points of their letters.
NAME_SIZE = 8.0
# Room in points below, above and beside panels, with a bar and names, and without.
ROOM, BARE_ROOM = (26.0, 14.0, 4.0), (1.0, 2.0, 1.0)
# Part of the page for the panels, and for what is told beside them.
PANELS_BOX, TOLD_BOX = (0.02, 0.03, 0.66, 0.86), (0.70, 0.05, 0.29, 0.82)
# Faults of a kind that are closer than this on the page, in mm of the page, have one number.
CLOSE = 4.0
# Rows of faults that find room.
MOST_ROWS = 14
# Colours of line families, in turn.
FAMILIES = style.SERIES[1:5]
# Part of the area from which on line families are those of the whole.
WHOLE = 0.9
# Length of the mark of the largest share, over the mean edge length.
MARK = 1.1
# Colours of slack, wrinkled and taut triangles.
STATES = {Tension.SLACK: "#E5E7EB", Tension.WRINKLED: "#F2C078", Tension.TAUT: "#9DC3E6"}
# Colours span at least this deviation of the area ratio from 1.
LEAST_RANGE = 0.01
# The name of a panel that is this many times higher than wide is written upwards.
NARROW = 2.5
VIEWS = (View(20, 35), View(20, 215))


def draw_panels(
    figure: Figure,
    box: style.Box,
    pattern: Pattern,
    regions: Regions | None,
    *,
    names: bool = True,
) -> tuple[Axes, list[Affine]]:
    """Draw the panels as large as they fit into a part of a page, with names and a bar.

    Regions are their print, None for bare panels. Returned are the axes, in mm, and the place of
    each panel.
    """
    axes = figure.add_axes(box)
    axes.set_axis_off()
    page_size = figure.get_size_inches() * box[2:]
    gap = max(GAP, NAME_GAP / (72 * page_size.max()) if names else 0.0) * pattern.size
    places = panel_places(pattern, gap, tuple(page_size))
    shapes = [place.region(one) for place, one in zip(places, pattern.outlines, strict=True)]
    for panel, place in enumerate(places):
        style.fill(axes, shapes[panel], style.FABRIC, style.EDGE)
        if regions is not None:
            style.fill(axes, place.region(regions[panel]), style.PRINT)
    low, high = np.split(1e3 * shapely.total_bounds(shapes), 2)
    below, above, beside = ROOM if names else BARE_ROOM
    # One point of the page in mm, as large as the panels then are.
    across, up = 72 * page_size - [2 * beside, below + above]
    point = max((high - low) / [across, up])
    axes.set_xlim(low[0] - beside * point, high[0] + beside * point)
    axes.set_ylim(low[1] - below * point, high[1] + above * point)
    axes.set_aspect("equal")
    if names:
        _write_names(axes, pattern.panel_names, 1e3 * shapely.bounds(shapes), point)
        style.scale_bar(axes, style.bar_length(float((high - low).max())), (0.0, 0.01))
    return axes, places


def _write_names(axes: Axes, names: Sequence[str], bounds: Floats, point: float) -> None:
    """Write the name of each panel above it, or below it where it would meet another name.

    Bounds are (p, 4) in mm, the size of a point is in mm.
    """
    taken: list[BaseGeometry] = []
    for name, (left, low, _, top) in zip(names, bounds, strict=True):
        across, up = point * Word(name, (left, top), style.SOFT, NAME_SIZE).extent
        words = shapely.box(left, top, left + across, top + up)
        above = not any(words.intersects(other) for other in taken)
        taken += [words] if above else []
        at, shift, edge = (top, 3, "baseline") if above else (low, -3, "top")
        style.note(axes, name, (left, at), (0, shift), size=NAME_SIZE, va=edge)


def draw_pattern(
    figure: Figure,
    pattern: Pattern,
    regions: Regions,
    printability: Printability,
    limits: PrintLimits,
) -> None:
    """Draw the flat panels: print, numbered seams, and all that cannot be printed.

    Faults have numbers; a list beside the panels tells what they are. Those of a kind that are
    close have one number.
    """
    faults = _faults(printability, limits)
    words = {
        0: "Printable: print the dark areas, sew along equal numbers",
        1: "1 place cannot be printed as it is drawn",
    }.get(len(faults), f"{len(faults)} places cannot be printed as they are drawn")
    style.write_title(figure, words)
    axes, places = draw_panels(figure, PANELS_BOX, pattern, regions)
    if not pattern.moulded:
        _number_seams(axes, pattern, places)
    scale = _mm_of_page(axes)
    groups = _grouped(faults, places, CLOSE / scale)
    for number, group in enumerate(groups, 1):
        for fault in group:
            _mark(axes, fault, places[fault.panel])
        at = 1e3 * places[group[0].panel].points(group[0].at)
        style.note(
            axes, f"{number}", at, (9, 9), "white", fontweight="bold", ha="center", va="center",
            zorder=6,
            bbox={"boxstyle": "circle,pad=0.25", "fc": style.ACCENT, "ec": "white", "lw": 0.8},
            arrowprops={"arrowstyle": "-", "color": style.ACCENT, "lw": 0.8, "shrinkB": 0},
        )  # fmt: skip
    _list(figure, groups, printability, limits)


@dataclass(frozen=True, eq=False)
class _Fault:
    """A place that cannot be printed: its kind, the panel, a point on it, and what it measures."""

    kind: str
    panel: int
    at: Floats
    size: float
    shape: BaseGeometry


def _faults(found: Printability, limits: PrintLimits) -> list[_Fault]:
    """Return the faults of a print, the worst of each kind first."""
    faults = []
    for island in found.free_islands:
        inside = island.polygon.point_on_surface()
        at = shapely.get_coordinates(inside)[0]
        faults.append(_Fault("free island", island.panel, at, island.area, island.polygon))
    for kind, narrow in (("line", found.lines.narrow), ("gap", found.gaps.narrow)):
        for place in narrow:
            line = shapely.LineString(place.ends)
            faults.append(_Fault(kind, place.panel, place.centre, place.width, line))
    for hole in found.holes:
        if hole.area < limits.hole_area:
            at = shapely.get_coordinates(hole.polygon.centroid)[0]
            faults.append(_Fault("hole", hole.panel, at, hole.area, hole.polygon))
    return faults


def _grouped(faults: Sequence[_Fault], places: Sequence[Affine], near: float) -> list[list[_Fault]]:
    """Return faults that share a number: of one kind, within a distance in mm of the first one."""
    groups: list[list[_Fault]] = []
    for fault in faults:
        at = 1e3 * places[fault.panel].points(fault.at)
        for group in groups:
            first = group[0]
            other = 1e3 * places[first.panel].points(first.at)
            if first.kind == fault.kind and float(np.linalg.norm(at - other)) < near:
                group.append(fault)
                break
        else:
            groups.append([fault])
    return groups


def _mark(axes: Axes, fault: _Fault, place: Affine) -> None:
    shape = place.region(fault.shape)
    if shape.geom_type == "LineString":
        axes.plot(*(1e3 * shapely.get_coordinates(shape).T), color=style.ACCENT, lw=2, zorder=5)
    elif fault.kind == "hole":
        ring = 1e3 * shapely.get_coordinates(shape.exterior)
        axes.plot(*ring.T, color=style.ACCENT, lw=1.5, zorder=5)
    else:
        style.fill(axes, shape, style.ACCENT)


def _list(
    figure: Figure,
    groups: Sequence[Sequence[_Fault]],
    found: Printability,
    limits: PrintLimits,
) -> None:
    """Write what each number means, and the thinnest line and gap."""
    bounds = {"line": limits.width, "gap": limits.gap}
    rows = []
    for number, group in enumerate(groups, 1):
        kind, size = group[0].kind, min(fault.size for fault in group)
        many = f"{len(group)} {kind}s, " if len(group) > 1 else f"{kind} "
        if kind in bounds:
            told = f"{many}{1e3 * size:.2f} of {1e3 * bounds[kind]:.2g} mm"
        else:
            told = f"{many}{1e6 * size:.2g} mm²"
        rows.append((f"{number}", told, style.ACCENT))
    if len(rows) > MOST_ROWS:
        rows = [
            *rows[: MOST_ROWS - 1],
            ("…", f"and {len(rows) - MOST_ROWS + 1} more", style.ACCENT),
        ]
    for name, smallest, limit in (
        ("thinnest line", found.lines.smallest, limits.width),
        ("thinnest gap", found.gaps.smallest, limits.gap),
    ):
        if smallest is not None:
            rows.append(("", f"{name} {1e3 * smallest.width:.2g} mm", style.INK))
            rows.append(("", f"(at least {1e3 * limit:.2g} mm)", style.SOFT))
    rows.append(("", f"{len(found.pieces)} printed pieces", style.INK))
    axes = figure.add_axes(TOLD_BOX)
    axes.set_axis_off()
    for k, (mark, told, colour) in enumerate(rows):
        height = 1 - 0.058 * k
        axes.text(0.0, height, mark, color=colour, fontweight="bold", va="top")
        axes.text(0.08, height, told, color=style.INK if mark else colour, va="top")


def _number_seams(axes: Axes, pattern: Pattern, places: Sequence[Affine]) -> None:
    """Write the number of each seam beside both of its sides, outside of the panels."""
    for seam in sewn_seams(pattern):
        half = np.array([seam.length / 2])
        reach = 0.1 * seam.length
        for side in (0, 1):
            place = places[seam.panels[side]]
            at = place.points(seam.at(side, half))[0]
            out = place.matrix @ seam.outward(side, half, reach)[0]
            style.note(axes, f"{seam.number}", 1e3 * at, 8 * out, ha="center", va="center")


def _mm_of_page(axes: Axes) -> float:
    """Return how many mm on the page a mm of the panels is."""
    figure = axes.get_figure(root=True)
    assert isinstance(figure, Figure)
    width, height = 25.4 * figure.get_size_inches() * axes.get_position(original=True).size
    return min(width / np.ptp(axes.get_xlim()), height / np.ptp(axes.get_ylim()))


def draw_density(figure: Figure, box: style.Box, pattern: Pattern, density: Floats) -> Axes:
    """Draw a density on the flat panels, from fabric at 0 to print at 1, in a part of a page."""
    axes, places = draw_panels(figure, box, pattern, None, names=False)
    mix = np.clip(np.nan_to_num(density), 0, 1)[:, None]
    _fill_cells(axes, pattern, places, (1 - mix) * style.FABRIC + mix * style.PRINT)
    return axes


def draw_lines(figure: Figure, field: LineField, pattern: Pattern, regions: Regions) -> None:
    """Draw line families, laid over each other, and of the print that they became.

    Each mark has the direction of the lines in its triangle; its length grows with the share. The
    families may be those of a part that is cut at symmetry planes, beside the print of the whole.
    """
    style.write_title(figure, f"{field.families} families of lines, and the print that they became")
    axes, places = draw_panels(figure, (0.02, 0.10, 0.47, 0.79), field.pattern, None)
    area = field.pattern.areas
    shown = np.argsort(-(area @ field.shares), kind="stable")
    for order, family in enumerate(shown):
        colour = FAMILIES[order % len(FAMILIES)]
        axes.add_collection(_marks(field, int(family), colour, places), autolim=False)
        if order < len(FAMILIES):
            share = float(area @ field.shares[:, family]) / float(area.sum())
            words = f"— {100 * share:.1f} % of the area"
            figure.text(0.02 + 0.20 * order, 0.03, words, color=colour)
    draw_panels(figure, (0.51, 0.10, 0.47, 0.79), pattern, regions)
    if float(area.sum()) < WHOLE * float(pattern.areas.sum()):
        figure.text(0.98, 0.03, "left: the part that is designed", color=style.SOFT, ha="right")


def _marks(field: LineField, family: int, colour: str, places: Sequence[Affine]) -> LineCollection:
    """Return the marks of one family, in mm."""
    pattern, shares = field.pattern, field.shares[:, family]
    angles = field.angles[:, family]
    most = max(float(field.shares.max()), 1e-12)
    half = MARK / 2 * np.sqrt(2 * pattern.areas.mean() * shares / most)
    along = half[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _strokes(pattern, along, colour, 0.9, places)


def draw_wrinkles(figure: Figure, pattern: Pattern, field: WrinkleField) -> None:
    """Draw wrinkles on the flat panels.

    The colour is the state of each triangle; strokes have the direction of the tension, along which
    wrinkles run.
    """
    style.write_title(figure, "Wrinkles run along the strokes, the direction of tension")
    axes, places = draw_panels(figure, PANELS_BOX, pattern, None)
    colours = np.array([STATES[state] for state in Tension])[field.state]
    _fill_cells(axes, pattern, places, colours)
    length = np.sqrt(2 * pattern.areas)
    along = 0.3 * length[:, None] * field.flat
    axes.add_collection(_strokes(pattern, along, style.INK, 0.7, places), autolim=False)
    for k, state in enumerate(Tension):
        height = 0.85 - 0.06 * k
        figure.text(0.71, height, "■", color=STATES[state], fontsize=14, va="center")
        share = field.share(state, pattern.areas)
        figure.text(0.74, height, f"{state.name.lower()} {share:.0%}", va="center")


def _fill_cells(
    axes: Axes, pattern: Pattern, places: Sequence[Affine], colours: npt.NDArray[Any]
) -> None:
    corners = list(1e3 * _placed(pattern, pattern.corners, places))
    cells = PolyCollection(corners, facecolors=colours, edgecolors="face", lw=0.2)
    axes.add_collection(cells, autolim=False)


def _strokes(
    pattern: Pattern, along: Floats, colour: str, width: float, places: Sequence[Affine]
) -> LineCollection:
    """Return strokes through the centroids, in mm, by half of each, (t, 2), in m; none of 0."""
    ends = np.stack([pattern.centroids - along, pattern.centroids + along], axis=1)
    ends = _placed(pattern, ends, places)
    return LineCollection(list(1e3 * ends[along.any(axis=1)]), colors=colour, lw=width)


def _placed(pattern: Pattern, points: Floats, places: Sequence[Affine]) -> Floats:
    """Return points of each triangle, (t, k, 2), at the places of their panels."""
    placed = np.array(points)
    for panel, place in enumerate(places):
        here = pattern.panel == panel
        placed[here] = place.points(placed[here])
    return placed


def draw_unwrapped(figure: Figure, unwrapped: Unwrapped) -> None:
    """Draw the surface from two sides, with its seams, and of the flat panels.

    The colour is the area on the surface over the flat area: orange panels have to be stretched.
    """
    pattern, ratio = unwrapped.pattern, unwrapped.distortion.area_ratio
    reach = max(LEAST_RANGE, float(np.abs(ratio - 1).max()))
    scale = ScalarMappable(Normalize(1 - reach, 1 + reach), SIGNED)
    colours = scale.to_rgba(ratio)[:, :3]
    distortion, count = unwrapped.distortion, len(pattern.panel_names)
    write_title(
        figure,
        f"{count} flat panels: stretch {100 * distortion.worst_stretch:.1f} % at worst, "
        f"{100 * distortion.mean_stretch:.1f} % on average",
    )
    closed = len(pattern.free_edges) == 0
    surface = DrawnSurface(pattern.triangles, pattern.points, colours, contrast=0.6, closed=closed)
    for k, view in enumerate(VIEWS):
        box = (0.01, 0.46 - 0.44 * k, 0.34, 0.43)
        stage = Axonometry(figure, box, view, pattern.points)
        _draw_seams(stage, unwrapped, stage.draw([surface]))
    axes = figure.add_axes((0.37, 0.14, 0.61, 0.75))
    axes.set_axis_off()
    corners = list(1e3 * pattern.corners)
    axes.add_collection(PolyCollection(corners, facecolors=colours, edgecolors="face", lw=0.3))
    for panel, name in enumerate(pattern.panel_names):
        outline = pattern.outline(panel)
        axes.plot(*(1e3 * np.asarray(outline.exterior.coords).T), color=INK, lw=1)
        middle = 1e3 * np.asarray(outline.point_on_surface().coords)[0]
        left, low, high, top = outline.bounds
        upright = 90 if top - low > NARROW * (high - left) else 0
        axes.annotate(name, tuple(middle), ha="center", va="center", fontsize=8, rotation=upright)
    axes.set_aspect("equal")
    axes.autoscale_view()
    bar_below(axes)
    bar = figure.colorbar(
        scale, cax=figure.add_axes((0.45, 0.09, 0.45, 0.025)), orientation="horizontal"
    )
    bar.set_label("area on the surface / flat area")


def _draw_seams(stage: Axonometry, unwrapped: Unwrapped, image: Image) -> None:
    """Draw the seams and free edges that are seen."""
    pattern = unwrapped.pattern
    ends = pattern.points[np.concatenate([unwrapped.seams, pattern.free_edges])]
    seen = [visible(ends[:, k], stage.view, image, stage.size) for k in (0, 1)]
    shown: Floats = 1e3 * stage.view.project(ends[seen[0] & seen[1]])
    gap = np.full((len(shown), 1, 2), np.nan)
    line = np.concatenate([shown, gap], axis=1).reshape(-1, 2)
    stage.axes.plot(*line.T, color=INK, lw=1.2)
