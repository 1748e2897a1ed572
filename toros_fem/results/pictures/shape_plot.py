"""Pictures of skins in space: beside their target, and in several states."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.panels import CutTriangles, cut_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.drawing import DPI, FABRIC, PRINTED, TARGET, View, draw_skin

SIDE = View()
OBLIQUE = View(25.0, 35.0)
BEHIND = View(0.0, 180.0)
BELOW = tuple(View(-35.0, float(turn)) for turn in range(0, 360, 45))
# From this height over width on, all views of a shape stand in one row.
SLENDER = 2.0
# Largest width and height in inches of all axes together: of shapes in one row, in two, of states.
ROW, TWO_ROWS, STATES = (15.0, 10.0), (11.5, 10.0), (16.0, 10.0)
# Largest size of a shape, and least distance of two marks on an axis, in inches.
LARGEST, TICKS = 9.0, 0.6
# Empty border of axes, over the size of what they show.
MARGIN = 0.03


def plot_shape(
    path: Path,
    pattern: Pattern,
    positions: Floats,
    target: Floats | None,
    regions: Sequence[BaseGeometry],
    title: str,
) -> None:
    """Write a picture of the inflated skin beside its target, in the same scale, in mm.

    The inflated skin is seen from three directions. The last one is from behind if the skin is slim
    and upright, else from below.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        positions: Positions of all assembled vertices, (n, 3), in m.
        target: Target positions, (n, 3), in m; None shows the inflated skin alone.
        regions: Print on each panel, polygons in m.
        title: Text above.
    """
    printed, count = cut_triangles(pattern, regions), len(pattern.triangles)
    both = positions if target is None else np.concatenate([positions, target])
    slender = min(_height_over_width(both, view) for view in (SIDE, OBLIQUE)) > SLENDER
    last = BEHIND if slender else _towards_print(pattern, positions, printed)
    # The target and the skin beside it are in one frame.
    shown: list[tuple[str, Floats, CutTriangles | None, View, Floats]] = [
        (f"inflated, {name}", positions, printed, view, both if view == SIDE else positions)
        for name, view in (("side", SIDE), ("oblique", OBLIQUE), (_name(last), last))
    ]
    if target is not None:
        shown.insert(0, ("target, side", target, None, SIDE, both))
    across = len(shown) if slender or target is None else 2
    figure, grid = _grid(
        [view.project(framed) for *_, view, framed in shown],
        across,
        TWO_ROWS if across == 2 else ROW,
    )
    for axes, (name, points, ink, view, _) in zip(grid, shown, strict=True):
        axes.set_title(name, fontsize=10)
        colours = np.tile(TARGET if points is target else FABRIC, (count, 1))
        draw_skin(axes, pattern.triangles, points, colours, view, ink)
    figure.suptitle(title)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def plot_shapes(
    path: Path,
    triangles: Ints,
    shapes: Sequence[tuple[str, Floats]],
    density: Floats,
    view: tuple[float, float] = (0.0, 0.0),
    columns: int = 6,
    printed: CutTriangles | None = None,
) -> None:
    """Write a picture of one skin in several states, in the same scale, in mm.

    Args:
        path: PNG file to write.
        triangles: Vertices of each triangle, (t, 3).
        shapes: For each state its title and the positions of all vertices, (n, 3), in m.
        density: Density of all triangles to colour by, (t,), or that of each state, (states, t);
            1 for reinforced, NaN for other bodies.
        view: Elevation and turn of the viewer in degrees, as of `View`.
        columns: Largest number of states side by side.
        printed: Print that is drawn on top, with its own borders; None for none.
    """
    seen = View(*view)
    every = seen.project(np.concatenate([positions for _, positions in shapes]))
    figure, grid = _grid([every] * len(shapes), min(columns, len(shapes)), STATES)
    densities = np.broadcast_to(density, (len(shapes), len(triangles)))
    for axes, (title, positions), own in zip(grid, shapes, densities, strict=True):
        axes.set_title(title, fontsize=10)
        draw_skin(axes, triangles, positions, _colours(own), seen, printed)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def _grid(
    framed: Sequence[Floats], across: int, page: tuple[float, float]
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes in mm that have one scale, as large as the page allows.

    Args:
        framed: For each of the axes the points on the picture that it must show, (n, 2), in m.
        across: Number of axes side by side.
        page: Largest width and height in inches of all axes together.
    """
    low = 1e3 * np.array([points.min(axis=0) for points in framed])
    high = 1e3 * np.array([points.max(axis=0) for points in framed])
    margin = MARGIN * float((high - low).max())
    middle, size = (low + high) / 2, high - low + 2 * margin
    column, row = np.arange(len(framed)) % across, np.arange(len(framed)) // across
    widths = np.array([size[column == k, 0].max() for k in range(across)])
    heights = np.array([size[row == k, 1].max() for k in range(row[-1] + 1)])
    scale = min(page[0] / widths.sum(), page[1] / heights.sum(), LARGEST / float(size.max()))
    figure = plt.figure(
        figsize=(
            scale * widths.sum() + 0.5 * across + 0.3,
            scale * heights.sum() + 0.7 * len(heights) + 0.5,
        ),
        layout="constrained",
    )
    spec = figure.add_gridspec(len(heights), across, width_ratios=widths, height_ratios=heights)
    grid = []
    for k, (i, j) in enumerate(zip(row, column, strict=True)):
        axes = figure.add_subplot(spec[i, j])
        limits = middle[k] + np.outer([-0.5, 0.5], [widths[j], heights[i]])
        axes.set(xlim=limits[:, 0], ylim=limits[:, 1], aspect="equal")
        axes.set_xlabel("mm" if i == row[-1] else "")
        axes.spines[["top", "right"]].set_visible(False)
        axes.xaxis.set_major_locator(MaxNLocator(max(2, int(scale * widths[j] / TICKS))))
        grid.append(axes)
    return figure, grid


def _towards_print(pattern: Pattern, positions: Floats, printed: CutTriangles) -> View:
    """Return the view from below that shows the most of the print that the other views hide.

    That a part of the skin may hide another is not considered.
    """
    a, b, c = np.moveaxis(positions[pattern.triangles], 1, 0)
    areas = np.bincount(printed.cell, printed.inside * printed.areas, minlength=len(a))
    normals = np.cross(b - a, c - a) / 2 * (areas / pattern.areas)[:, None]

    def seen(view: View) -> Floats:
        return np.maximum(normals @ view.directions[2], 0)

    before = np.maximum(seen(SIDE), seen(OBLIQUE))

    def added(view: View) -> float:
        return float(np.maximum(seen(view) - before, 0).sum())

    return max(BELOW, key=added)


def _name(view: View) -> str:
    """Return the words for a view in a title."""
    return "from behind" if view == BEHIND else f"from below, turned by {view.turn:g}°"


def _height_over_width(points: Floats, view: View) -> float:
    width, height = np.ptp(view.project(points), axis=0)
    return float(height / width)


def _colours(density: Floats) -> Floats:
    """Return the colour of each triangle, (t, 3)."""
    mix = np.nan_to_num(density)[:, None]
    colours = (1 - mix) * FABRIC + mix * PRINTED
    colours[np.isnan(density)] = TARGET
    return np.asarray(colours)
