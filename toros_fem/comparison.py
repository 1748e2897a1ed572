"""Picture of several designs of one panel side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from shapely.geometry.base import BaseGeometry

from toros_fem.contours import panel_outline
from toros_fem.meshes.pattern import Pattern
from toros_fem.plotting import DPI, FABRIC, PRINTED, fill


def plot_variants(
    path: Path,
    pattern: Pattern,
    panel: str,
    variants: Sequence[tuple[str, BaseGeometry, str]],
) -> None:
    """Picture strip of what variants print on one panel, in mm.

    Args:
        path: PNG file to write.
        pattern: The pattern.
        panel: Name of the panel to show.
        variants: For each its title, what it prints on that panel, in m, and a caption.
    """
    outline = panel_outline(pattern, pattern.panel_index(panel))
    left, bottom, right, top = outline.bounds
    height = 9.0
    width = height * (right - left) / (top - bottom)
    figure, row = plt.subplots(
        1,
        len(variants),
        figsize=((width + 0.35) * len(variants) + 0.5, height),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axes, (title, region, caption) in zip(row[0], variants, strict=True):
        fill(axes, outline, FABRIC, edge="0.25")
        fill(axes, region, PRINTED)
        axes.set_title(title)
        axes.set_xlabel(caption, linespacing=1.5)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.spines[["top", "right"]].set_visible(False)
    row[0][0].set_ylabel("mm")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
