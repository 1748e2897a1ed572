"""Picture of a relaxed design: its start, its line families, and the print made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from shapely.geometry.base import BaseGeometry

from toros_fem.lines.field import LineField
from toros_fem.meshes.arrange import Place
from toros_fem.meshes.pattern import Pattern
from toros_fem.output.drawing import DPI
from toros_fem.output.pattern_plot import draw_panels

COLOURS = ("#b3261e", "#1f4e9c", "#2c8f35", "#8a4fa3")
START = "0.25"
# Length of the mark of the largest share, over the mean edge length.
MARK = 1.1
# Largest width and height of a row of pictures, in inches.
ROW = (18.0, 9.0)


def plot_line_field(
    path: Path,
    field: LineField,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    start: LineField | None = None,
) -> None:
    """Write a picture of the start, of each family's share and direction, and of the print, in mm.

    Each mark has the direction of the lines in its triangle; its length grows with the share. The
    families may be those of a part that is cut at symmetry planes, beside the print of the whole.

    Args:
        path: PNG file to write.
        field: The line families.
        pattern: The pattern that is printed on.
        regions: Print on each of its panels, polygons in m.
        start: The families that the design began with, drawn together; None leaves them out.
    """
    first = 0 if start is None else 1
    figure, row = plt.subplots(
        1, first + field.families + 1, layout="constrained", squeeze=False, figsize=ROW
    )
    page = ROW[0] / row.size, ROW[1]
    if start is not None:
        _draw_families(row[0][0], start, range(start.families), START, page)
        row[0][0].set_title(f"random start:\n{start.families} families of all directions")
    area = field.pattern.areas
    for family, axes in enumerate(row[0][first:-1]):
        _draw_families(axes, field, [family], COLOURS[family % len(COLOURS)], page)
        shares = field.shares[:, family]
        mean, most = 100 * float(area @ shares) / float(area.sum()), 100 * float(shares.max())
        axes.set_title(f"family {family + 1}: {mean:.1f} % of the area\n(at most {most:.0f} %)")
    draw_panels(row[0][-1], pattern, regions, page)
    row[0][-1].set_title("print")
    fit_row(figure, row[0])
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def fit_row(figure: Figure, row: Sequence[Axes]) -> None:
    """Set the size of a figure and the widths of its axes to one scale, as large as `ROW`."""
    for axes in row[1:]:
        axes.set_ylabel("")
    extents = np.array([(axes.dataLim.width, axes.dataLim.height) for axes in row])
    scale = min(ROW[0] / extents[:, 0].sum(), ROW[1] / extents[:, 1].max())
    grid = row[0].get_gridspec()
    assert grid is not None
    grid.set_width_ratios(extents[:, 0])
    figure.set_size_inches(
        scale * extents[:, 0].sum() + 0.8 * len(row), scale * extents[:, 1].max() + 1.2
    )


def _draw_families(
    axes: Axes,
    field: LineField,
    families: Sequence[int],
    colour: str,
    page: tuple[float, float],
) -> None:
    """Draw families on bare panels in one colour, with thin marks where there are several."""
    bare = [shapely.Polygon()] * len(field.pattern.panel_names)
    places = draw_panels(axes, field.pattern, bare, page)
    width = 1.2 if len(families) == 1 else 0.6
    for family in families:
        axes.add_collection(_marks(field, family, colour, width, places))


def _marks(
    field: LineField, family: int, colour: str, width: float, places: Sequence[Place]
) -> LineCollection:
    """Return the marks of one family, in mm."""
    pattern, shares = field.pattern, field.shares[:, family]
    angles = field.angles[:, family]
    most = max(float(field.shares.max()), 1e-12)
    half = MARK / 2 * np.sqrt(2 * pattern.areas.mean() * shares / most)
    along = half[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = np.stack([pattern.centroids - along, pattern.centroids + along], axis=1)
    for panel, place in enumerate(places):
        here = pattern.panel == panel
        ends[here] = place.points(ends[here])
    return LineCollection(list(1e3 * ends[shares > 0]), colors=colour, lw=width)
