"""Pictures of a pull test: the sheet before and after, and its curves beside the prediction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from toros_fem.meshes.pattern import Pattern
from toros_fem.plotting import DPI, FABRIC, PRINTED, fill
from toros_fem.pull_test import PullCurve, PullTest
from toros_fem.sample import joined

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

# Colour, width and mark of each direction: of one that covers another, both are seen.
LOOKS = (("#0a7fc2", 3.0, "o"), ("#d1242f", 1.4, "s"))
# Longest side of a sheet's picture, in inches.
LONG = 7.0


def plot_sheet(path: Path, pattern: Pattern, positions: Floats, printed: Bools, title: str) -> None:
    """Picture of a sheet before and after it is pulled, in the same scale, in mm.

    Args:
        path: PNG file to write.
        pattern: The sheet.
        positions: Positions of all its vertices, (n, 3), in m.
        printed: Whether each triangle is printed, (t,).
        title: What to write above the pulled one.
    """
    states = (("before", pattern.points), (title, positions))
    size = np.ptp(np.concatenate([pattern.points, positions]), axis=0)[:2]
    grid = (1, 2) if size[1] > size[0] else (2, 1)
    figure, row = plt.subplots(
        *grid,
        figsize=LONG * size / size.max() * grid[::-1] + 1.2,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for axes, (name, points) in zip(row, states, strict=True):
        corners = points[pattern.triangles, :2]
        fill(axes, joined(corners), FABRIC, edge="0.45")
        fill(axes, joined(corners[printed]), PRINTED)
        axes.set_title(name)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.spines[["top", "right"]].set_visible(False)
        axes.set(xlabel="mm", ylabel="mm")
        axes.label_outer()
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def plot_pulls(path: Path, pulls: Sequence[tuple[str, PullTest, PullCurve]]) -> None:
    """Picture of stress and contraction over the strain, of sheets and of the tile that repeats.

    Args:
        path: PNG file to write.
        pulls: For each direction its name, what the sheet does, and what is predicted.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5.6), layout="constrained")
    for (name, test, predicted), (colour, lw, marker) in zip(pulls, LOOKS, strict=False):
        strain, look = 100 * test.curve.strain, {"color": colour, "lw": lw}
        sheet = {"label": f"along {name}: sheet", "marker": marker, "ms": 4 + 2 * lw, "mfc": "none"}
        periodic = {"label": f"along {name}: predicted", "ls": "--"}
        middle = {"label": f"along {name}: sheet, over the strain in its middle", "ls": ":"}
        left.plot([0, *strain], [0, *test.curve.stress], **look, **sheet)
        left.plot([0, *strain], [0, *predicted.stress], **look, **periodic)
        right.plot(strain, test.curve.contraction, **look, **sheet)
        right.plot(strain, predicted.contraction, **look, **periodic)
        right.plot(strain, test.poisson, **look, **middle)
    left.set_ylabel("force over width in N/m")
    right.set_ylabel("lateral contraction in the middle over strain")
    right.axhline(0.0, color="0.6", lw=0.8)
    for axes in (left, right):
        axes.set_xlabel("strain in %")
        axes.set_xlim(left=0)
        axes.grid(alpha=0.3)
    figure.legend(*right.get_legend_handles_labels(), frameon=False, ncols=2,
                  loc="outside lower center")  # fmt: skip
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
