"""Picture of a design on its way from grey to print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.measures.figures import Figure as Told
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.curves import draw_history
from toros_fem.results.pictures.flat import draw_density, draw_panels
from toros_fem.results.pictures.style import SOFT

# Lower end and height of the panels, over the page.
BOTTOM, HEIGHT = 0.40, 0.47


def draw_progress(
    figure: Figure,
    steps: Sequence[tuple[int, Pattern, Floats]],
    printed: tuple[Pattern, Sequence[BaseGeometry]] | None,
    rows: Sequence[Mapping[str, float]],
    told: Told | None,
) -> None:
    """Draw the density at some iterations, the print, and the history below.

    Args:
        figure: The page.
        steps: For each step its iteration, the pattern and the density of its triangles, (t,).
        printed: The pattern that is printed on and the print on each panel, polygons in m; None
            before there is a print.
        rows: Rows of the history.
        told: Figure that is followed beside the objective; None for none.
    """
    count = len(steps) + (printed is not None)
    width = 0.98 / max(count, 1)
    for k in range(count):
        box = (0.01 + k * width, BOTTOM, 0.95 * width, HEIGHT)
        if k < len(steps):
            iteration, pattern, density = steps[k]
            draw_density(figure, box, pattern, density)
            name = f"iteration {iteration}"
        else:
            assert printed is not None
            draw_panels(figure, box, *printed, names=False)
            name = "print"
        figure.text(box[0] + box[2] / 2, BOTTOM + HEIGHT + 0.02, name, ha="center", color=SOFT)
    draw_history(figure.add_axes((0.10, 0.09, 0.78, 0.26)), rows, told)
