"""Picture of an unwrapped surface: its seams in space, and the distortion of its flat panels."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from toros_fem.base.array_types import Floats
from toros_fem.meshes.surfaces.unwrap import Unwrapped
from toros_fem.results.pictures.raster import DrawnSurface, Image
from toros_fem.results.pictures.shown import visible
from toros_fem.results.pictures.stage import Axonometry
from toros_fem.results.pictures.style import INK, SIGNED, bar_below, write_title
from toros_fem.results.pictures.view import View

# Colours span at least this deviation of the area ratio from 1.
LEAST_RANGE = 0.01
# The name of a panel that is this many times higher than wide is written upwards.
NARROW = 2.5
VIEWS = (View(20, 35), View(20, 215))


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
