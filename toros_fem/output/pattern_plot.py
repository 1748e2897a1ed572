"""Pictures of flat panels: the print, the places where it cannot be made, several variants."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
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
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats
from toros_fem.fabrication.contours import panel_outline
from toros_fem.fabrication.printability import Printability, PrintLimits
from toros_fem.fabrication.widths import LocalWidth
from toros_fem.meshes.arrange import panel_offsets
from toros_fem.meshes.pattern import Pattern
from toros_fem.output.drawing import DPI, FABRIC, PRINTED, fill

ISLAND, NARROW_LINE, NARROW_GAP, HOLE = "#d1242f", "#e0148c", "#0a7fc2", "#2c8f35"
# Largest number of labels of a kind.
LABELS = 12
# Gap between panels that are packed here, as a fraction of the skin's size.
GAP = 0.1


def plot_pattern(path: Path, pattern: Pattern, regions: Sequence[BaseGeometry]) -> None:
    """Write a picture of the flat panels with their print, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
    """
    figure, axes = plt.subplots(layout="constrained")
    draw_panels(axes, pattern, regions)
    _fit(figure, axes, 9.0, 1.2)
    axes.set_title("flat pattern: fabric (light), printed reinforcement (dark)", pad=18)
    figure.savefig(path, dpi=DPI)
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
    are outlined. Where labels overlap, only the first is written.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        printability: Measured widths, islands and holes.
        limits: Bounds for narrow lines, narrow gaps and small holes.
    """
    figure, axes = plt.subplots(layout="constrained")
    offsets = draw_panels(axes, pattern, regions)
    _fit(figure, axes, 10.0, 2.0)
    islands = printability.free_islands
    holes = [hole for hole in printability.holes if hole.area < limits.hole_area]
    labels = []
    for island in islands:
        shape = translate(island.polygon, *offsets[island.panel])
        fill(axes, shape, np.array(to_rgb(ISLAND)), edge=ISLAND)
        middle = 1e3 * shapely.get_coordinates(shape.point_on_surface())[0]
        labels.append((f"{1e6 * island.area:.2g} mm²", middle, ISLAND))
    for hole in holes:
        ring = translate(hole.polygon.exterior, *offsets[hole.panel])
        axes.plot(*(1e3 * shapely.get_coordinates(ring).T), color=HOLE, lw=2)
        middle = 1e3 * shapely.get_coordinates(ring.centroid).T
        axes.plot(*middle, "s", ms=13, mfc="none", mec=HOLE, mew=2)
    handles: list[Artist] = [
        Patch(color=PRINTED, label=f"printed: {printability.number_of_pieces} pieces"),
        Patch(color=ISLAND, label=f"free islands: {len(islands)}"),
    ]
    lines, gaps = printability.narrow_lines, printability.narrow_gaps
    for smallest, narrow, limit, colour, kind in (
        (printability.smallest_width, lines, limits.width, NARROW_LINE, "lines"),
        (printability.smallest_gap, gaps, limits.gap, NARROW_GAP, "gaps"),
    ):
        marked = narrow or ((smallest,) if smallest else ())
        for place in reversed(marked):  # the thinnest on top
            _mark(axes, place, offsets[place.panel], colour)
        for place in marked[:LABELS]:
            at = 1e3 * (np.array(place.centre) + offsets[place.panel])
            labels.append((f"{1e3 * place.width:.2f} mm", at, colour))
        thinnest = f"{1e3 * smallest.width:.2f} mm" if smallest else "none"
        text = f"{kind} under {1e3 * limit:.2g} mm: {len(narrow)}; thinnest {thinnest}"
        handles.append(Line2D([], [], color=colour, marker="o", ms=10, mfc="none", label=text))
    text = (
        f"holes under {1e6 * limits.hole_area:.2g} mm²: {len(holes)} of {len(printability.holes)}"
    )
    handles.append(Line2D([], [], color=HOLE, marker="s", ms=10, mfc="none", label=text))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    count = len(islands) + len(lines) + len(gaps) + len(holes)
    verdict = f"{count} places to correct" if count else "nothing to correct"
    figure.draw_without_rendering()  # lays the axes out
    _write_labels(axes, labels)
    figure.suptitle(f"printing the flat pattern: {verdict}", fontsize=14)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def draw_panels(axes: Axes, pattern: Pattern, regions: Sequence[BaseGeometry]) -> list[Floats]:
    """Draw the panels at their places; return the offset of each in m."""
    offsets = panel_offsets(pattern, GAP * pattern.size)
    for panel, (offset, region) in enumerate(zip(offsets, regions, strict=True)):
        outline = translate(panel_outline(pattern, panel), *offset)
        fill(axes, outline, FABRIC, edge="0.25")
        fill(axes, translate(region, *offset), PRINTED)
        left, _, right, top = np.array(outline.bounds) * 1e3
        label = pattern.panel_names[panel]
        axes.annotate(label, ((left + right) / 2, top), (0, 4), ha="center",
                      textcoords="offset points")  # fmt: skip
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("mm")
    axes.set_ylabel("mm")
    axes.spines[["top", "right"]].set_visible(False)
    return offsets


def _fit(figure: Figure, axes: Axes, size: float, extra: float) -> None:
    """Set the size of a figure in inches, from the panels' and extra height for titles."""
    extent = np.array([axes.dataLim.width, axes.dataLim.height])
    width, height = size * extent / extent.max()
    figure.set_size_inches(max(width, size / 2) + 1.0, height + extra)


def _mark(axes: Axes, place: LocalWidth, offset: Floats, colour: str) -> None:
    ends = 1e3 * (np.array(place.ends) + offset)
    middle = ends.mean(axis=0)
    axes.plot(*ends.T, color=colour, lw=1.5, solid_capstyle="butt")
    axes.plot(*middle, "o", ms=14, mfc="none", mec="white", mew=3.5)
    axes.plot(*middle, "o", ms=14, mfc="none", mec=colour, mew=1.8)


def _write_labels(axes: Axes, labels: Sequence[tuple[str, Floats, str]]) -> None:
    """Write each (text, point, colour) beside its point, unless it would cover another label."""
    written: list[Bbox] = []
    for text, at, colour in labels:
        for right, up in product((10, -10), (5, -13)):
            label = axes.annotate(
                text,
                (at[0], at[1]),
                (right, up),
                textcoords="offset points",
                ha="left" if right > 0 else "right",
                color=colour,
                fontweight="bold",
                zorder=5,
                path_effects=[withStroke(linewidth=3, foreground="white")],
            )
            box = label.get_window_extent()
            if not any(box.overlaps(other) for other in written):
                written.append(box)
                break
            label.remove()


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
    outline = panel_outline(pattern, pattern.panel_index(panel))
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
