"""Pictures of a tile: profile, curves, pattern, deformed shape, and pull tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.meshes.makers.tile import SYMMETRIES, Tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.printed_tile import region_of_triangles
from toros_fem.products.tiles.pull_test import PulledSheet
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileTarget
from toros_fem.results.pictures.drawing import DPI, FABRIC, PRINTED, fill

TARGET_COLOUR = "tab:red"
# Colour, line width and marker of each direction; both lines show where they cover each other.
LINE_STYLES = (("#0a7fc2", 3.0, "o"), ("#d1242f", 1.4, "s"))
# Longest side of a sheet's picture, in inches.
LONGEST_SIDE = 7.0
# Directions that differ by less than a part of this, in rad, are the same.
ROUND = 1e9


def full_circle(angles: Floats, values: Floats, symmetry: str) -> tuple[Floats, Floats]:
    """Return sorted angles of a full circle in rad, the first again at the end, and values there.

    They are those of directions (k,) and of their images: a profile has equal values along n and
    −n, and along what the tile's symmetry makes of them.
    """
    operations = SYMMETRIES[symmetry]
    images = np.concatenate([operations, -operations]) @ np.stack([np.cos(angles), np.sin(angles)])
    turns = np.arctan2(images[:, 1], images[:, 0]).ravel() / (2 * np.pi) % 1.0
    whole, first = np.unique(np.rint(turns * ROUND) % ROUND, return_index=True)
    every = np.tile(values, len(images))[first]
    whole = 2 * np.pi * whole / ROUND
    return np.append(whole, whole[0] + 2 * np.pi), np.append(every, every[0])


def plot_profile(
    path: Path,
    profile: Profile,
    fabric_stiffness: float,
    symmetry: str,
    angles: Floats,
    target: ProfileTarget | None,
) -> None:
    """Draw stiffness and contraction over all directions, and their target at `angles` in rad."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 5.5), subplot_kw={"projection": "polar"}, layout="constrained"
    )
    stiffness = full_circle(profile.angles, profile.stiffness, symmetry)
    left.plot(*stiffness, color=PRINTED, label="printed")
    right.plot(*full_circle(profile.angles, profile.contraction, symmetry), color=PRINTED)
    label, shown = "target", profile.contraction
    goals = (None, None) if target is None else (target.stiffness, target.contraction)
    for axes, values in zip((left, right), goals, strict=True):
        if values is not None:
            circle = full_circle(angles, values, symmetry)
            axes.plot(*circle, "o", ms=5, mfc="none", color=TARGET_COLOUR, label=label)
            label = ""
            if axes is right:
                shown = np.append(shown, values[~np.isnan(values)])
    turn = np.linspace(0, 2 * np.pi, 100)
    left.plot(turn, np.full(100, fabric_stiffness), "--", color="0.5", label="fabric without print")
    left.set_rlim(0)
    left.set_title(f"secant stiffness in N/m at {100 * profile.strain:g} % strain")
    low = min(0.0, float(shown.min()))
    if low < 0:
        right.plot(turn, np.zeros(100), color="0.7", lw=0.8)
    right.set_rlim(1.2 * low, 1.1 * max(0.1, float(shown.max())))
    right.set_title("lateral contraction")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    _save(path, figure)


def plot_curves(path: Path, curves: Sequence[Profile]) -> None:
    """Draw stress and contraction of profiles at increasing strains, a line for each direction."""
    figure, (left, right) = _over_strain("nominal stress in N/m", "lateral contraction")
    strain = [100 * profile.strain for profile in curves]
    for k, angle in enumerate(curves[0].angles):
        stress = [profile.stress[k] for profile in curves]
        left.plot([0.0, *strain], [0.0, *stress], ".-", label=f"{np.degrees(angle):.4g}°")
        right.plot(strain, [profile.contraction[k] for profile in curves], ".-")
    figure.legend(loc="outside right upper", frameon=False)
    _save(path, figure)


def plot_pulls(path: Path, pulled: Sequence[PulledSheet]) -> None:
    """Draw stress and contraction over strain, of sheets and of the periodic tile."""
    figure, (left, right) = _over_strain(
        "force over width in N/m", "lateral contraction of the middle over strain"
    )
    for one, (colour, lw, marker) in zip(pulled, LINE_STYLES, strict=False):
        test, predicted, name = one.test, one.predicted, one.sheet.direction
        strain, style = 100 * test.strain, {"color": colour, "lw": lw}
        sheet = {"label": f"along {name}: sheet", "marker": marker, "ms": 4 + 2 * lw, "mfc": "none"}
        periodic = {"label": f"along {name}: predicted", "ls": "--"}
        middle = {"label": f"along {name}: sheet, over the strain of its middle", "ls": ":"}
        left.plot([0, *strain], [0, *test.stress], **style, **sheet)
        left.plot([0, *strain], [0, *predicted.stress], **style, **periodic)
        right.plot(strain, test.contraction, **style, **sheet)
        right.plot(strain, predicted.contraction, **style, **periodic)
        right.plot(strain, test.middle_contraction, **style, **middle)
    right.axhline(0.0, color="0.6", lw=0.8)
    for axes in (left, right):
        axes.set_xlim(left=0)
    handles = right.get_legend_handles_labels()
    figure.legend(*handles, frameon=False, ncols=2, loc="outside lower center")
    _save(path, figure)


def plot_tiles(path: Path, tile: Tile, region: BaseGeometry, count: int) -> None:
    """Draw the print `region` in m on count × count tiles and the border of one, in mm."""
    figure, axes = plt.subplots(figsize=(7, 7), layout="constrained")
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) @ tile.lattice * 1e3
    axes.add_collection(PolyCollection([count * corner[:-1]], facecolors=[FABRIC]))
    fill(axes, region, PRINTED)
    border = corner + (count // 2) * tile.lattice.sum(axis=0) * 1e3
    axes.plot(*border.T, color=TARGET_COLOUR, lw=1)
    _to_scale(axes)
    _save(path, figure)


def plot_deformed(
    path: Path, tile: Tile, printed: Bools, positions: Floats, gradient: Floats
) -> None:
    """Draw 2 × 2 tiles before and after a pull along the first axis.

    Positions of all vertices are (n, 3), in m; the mean deformation gradient is (3, 2).
    """
    mean = gradient[:2] @ tile.lattice.T
    one = positions[tile.pattern.triangles][:, :, :2] + tile.wraps @ mean.T
    copies = [one + mean @ (i, j) for j, i in np.ndindex(2, 2)]
    sheet, cell = tile.sheet(2, 2)
    moved = sheet.points.copy()
    moved[sheet.triangles, :2] = np.concatenate(copies)
    plot_sheet(path, sheet, moved, printed[cell], f"pulled by {100 * (gradient[0, 0] - 1):g} %")


def plot_sheet(path: Path, pattern: Pattern, positions: Floats, printed: Bools, title: str) -> None:
    """Draw a sheet before and after the pull to `positions` (n, 3) in m, to scale, in mm."""
    size = np.ptp(np.concatenate([pattern.points, positions]), axis=0)[:2]
    grid = (1, 2) if size[1] > size[0] else (2, 1)
    page = LONGEST_SIDE * size / size.max() * grid[::-1] + 1.2
    figure, row = plt.subplots(*grid, figsize=page, sharex=True, sharey=True, layout="constrained")
    for axes, name, points in zip(row, ("before", title), (pattern.points, positions), strict=True):
        corners = points[pattern.triangles, :2]
        fill(axes, region_of_triangles(corners), FABRIC, edge="0.45")
        fill(axes, region_of_triangles(corners[printed]), PRINTED)
        axes.set_title(name)
        _to_scale(axes)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_ylabel("mm")
        axes.label_outer()
    _save(path, figure)


def _over_strain(*labels: str) -> tuple[Figure, Any]:
    """Return a figure of two axes over the strain in %, with labels of what they show."""
    figure, row = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
    for axes, label in zip(row, labels, strict=True):
        axes.set(xlabel="strain in %", ylabel=label)
        axes.grid(alpha=0.3)
    return figure, row


def _to_scale(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("mm")


def _save(path: Path, figure: Figure) -> None:
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)
