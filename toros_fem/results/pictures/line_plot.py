"""Pictures of directions on flat panels: line families and their print, tension in wrinkles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.design.lines.field import LineField
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.drawing import DPI
from toros_fem.results.pictures.pattern_plot import draw_panels

COLOURS = ("#b3261e", "#1f4e9c", "#2c8f35", "#8a4fa3")
START = "0.25"
# Length of the mark of the largest share, over the mean edge length.
MARK = 1.1
# Largest width and height of a row of pictures, in inches.
ROW = (18.0, 9.0)
# Colours of slack, wrinkled and taut triangles, and of the tension in the last two.
STATES = {Tension.SLACK: "0.88", Tension.WRINKLED: "#f2c078", Tension.TAUT: "#9dc3e6"}
STROKE = "0.15"
PAGE = (9.0, 8.0)


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
    field: LineField, family: int, colour: str, width: float, places: Sequence[Affine]
) -> LineCollection:
    """Return the marks of one family, in mm."""
    pattern, shares = field.pattern, field.shares[:, family]
    angles = field.angles[:, family]
    most = max(float(field.shares.max()), 1e-12)
    half = MARK / 2 * np.sqrt(2 * pattern.areas.mean() * shares / most)
    along = half[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _strokes(pattern, along, colour, width, places)


def _strokes(
    pattern: Pattern, along: Floats, colour: str, width: float, places: Sequence[Affine]
) -> LineCollection:
    """Return strokes through the centroids, in mm, by half of each, (t, 2), in m; none of 0."""
    ends = np.stack([pattern.centroids - along, pattern.centroids + along], axis=1)
    ends = _placed(pattern, ends, places)
    return LineCollection(list(1e3 * ends[along.any(axis=1)]), colors=colour, lw=width)


def _placed(pattern: Pattern, points: Floats, places: Sequence[Affine]) -> Floats:
    """Return points of each triangle, (t, k, 2), at the places of their panels."""
    placed = np.array(points)
    for panel, place in enumerate(places):
        here = pattern.panel == panel
        placed[here] = place.points(placed[here])
    return placed


def plot_wrinkles(path: Path, pattern: Pattern, field: WrinkleField) -> None:
    """Write a picture of wrinkles on the flat panels, in mm.

    The colour is the state of each triangle; strokes have the direction of the tension, along which
    wrinkles run.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        field: Its wrinkles.
    """
    figure, axes = plt.subplots(layout="constrained", figsize=PAGE)
    bare = [shapely.Polygon()] * len(pattern.panel_names)
    places = draw_panels(axes, pattern, bare, PAGE)
    colours = np.array([STATES[state] for state in Tension])[field.state]
    corners = 1e3 * _placed(pattern, pattern.corners, places)
    axes.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors="1", lw=0.3))
    length = np.sqrt(2 * pattern.areas)
    axes.add_collection(_strokes(pattern, 0.3 * length[:, None] * field.flat, STROKE, 0.9, places))
    keys = [
        Patch(
            color=STATES[state],
            label=f"{state.name.lower()} {field.share(state, pattern.areas):.0%}",
        )
        for state in Tension
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=3, frameon=False)
    axes.set_title("Wrinkles run along the strokes, the direction of tension")
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)
