"""Picture of an unwrapped surface: seams in space, and how far the flat panels are from it."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from toros_fem._types import Floats
from toros_fem.fabrication.contours import panel_outline
from toros_fem.meshes.unwrap import Unwrapped
from toros_fem.output.plots import DPI, camera

COLOURS = "RdBu_r"
SEAM = (0.05, 0.05, 0.05, 1.0)
# Area ratios that differ from 1 by less than this need no colour.
LEAST_RANGE = 0.01
# The name of a panel so much higher than wide is written upwards.
NARROW = 2.5
DIRECTIONS = ((20, 35), (20, 215))


def plot_unwrapped(path: Path, unwrapped: Unwrapped) -> None:
    """Picture of the surface from two sides, with its seams, and of the flat panels, in mm.

    The colour is the area on the surface over the flat area: red panels are to be stretched.

    Args:
        path: PNG file to write.
        unwrapped: The surface as a pattern.
    """
    pattern, ratio = unwrapped.pattern, unwrapped.distortion.area_ratio
    reach = max(LEAST_RANGE, float(np.abs(ratio - 1).max()))
    scale = ScalarMappable(Normalize(1 - reach, 1 + reach), COLOURS)
    colours = scale.to_rgba(ratio)
    figure = plt.figure(figsize=(14, 8), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.7])
    for row, (elevation, turn) in enumerate(DIRECTIONS):
        axes = figure.add_subplot(grid[row, 0])
        _draw_surface(axes, unwrapped, colours, elevation, turn)
    axes = figure.add_subplot(grid[:, 1])
    corners = 1e3 * pattern.corners
    axes.add_collection(
        PolyCollection(list(corners), facecolors=colours, edgecolors="face", lw=0.3)
    )
    for panel, name in enumerate(pattern.panel_names):
        outline = panel_outline(pattern, panel)
        axes.plot(*(1e3 * np.asarray(outline.exterior.coords).T), color=SEAM, lw=1)
        middle = 1e3 * np.asarray(outline.point_on_surface().coords)[0]
        left, low, high, top = outline.bounds
        upright = 90 if top - low > NARROW * (high - left) else 0
        axes.annotate(name, tuple(middle), ha="center", va="center", fontsize=8, rotation=upright)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("mm")
    axes.set_ylabel("mm")
    axes.spines[["top", "right"]].set_visible(False)
    worst = unwrapped.distortion.worst_stretch
    axes.set_title(
        f"{len(pattern.panel_names)} flat panels: stretch {worst:.1%} at worst, "
        f"{unwrapped.distortion.mean_stretch:.1%} in the mean"
    )
    figure.colorbar(scale, ax=axes, label="area on the surface / flat area", shrink=0.7)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _draw_surface(
    axes: Axes, unwrapped: Unwrapped, colours: Floats, elevation: float, turn: float
) -> None:
    """Shaded triangles and seams, painted back to front."""
    pattern = unwrapped.pattern
    right, up, away = camera(elevation, turn)
    points = 1e3 * pattern.points
    corner = points[pattern.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    toward = -(normal @ away)
    shade = np.where(toward > 0, 0.55 + 0.45 * np.abs(toward), 0.4)  # the inside is darker
    faces = colours.copy()
    faces[:, :3] *= shade[:, None]
    ends = np.concatenate([unwrapped.seams, pattern.free_edges])
    # The outside of a closed surface hides its inside.
    seen = toward > 0 if len(pattern.free_edges) == 0 else np.ones(len(corner), dtype=bool)
    corner, faces = corner[seen], faces[seen]
    lines = points[ends[np.isin(ends, pattern.triangles[seen]).all(axis=1)]]
    # A seam lies a little before the triangles beside it.
    ahead = 1e-2 * float(np.ptp(points, axis=0).max())
    shapes = [*corner, *lines]
    depth = np.array([shape.mean(axis=0) @ away for shape in shapes])
    depth[len(corner) :] -= ahead
    paint = np.concatenate([faces, np.tile(SEAM, (len(lines), 1))])
    width = np.repeat([0.3, 1.6], [len(corner), len(lines)])
    order = np.argsort(-depth, kind="stable")
    flat = [np.column_stack([shapes[k] @ right, shapes[k] @ up]) for k in order]
    axes.add_collection(
        PolyCollection(flat, facecolors=paint[order], edgecolors=paint[order], lw=width[order])
    )
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
