"""Pictures of skins in space: beside their target, and in several states."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from toros_fem._types import Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.output.drawing import DPI, FABRIC, PRINTED, TARGET, View, draw_skin, frame

SIDE = View()
OBLIQUE = View(25.0, 35.0)
# From this height over width on, all views of a shape stand in one row.
SLENDER = 2.0


def plot_shape(
    path: Path,
    pattern: Pattern,
    positions: Floats,
    target: Floats | None,
    density: Floats,
    title: str,
) -> None:
    """Write a picture of the inflated skin beside its target, from two directions, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        positions: Positions of all assembled vertices, (n, 3), in m.
        target: Target positions, (n, 3), in m; None shows the inflated skin alone.
        density: Density of all triangles to colour by, (t,), 1 for reinforced.
        title: Text above.
    """
    shapes = [("inflated", positions, density)]
    if target is not None:
        shapes.insert(0, ("target", target, np.full_like(density, np.nan)))
    every = np.concatenate([points for _, points, _ in shapes])
    ratios = [_height_over_width(every, view) for view in (SIDE, OBLIQUE)]
    slender = min(ratios) > SLENDER
    count = len(shapes)
    across, down = (2 * count, 1) if slender else (count, 2)
    tall = max(ratios) if slender else sum(ratios)
    width = min(5.2, (9 if slender else 14) / tall)
    figure, grid = plt.subplots(
        down,
        across,
        figsize=(across * (width + 0.9) + 0.5, width * tall + 1.2 * down),
        sharex="row",
        sharey="row",
        squeeze=False,
        height_ratios=None if slender else ratios,
        layout="constrained",
    )
    pictures = []
    for row, (name, view) in zip(
        grid.reshape(2, count), (("side", SIDE), ("oblique", OBLIQUE)), strict=True
    ):
        for axes, (kind, points, values) in zip(row, shapes, strict=True):
            frame(axes, every, view)
            axes.set_title(f"{kind}, {name}", fontsize=9)
            axes.set_xlabel("mm")
            pictures.append((axes, points, values, view))
    figure.suptitle(title)
    figure.draw_without_rendering()  # lays the axes out
    for axes, points, values, view in pictures:
        draw_skin(axes, pattern.triangles, points, _colours(values), view)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_shapes(
    path: Path,
    triangles: Ints,
    shapes: Sequence[tuple[str, Floats]],
    density: Floats,
    view: tuple[float, float] = (0.0, 0.0),
    columns: int = 6,
) -> None:
    """Write a picture of one skin in several states, in the same scale, in mm.

    Args:
        path: PNG file to write.
        triangles: Vertices of each triangle, (t, 3).
        shapes: For each state its title and the positions of all vertices, (n, 3), in m.
        density: Density of all triangles to colour by, (t,), 1 for reinforced; NaN for other
            bodies.
        view: Elevation and turn of the viewer in degrees, as of `View`.
        columns: Largest number of states side by side.
    """
    seen = View(*view)
    every = np.concatenate([positions for _, positions in shapes])
    ratio = _height_over_width(every, seen)
    across = min(columns, len(shapes))
    down = -(-len(shapes) // across)
    width = min(4.5, 16 / across, 7 / ratio)
    figure, grid = plt.subplots(
        down,
        across,
        figsize=((width + 0.4) * across + 0.6, (width * ratio + 0.9) * down + 0.3),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axes in grid.ravel()[len(shapes) :]:
        axes.set_axis_off()
    for axes, (title, _) in zip(grid.ravel(), shapes, strict=False):
        frame(axes, every, seen)
        axes.set_title(title)
    for axes in grid[-1]:
        axes.set_xlabel("mm")
    figure.draw_without_rendering()  # lays the axes out
    for axes, (_, positions) in zip(grid.ravel(), shapes, strict=False):
        draw_skin(axes, triangles, positions, _colours(density), seen)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _height_over_width(points: Floats, view: View) -> float:
    width, height = np.ptp(view.project(points), axis=0)
    return float(height / width)


def _colours(density: Floats) -> Floats:
    """Return the colour of each triangle, (t, 3)."""
    mix = np.nan_to_num(density)[:, None]
    colours = (1 - mix) * FABRIC + mix * PRINTED
    colours[np.isnan(density)] = TARGET
    return np.asarray(colours)
