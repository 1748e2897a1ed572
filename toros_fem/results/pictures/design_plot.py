"""Picture of a design by densities: its start, its projected density, and the print."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.drawing import DPI, FABRIC, PRINTED
from toros_fem.results.pictures.line_plot import ROW, fit_row
from toros_fem.results.pictures.pattern_plot import draw_panels


def plot_design(
    path: Path,
    start: tuple[Pattern, Floats],
    pattern: Pattern,
    projected: Floats,
    regions: Sequence[BaseGeometry],
) -> None:
    """Write a picture of the start, of the projected density and of the print, in mm.

    Args:
        path: PNG file to write.
        start: The pattern that the design began on, and its density, (s,).
        pattern: The pattern that is printed on.
        projected: ρ̄ of its triangles, (t,).
        regions: Print on each of its panels, polygons in m.
    """
    figure, row = plt.subplots(1, 3, layout="constrained", figsize=ROW)
    page = ROW[0] / len(row), ROW[1]
    _draw_density(row[0], *start, page)
    row[0].set_title("start: density")
    _draw_density(row[1], pattern, projected, page)
    row[1].set_title("design: projected density")
    draw_panels(row[2], pattern, regions, page)
    row[2].set_title("print")
    fit_row(figure, row)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def _draw_density(axes: Axes, pattern: Pattern, density: Floats, page: tuple[float, float]) -> None:
    """Draw a density on flat panels, from fabric at 0 to print at 1."""
    places = draw_panels(axes, pattern, [shapely.Polygon()] * len(pattern.panel_names), page)
    mix = np.clip(density, 0, 1)[:, None]
    colours = (1 - mix) * FABRIC + mix * PRINTED
    for panel, place in enumerate(places):
        here = pattern.panel == panel
        corners = 1e3 * place.points(pattern.corners[here])
        axes.add_collection(
            PolyCollection(list(corners), facecolors=colours[here], edgecolors="face", lw=0.3)
        )
