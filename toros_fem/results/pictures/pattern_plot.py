"""Pictures of flat panels: the print, the places where it cannot be made, several variants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.print.islands import PrintedPiece
from toros_fem.making.print.printability import Printability, PrintLimits
from toros_fem.making.print.widths import LocalWidth
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.panels import panel_places
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.drawing import DPI, FABRIC, PRINTED, fill
from toros_fem.results.pictures.labels import Label, groups, write_labels

ISLAND, NARROW_LINE, NARROW_GAP, HOLE = "#d1242f", "#e0148c", "#0a7fc2", "#2c8f35"
# Largest number of labels of a kind.
LABELS = 24
# Gap between panels that are packed here, as a fraction of the skin's size.
GAP = 0.1
# Largest width and height of the panels in inches.
PAGE = (13.0, 6.5)


def plot_pattern(path: Path, pattern: Pattern, regions: Sequence[BaseGeometry]) -> None:
    """Write a picture of the flat panels with their print, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
    """
    figure, axes = plt.subplots(layout="constrained")
    draw_panels(axes, pattern, regions)
    _fit(figure, axes, 1.2)
    axes.set_title("flat pattern: fabric (light), printed reinforcement (dark)", pad=18)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def plot_printability(
    path: Path,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    printability: Printability,
    limits: PrintLimits,
) -> None:
    """Write a picture of the flat panels that marks all places that cannot be printed, in mm.

    Free islands are red, with their area. Narrow lines and gaps are circled, and the thinnest are
    labelled with their width. The thinnest of all is marked even if it keeps the limit. Small holes
    are outlined. Places that are close share a label. What finds no room is left out; the legend
    says how many places have no label.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        printability: Measured widths, islands and holes.
        limits: Bounds for narrow lines, narrow gaps and small holes.
    """
    figure, axes = plt.subplots(layout="constrained")
    places = draw_panels(axes, pattern, regions)
    _fit(figure, axes, 2.0)
    islands = printability.free_islands
    holes = [hole for hole in printability.holes if hole.area < limits.hole_area]
    marks: list[Floats] = []
    for island in islands:
        fill(axes, places[island.panel].region(island.polygon), np.array(to_rgb(ISLAND)), ISLAND)
    for hole in holes:
        ring = places[hole.panel].region(hole.polygon.exterior)
        axes.plot(*(1e3 * shapely.get_coordinates(ring).T), color=HOLE, lw=2)
        marks.append(1e3 * shapely.get_coordinates(ring.centroid)[0])
        axes.plot(*marks[-1], "s", ms=13, mfc="none", mec=HOLE, mew=2)
    handles: list[Artist] = [
        Patch(color=PRINTED, label=f"printed: {printability.number_of_pieces} pieces"),
        Patch(color=ISLAND, label=f"free islands: {len(islands)}"),
    ]
    lines, gaps = printability.narrow_lines, printability.narrow_gaps
    circled: list[tuple[Floats, Sequence[LocalWidth], str]] = []
    for smallest, narrow, limit, colour, kind in (
        (printability.smallest_width, lines, limits.width, NARROW_LINE, "lines"),
        (printability.smallest_gap, gaps, limits.gap, NARROW_GAP, "gaps"),
    ):
        marked = narrow or ((smallest,) if smallest else ())
        for place in reversed(marked):  # the thinnest on top
            _mark(axes, place, places[place.panel], colour)
        if marked:
            middles = [places[place.panel].points(np.array(place.centre)) for place in marked]
            circled.append((1e3 * np.array(middles), marked, colour))
            marks.extend(circled[-1][0])
        thinnest = f"{1e3 * smallest.width:.2f} mm" if smallest else "none"
        text = f"{kind} under {1e3 * limit:.2g} mm: {len(narrow)}; thinnest {thinnest}"
        handles.append(Line2D([], [], color=colour, marker="o", ms=10, mfc="none", label=text))
    text = (
        f"holes under {1e6 * limits.hole_area:.2g} mm²: {len(holes)} of {len(printability.holes)}"
    )
    handles.append(Line2D([], [], color=HOLE, marker="s", ms=10, mfc="none", label=text))
    handles.append(Line2D([], [], ls="none", label="places without a label: 0"))
    legend = figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    count = len(islands) + len(lines) + len(gaps) + len(holes)
    found = {0: "nothing to correct", 1: "1 place to correct"}.get(
        count, f"{count} places to correct"
    )
    figure.suptitle(f"printing the flat pattern: {found}", fontsize=14)
    figure.draw_without_rendering()  # lays the axes out
    figure.set_layout_engine("none")
    labels = [_island_label(island, places[island.panel]) for island in islands]
    for at, narrow_places, colour in circled:
        labels += _width_labels(axes, at, [place.width for place in narrow_places], colour)
    left_out = write_labels(axes, labels, np.reshape(marks, (-1, 2)))
    left_out += len(islands) + sum(len(marked) for _, marked, _ in circled)
    left_out -= sum(labelabel.places for labelabel in labels)
    legend.get_texts()[-1].set_text(f"places without a label: {left_out}")
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def draw_panels(
    axes: Axes,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    page: tuple[float, float] = PAGE,
) -> list[Affine]:
    """Draw the panels in mm where they fill a page best; return the place of each.

    Args:
        axes: The axes.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        page: Width and height that the axes will have, in any unit.
    """
    places = panel_places(pattern, GAP * pattern.size, page)
    for panel, (place, region) in enumerate(zip(places, regions, strict=True)):
        outline = place.region(pattern.outline(panel))
        fill(axes, outline, FABRIC, edge="0.25")
        fill(axes, place.region(region), PRINTED)
        left, _, right, top = np.array(outline.bounds) * 1e3
        label = pattern.panel_names[panel]
        axes.annotate(label, ((left + right) / 2, top), (0, 4), ha="center",
                      textcoords="offset points")  # fmt: skip
    axes.set_aspect("equal")
    axes.margins(0.03)
    axes.autoscale_view()
    axes.set_xlabel("mm")
    axes.set_ylabel("mm")
    axes.spines[["top", "right"]].set_visible(False)
    return places


def _fit(figure: Figure, axes: Axes, extra: float) -> None:
    """Set the size of a figure in inches, from the panels' and extra height for titles."""
    extent = np.array([axes.dataLim.width, axes.dataLim.height])
    width, height = extent * (np.array(PAGE) / extent).min()
    figure.set_size_inches(max(width, PAGE[0] / 2) + 1.0, height + extra)


def _mark(axes: Axes, width: LocalWidth, place: Affine, colour: str) -> None:
    ends = 1e3 * place.points(np.array(width.ends))
    middle = ends.mean(axis=0)
    axes.plot(*ends.T, color=colour, lw=1.5, solid_capstyle="butt")
    axes.plot(*middle, "o", ms=14, mfc="none", mec="white", mew=3.5)
    axes.plot(*middle, "o", ms=14, mfc="none", mec=colour, mew=1.8)


def _island_label(island: PrintedPiece, place: Affine) -> Label:
    """Return the label of an island: its area."""
    middle = place.region(island.polygon).point_on_surface()
    area = float(f"{1e6 * island.area:.2g}")
    return Label(f"{area:g} mm²", 1e3 * shapely.get_coordinates(middle)[0], ISLAND)


def _width_labels(axes: Axes, at: Floats, widths: Sequence[float], colour: str) -> list[Label]:
    """Return the labels of places that are given the thinnest first."""
    labels = []
    for group in groups(axes, at)[:LABELS]:
        text = f"{1e3 * widths[group[0]]:.2f} mm"
        if len(group) > 1:
            text += f", {len(group)} places"
        labels.append(Label(text, at[group[0]], colour, len(group)))
    return labels


def plot_variants(
    path: Path,
    pattern: Pattern,
    panel: str,
    variants: Sequence[tuple[str, BaseGeometry, str]],
) -> None:
    """Write a row of pictures of the print of several variants on one panel, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        panel: Name of the panel to show.
        variants: For each variant its title, its print on that panel, in m, and a caption.
    """
    outline = pattern.outline(pattern.panel_index(panel))
    left, bottom, right, top = outline.bounds
    height = 9.0
    width = height * (right - left) / (top - bottom)
    figure, row = plt.subplots(
        1,
        len(variants),
        figsize=((width + 0.35) * len(variants) + 0.5, height),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axes, (title, region, caption) in zip(row[0], variants, strict=True):
        fill(axes, outline, FABRIC, edge="0.25")
        fill(axes, region, PRINTED)
        axes.set_title(title)
        axes.set_xlabel(caption, linespacing=1.5)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.spines[["top", "right"]].set_visible(False)
    row[0][0].set_ylabel("mm")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
