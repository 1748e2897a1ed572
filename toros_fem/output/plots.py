"""Pictures: the flat pattern and its flaws, the skin beside its target, the convergence."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats, Ints
from toros_fem.design.options import Iteration
from toros_fem.fabrication.contours import layout, panel_outline
from toros_fem.fabrication.printability import Printability, PrintLimits
from toros_fem.fabrication.widths import Place
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.metrics import Metric

FABRIC = np.array([0.93, 0.86, 0.72])
PRINTED = np.array([0.13, 0.20, 0.33])
TARGET = np.array([0.62, 0.76, 0.62])
LIGHT = np.array([-0.35, 0.45, 0.82])
ISLAND, NARROW, TIGHT, HOLE = "#d1242f", "#e0148c", "#0a7fc2", "#2c8f35"
LABELS = 12
DPI = 150
# Height over width from which on all views of a shape stand in one row.
SLENDER = 2.0


def plot_pattern(path: Path, pattern: Pattern, regions: Sequence[BaseGeometry]) -> None:
    """Picture of the flat panels with their reinforcement, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: What is printed on each panel, in m.
    """
    figure, axes = plt.subplots(figsize=(9, 9), layout="constrained")
    _panels(axes, pattern, regions)
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
    """Picture of the flat panels that marks what a printer would stumble over, in mm.

    Free islands are red, with their area; narrow lines and gaps are circled, the thinnest with
    their width, as is the thinnest of all even if it keeps the limit; small holes are outlined.
    Where labels would cover one another only the first is written.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        regions: What is printed on each panel, in m.
        printability: What was measured on them.
        limits: What counts as narrow or small.
    """
    figure, axes = plt.subplots(figsize=(11, 11), layout="constrained")
    offsets = _panels(axes, pattern, regions)
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
        Patch(color=PRINTED, label=f"printed: {printability.pieces} pieces"),
        Patch(color=ISLAND, label=f"free islands: {len(islands)}"),
    ]
    for smallest, under, limit, colour, what in (
        (printability.smallest_width, printability.narrow, limits.width, NARROW, "lines"),
        (printability.smallest_gap, printability.tight, limits.gap, TIGHT, "gaps"),
    ):
        marked = under or ((smallest,) if smallest else ())
        for place in reversed(marked):  # the thinnest on top
            _mark(axes, place, offsets[place.panel], colour)
        for place in marked[:LABELS]:
            at = 1e3 * (np.array(place.middle) + offsets[place.panel])
            labels.append((f"{1e3 * place.width:.2f} mm", at, colour))
        thinnest = f"{1e3 * smallest.width:.2f} mm" if smallest else "none"
        text = f"{what} under {1e3 * limit:.2g} mm: {len(under)}; thinnest {thinnest}"
        handles.append(Line2D([], [], color=colour, marker="o", ms=10, mfc="none", label=text))
    text = (
        f"holes under {1e6 * limits.hole_area:.2g} mm²: {len(holes)} of {len(printability.holes)}"
    )
    handles.append(Line2D([], [], color=HOLE, marker="s", ms=10, mfc="none", label=text))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    found = len(islands) + len(printability.narrow) + len(printability.tight) + len(holes)
    verdict = f"{found} places to mend" if found else "nothing to mend"
    figure.draw_without_rendering()  # lays the axes out
    _write_labels(axes, labels)
    figure.suptitle(f"printing the flat pattern: {verdict}", fontsize=14)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _panels(axes: Axes, pattern: Pattern, regions: Sequence[BaseGeometry]) -> list[Floats]:
    """Draw the panels in a row; returns the offset of each in m."""
    offsets = layout(pattern, 0.1 * pattern.size)
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


def _mark(axes: Axes, place: Place, offset: Floats, colour: str) -> None:
    ends = 1e3 * (np.array(place.ends) + offset)
    middle = ends.mean(axis=0)
    axes.plot(*ends.T, color=colour, lw=1.5, solid_capstyle="butt")
    axes.plot(*middle, "o", ms=14, mfc="none", mec="white", mew=3.5)
    axes.plot(*middle, "o", ms=14, mfc="none", mec=colour, mew=1.8)


def _write_labels(axes: Axes, labels: Sequence[tuple[str, Floats, str]]) -> None:
    """Write (text, point, colour) beside the points wherever a label covers no other one."""
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


def plot_shape(
    path: Path, pattern: Pattern, positions: Floats, target: Floats, density: Floats, title: str
) -> None:
    """Picture of the inflated skin beside its target, from two directions, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        positions, target: Positions of all assembled vertices, (n, 3), in m.
        density: Density of all triangles to colour by, (t,), 1 for reinforced.
        title: What to write above.
    """
    mix = density[:, None]
    skin = (1 - mix) * FABRIC + mix * PRINTED
    plain = np.broadcast_to(TARGET, skin.shape)
    views = {"side": (0.0, 0.0), "oblique": (25.0, 35.0)}
    both = np.concatenate([positions, target])
    shares = []
    for angles in views.values():
        right, up, _ = camera(*angles)
        shares.append(np.ptp(both @ up) / np.ptp(both @ right))
    slender = min(shares) > SLENDER
    across, down = (4, 1) if slender else (2, 2)
    tall = max(shares) if slender else sum(shares)
    width = min(5.2, (9 if slender else 14) / tall)
    figure, axes = plt.subplots(
        down,
        across,
        figsize=(across * (width + 0.9) + 0.5, width * tall + 1.2 * down),
        sharex="row",
        sharey="row",
        squeeze=False,
        height_ratios=None if slender else shares,
        layout="constrained",
    )
    pairs = axes.reshape(2, 2)
    for row, (name, angles) in zip(pairs, views.items(), strict=True):
        for axis, points, colours, what in zip(
            row, (target, positions), (plain, skin), ("target", "inflated"), strict=True
        ):
            draw_skin(axis, pattern.triangles, points, colours, *angles)
            axis.set_title(f"{what}, {name}", fontsize=9)
            axis.set_aspect("equal")
            axis.autoscale_view()
            axis.set_xlabel("mm")
    figure.suptitle(title)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_convergence(
    path: Path,
    history: Sequence[Iteration],
    metrics: Sequence[Metric],
) -> None:
    """Picture of objective, figures and grey level over the iterations.

    Args:
        path: PNG file to write.
        history: Rows of the design loop.
        metrics: Numbers that the design is judged by.
    """
    count = [row.iteration for row in history]
    rows = 2 + len(metrics)
    figure, (top, *middle, bottom) = plt.subplots(
        rows, 1, figsize=(8, 2 + 2 * rows), sharex=True, layout="constrained"
    )
    top.semilogy(count, [row.objective for row in history], color=PRINTED)
    top.set_ylabel("objective T")
    for axis, of in zip(middle, metrics, strict=True):
        axis.plot(count, [row.metrics[of.key] for row in history], color=PRINTED)
        axis.axhline(of.target, color="0.6", linestyle="--", label="target")
        axis.set_ylabel(of.label)
        axis.legend(frameon=False)
    bottom.plot(count, [row.volume_fraction for row in history], label="volume fraction")
    bottom.plot(count, [row.grey_level for row in history], label="grey level")
    bottom.set_ylim(0, 1)
    bottom.legend(frameon=False)
    bottom.set_xlabel("iteration")
    for axis in (top, *middle, bottom):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def camera(elevation: float, turn: float) -> tuple[Floats, Floats, Floats]:
    """Directions right, up and away from the viewer, who looks along +y turned by degrees."""
    e, t = np.radians([elevation, turn])
    right = np.array([np.cos(t), np.sin(t), 0])
    away = np.array([-np.sin(t) * np.cos(e), np.cos(t) * np.cos(e), -np.sin(e)])
    return right, np.cross(right, away), away


def draw_skin(
    axis: Axes, triangles: Ints, points: Floats, colours: Floats, elevation: float, turn: float
) -> None:
    """Shaded triangles seen from −y (turned by angles in degrees), painted back to front."""
    right, up, away = camera(elevation, turn)
    corner = points[triangles] * 1e3
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    light = LIGHT / np.linalg.norm(LIGHT)
    toward = normal @ (light[0] * right + light[1] * up - light[2] * away)
    shade = 0.45 + 0.55 * np.clip(toward, 0, 1)
    faces = np.clip(colours * shade[:, None], 0, 1)
    seen = np.flatnonzero(normal @ away < 0)  # the outside of a closed skin hides its inside
    order = seen[np.argsort(-(corner[seen].mean(axis=1) @ away))]
    flat = np.stack([corner[order] @ right, corner[order] @ up], axis=2)
    axis.add_collection(
        PolyCollection(list(flat), facecolors=faces[order], edgecolors=faces[order], lw=0.3)
    )


def fill(axes: Axes, shape: BaseGeometry, colour: Floats, edge: str = "none") -> None:
    """Fill a region given in m on axes in mm."""
    for polygon in shapely.get_parts(shape):
        rings = [shapely.get_coordinates(r) * 1e3 for r in (polygon.exterior, *polygon.interiors)]
        codes = [
            [Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY]
            for ring in rings
        ]
        outline = Outline(np.concatenate(rings), np.concatenate(codes))
        axes.add_patch(PathPatch(outline, facecolor=colour, edgecolor=edge, lw=0.8))
