"""Picture of an unwrapped surface: its seams in space, and the distortion of its flat panels."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from toros_fem.base.array_types import Floats
from toros_fem.meshes.surfaces.unwrap import Unwrapped
from toros_fem.results.pictures.drawing import DPI, View, draw_polygons, frame

COLOURS = "RdBu_r"
SEAM = (0.05, 0.05, 0.05, 1.0)
# Width of a seam as a fraction of the surface's size.
SEAM_WIDTH = 5e-3
# Colours span at least this deviation of the area ratio from 1.
LEAST_RANGE = 0.01
# The name of a panel that is this many times higher than wide is written upwards.
NARROW = 2.5
VIEWS = (View(20, 35), View(20, 215))


def plot_unwrapped(path: Path, unwrapped: Unwrapped) -> None:
    """Write a picture of the surface from two sides, with its seams, and of the flat panels, in mm.

    The colour is the area on the surface over the flat area: red panels have to be stretched.

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
    spaces = [figure.add_subplot(grid[row, 0]) for row in range(len(VIEWS))]
    for axes, view in zip(spaces, VIEWS, strict=True):
        frame(axes, pattern.points, view)
        axes.set_axis_off()
    axes = figure.add_subplot(grid[:, 1])
    corners = 1e3 * pattern.corners
    axes.add_collection(
        PolyCollection(list(corners), facecolors=colours, edgecolors="face", lw=0.3)
    )
    for panel, name in enumerate(pattern.panel_names):
        outline = pattern.outline(panel)
        axes.plot(*(1e3 * np.asarray(outline.exterior.coords).T), color=SEAM, lw=1)
        middle = 1e3 * np.asarray(outline.point_on_surface().coords)[0]
        left, low, high, top = outline.bounds
        upright = 90 if top - low > NARROW * (high - left) else 0
        axes.annotate(name, tuple(middle), ha="center", va="center", fontsize=8, rotation=upright)
    axes.set_aspect("equal")
    axes.set_xlabel("mm")
    axes.set_ylabel("mm")
    axes.spines[["top", "right"]].set_visible(False)
    worst = unwrapped.distortion.worst_stretch
    axes.set_title(
        f"{len(pattern.panel_names)} flat panels: stretch {worst:.1%} at worst, "
        f"{unwrapped.distortion.mean_stretch:.1%} on average"
    )
    figure.colorbar(scale, ax=axes, label="area on the surface / flat area", shrink=0.7)
    for space, view in zip(spaces, VIEWS, strict=True):
        _draw_surface(space, unwrapped, colours, view)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _draw_surface(axes: Axes, unwrapped: Unwrapped, colours: Floats, view: View) -> None:
    """Draw the surface and its seams, which are ribbons."""
    pattern = unwrapped.pattern
    toward = view.directions[2]
    corner = pattern.points[pattern.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    closed = len(pattern.free_edges) == 0  # its outside hides its inside
    seen = normal @ toward > 0 if closed else np.ones(len(corner), dtype=bool)
    ends = np.concatenate([unwrapped.seams, pattern.free_edges])
    start, end = np.moveaxis(
        pattern.points[ends[np.isin(ends, pattern.triangles[seen]).all(axis=1)]], 1, 0
    )
    aside = np.cross(toward, end - start)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), np.finfo(float).tiny)
    aside *= SEAM_WIDTH / 2 * pattern.size
    ribbons = np.stack([start - aside, start + aside, end + aside, end - aside], axis=1)
    # Polygons are sorted by their mean depth: a ribbon must be before the triangles beside it.
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max()
    ribbons += longest / 2 * toward
    draw_polygons(
        axes,
        [*corner[seen], *ribbons],
        np.concatenate([colours[seen], np.tile(SEAM, (len(ribbons), 1))]),
        view,
    )
