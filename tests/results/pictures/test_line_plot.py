"""Picture of line families."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from helpers.scenes import square

from toros_fem.design.lines.field import LineField
from toros_fem.results.pictures.line_plot import plot_line_field


def test_families_and_their_print(tmp_path: Path) -> None:
    pattern = square(n=6)
    count = len(pattern.panel)
    field = LineField(pattern, np.full((count, 2), [0.2, 0.05]), np.tile([0.0, 1.2], (count, 1)))
    start = LineField(pattern, np.full((count, 1), 0.3), np.full((count, 1), 0.5))
    blank = LineField(pattern, np.zeros((count, 2)), field.angles)
    pixels = []
    cases = ("lines", field, None), ("blank", blank, None), ("all", field, start)
    for name, each, first in cases:
        path = tmp_path / f"{name}.png"
        plot_line_field(path, each, pattern, [shapely.box(0, 0, 0.01, 0.02)], first)
        pixels.append(plt.imread(path)[..., :3])
    # Marks are red in the first picture and blue in the second; a blank field has none.
    red, green, blue = (pixels[0][..., k] for k in range(3))
    width = pixels[0].shape[1] // 3
    assert ((red > 0.6) & (green < 0.3))[:, :width].sum() > 100
    assert ((blue > 0.5) & (red < 0.3))[:, width : 2 * width].sum() > 100
    red, green, blue = (pixels[1][..., k] for k in range(3))
    assert not ((red > 0.6) & (green < 0.3)).any()
    # With the start before them all pictures move to the right.
    quarter, red, green = pixels[2].shape[1] // 4, pixels[2][..., 0], pixels[2][..., 1]
    marks = (red > 0.6) & (green < 0.3)
    assert marks[:, quarter : 2 * quarter].sum() > 100
    assert not marks[:, :quarter].any()
    dark = (np.abs(pixels[2] - 0.25) < 0.03).all(axis=2)
    assert dark[:, :quarter].sum() > 100
