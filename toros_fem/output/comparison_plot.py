"""Pictures of several designs, or several states of one, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats, Ints
from toros_fem.fabrication.contours import panel_outline
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.metrics import Metric
from toros_fem.output.plots import DPI, FABRIC, PRINTED, TARGET, camera, draw_skin, fill


def plot_variants(
    path: Path,
    pattern: Pattern,
    panel: str,
    variants: Sequence[tuple[str, BaseGeometry, str]],
) -> None:
    """Picture strip of what variants print on one panel, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        panel: Name of the panel to show.
        variants: For each its title, what it prints on that panel, in m, and a caption.
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


def plot_shapes(
    path: Path,
    triangles: Ints,
    shapes: Sequence[tuple[str, Floats]],
    density: Floats,
    view: tuple[float, float] = (0.0, 0.0),
    columns: int = 6,
) -> None:
    """Picture of one skin in several states, in the same scale, in mm.

    Args:
        path: PNG file to write.
        triangles: Vertices of each triangle, (t, 3).
        shapes: For each its title and the positions of all assembled vertices, (n, 3), in m.
        density: Density of all triangles to colour by, (t,), 1 for reinforced; NaN for what is
            not skin.
        view: Elevation and turn of the viewer, who looks along +y at (0, 0), in degrees.
        columns: How many stand side by side at most.
    """
    mix = np.nan_to_num(density)[:, None]
    colours = (1 - mix) * FABRIC + mix * PRINTED
    colours[np.isnan(density)] = TARGET
    right, up, _ = camera(*view)
    every = np.concatenate([positions for _, positions in shapes])
    share = np.ptp(every @ up) / np.ptp(every @ right)
    across = min(columns, len(shapes))
    down = -(-len(shapes) // across)
    width = min(4.5, 16 / across, 7 / share)
    figure, grid = plt.subplots(
        down,
        across,
        figsize=((width + 0.4) * across + 0.6, (width * share + 0.9) * down + 0.3),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axes in grid.ravel()[len(shapes) :]:
        axes.set_axis_off()
    for axes, (title, positions) in zip(grid.ravel(), shapes, strict=False):
        draw_skin(axes, triangles, positions, colours, *view)
        axes.set_title(title)
        axes.set_aspect("equal")
        axes.autoscale_view()
    for axes in grid[-1]:
        axes.set_xlabel("mm")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_tracks(path: Path, feet: Floats, every: int) -> None:
    """Picture of the paths of feet in the x-z plane, in mm.

    Args:
        path: PNG file to write.
        feet: Places, (rows, feet, 3), in m.
        every: Rows between two marks, the phases of the gait.
    """
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    for k in range(feet.shape[1]):
        x, z = 1e3 * feet[:, k, 0], 1e3 * feet[:, k, 2]
        (line,) = axes.plot(x, z, label=f"foot {k}")
        axes.plot(x[::every], z[::every], "o", ms=4, color=line.get_color())
        axes.annotate("start", (x[0], z[0]), (4, 4), textcoords="offset points", fontsize=8)
    axes.set_xlabel("x in mm")
    axes.set_ylabel("height in mm")
    axes.grid(alpha=0.3)
    figure.legend(frameon=False, ncols=feet.shape[1], loc="outside lower center")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_curves(path: Path, rows: Sequence[Mapping[str, float]], metrics: Sequence[Metric]) -> None:
    """Picture of figures over the pressure.

    Args:
        path: PNG file to write.
        rows: Values by key, "pressure_pa" among them.
        figures: What to draw.
    """
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    pressure = [1e-3 * row["pressure_pa"] for row in rows]
    for of in metrics:
        axes.plot(pressure, [row[of.key] for row in rows], ".-", label=of.label)
    axes.set_xlabel("pressure in kPa")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
