"""Pictures of densities on one panel: the fields ρ, ρ̃, ρ̄ of several designs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.pictures.drawing import DPI

# Height of a panel in inches, and the number of designs in a row.
HEIGHT = 4.2
IN_A_ROW = 3


def plot_fields(
    path: Path,
    pattern: Pattern,
    panel: str,
    designs: Sequence[tuple[str, Mapping[str, Floats]]],
) -> None:
    """Write a picture of density fields on one panel, from white (0) to black (1).

    The fields of a design stand side by side, as many designs as fit in a row.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        panel: Name of the panel to show.
        designs: For each design its title, and its fields by their names: densities of all
            triangles, (t,). All designs have the same names.
    """
    number = pattern.panel_index(panel)
    cells = pattern.cells_of(panel)
    left, bottom, right, top = 1e3 * np.array(pattern.outline(number).bounds)
    across, fields = min(IN_A_ROW, len(designs)), len(designs[0][1])
    width = HEIGHT * (right - left) / (top - bottom) + 0.12
    down = -(-len(designs) // across)
    figure = plt.figure(
        figsize=(across * (fields * width + 0.25) + 0.9, down * (HEIGHT + 0.75)),
        layout="constrained",
    )
    main, side = figure.subfigures(1, 2, width_ratios=(across * fields * width, 0.9))
    blocks = np.ravel(main.subfigures(down, across))
    for block, (title, values) in zip(blocks, designs, strict=False):
        block.suptitle(title, fontweight="bold")
        for axes, (name, field) in zip(
            np.ravel(block.subplots(1, fields)), values.items(), strict=True
        ):
            grey = axes.tripcolor(
                *(1e3 * pattern.flat_points.T),
                pattern.flat_triangles[cells],
                facecolors=field[cells],
                cmap="gray_r",
                vmin=0,
                vmax=1,
            )
            axes.set_title(name)
            axes.set_aspect("equal")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
    side.colorbar(grey, cax=side.add_axes((0.1, 0.3, 0.25, 0.4)), label="density")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
