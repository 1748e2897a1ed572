"""Picture of a relaxed design: its line families, beside the print that was made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.collections import LineCollection
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats
from toros_fem.lines.field import LineField
from toros_fem.meshes.pattern import Pattern
from toros_fem.output.drawing import DPI
from toros_fem.output.pattern_plot import draw_panels

COLOURS = ("#b3261e", "#1f4e9c", "#2c8f35", "#8a4fa3")
# Length of the mark of the largest share, over the mean edge length.
MARK = 1.1
HEIGHT = 9.0


def plot_line_field(
    path: Path, field: LineField, pattern: Pattern, regions: Sequence[BaseGeometry]
) -> None:
    """Write a picture of each family's share and direction, and of the print, in mm.

    Each mark has the direction of the lines in its triangle; its length grows with the share. The
    families may be those of a part that is cut at symmetry planes, beside the print of the whole.

    Args:
        path: PNG file to write.
        field: The line families.
        pattern: The pattern that is printed on.
        regions: Print on each of its panels, polygons in m.
    """
    count, bare = field.families, [shapely.Polygon()] * len(field.pattern.panel_names)
    figure, row = plt.subplots(1, count + 1, layout="constrained", squeeze=False)
    area = field.pattern.areas
    for family, axes in enumerate(row[0][:count]):
        offsets = draw_panels(axes, field.pattern, bare)
        axes.add_collection(_marks(field, family, offsets))
        shares = field.shares[:, family]
        mean, most = 100 * float(area @ shares) / float(area.sum()), 100 * float(shares.max())
        axes.set_title(f"family {family + 1}: {mean:.1f} % of the area\n(at most {most:.0f} %)")
    draw_panels(row[0][count], pattern, regions)
    row[0][count].set_title("print")
    extents = [np.array([axes.dataLim.width, axes.dataLim.height]) for axes in row[0]]
    widths = [HEIGHT * extent[0] / max(e[1] for e in extents) for extent in extents]
    row[0][0].get_gridspec().set_width_ratios(widths)
    figure.set_size_inches(sum(widths) + 0.9 * len(widths), HEIGHT + 1.0)
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def _marks(field: LineField, family: int, offsets: Sequence[Floats]) -> LineCollection:
    """Return the marks of one family, in mm."""
    pattern, shares = field.pattern, field.shares[:, family]
    angles = field.angles[:, family]
    most = max(float(field.shares.max()), 1e-12)
    half = MARK / 2 * np.sqrt(2 * pattern.areas.mean() * shares / most)
    along = half[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middle = pattern.centroids + np.asarray(offsets)[pattern.panel]
    ends = 1e3 * np.stack([middle - along, middle + along], axis=1)
    return LineCollection(list(ends[shares > 0]), colors=COLOURS[family % len(COLOURS)], lw=1.2)
