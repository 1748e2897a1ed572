"""Pictures of a tile: profile, curves, pattern, deformed shape, and pull tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.design.loop.options import Iteration
from toros_fem.meshes.makers.tile import Tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.objectives import ProfileTarget
from toros_fem.products.tiles.pull_test import PulledSheet
from toros_fem.products.tiles.sheet import region_of_triangles
from toros_fem.products.tiles.stiffness_profile import Profile
from toros_fem.results.pictures.drawing import DPI, FABRIC, PRINTED, fill

TARGET_COLOUR = "tab:red"


def full_circle(angles: Floats, values: Floats, symmetry: str) -> tuple[Floats, Floats]:
    """Return angles of a full circle and the values there, by the symmetry of a profile.

    A profile has equal values along n and −n; mirrors of the tile add further equal directions.

    Args:
        angles: Directions with known values, in rad, (k,).
        values: Values there, (k,).
        symmetry: Symmetry of the tile, as for `Tile.symmetry_maps`.

    Returns:
        Sorted angles from 0 to 2π, the first again at the end, and their values.
    """
    parts = [angles]
    if symmetry == "tetragonal":
        parts = [*parts, *[np.pi / 2 - a for a in parts]]
    if symmetry in ("orthotropic", "tetragonal"):
        parts = [*parts, *[-a for a in parts]]
    parts = [*parts, *[a + np.pi for a in parts]]
    whole = np.mod(np.concatenate(parts), 2 * np.pi)
    _, first = np.unique(np.round(whole, 9), return_index=True)
    every = np.tile(values, len(parts))[first]
    return np.append(whole[first], whole[first][0] + 2 * np.pi), np.append(every, every[0])


def plot_profile(
    path: Path,
    profile: Profile,
    fabric_stiffness: float,
    symmetry: str,
    angles: Floats,
    target: ProfileTarget | None,
) -> None:
    """Draw stiffness and contraction over all directions.

    Args:
        path: PNG file to write.
        profile: Profile of the print.
        fabric_stiffness: Stiffness of the fabric without print, in N/m.
        symmetry: As for `full_circle`.
        angles: Directions of the target in rad.
        target: Target in these directions; None for none.
    """
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 5.5), subplot_kw={"projection": "polar"}, layout="constrained"
    )
    left.plot(
        *full_circle(profile.angles, profile.stiffness, symmetry), color=PRINTED, label="printed"
    )
    parts = [] if target is None else [(left, target.stiffness), (right, target.contraction)]
    label = "target"
    for axes, values in parts:
        if values is not None:
            circle = full_circle(angles, values, symmetry)
            axes.plot(*circle, "o", ms=5, mfc="none", color=TARGET_COLOUR, label=label)
            label = ""
    turn = np.linspace(0, 2 * np.pi, 100)
    left.plot(turn, np.full(100, fabric_stiffness), "--", color="0.5", label="fabric without print")
    left.set_rlim(0)
    left.set_title(f"secant stiffness in N/m at {100 * profile.strain:g} % strain")
    right.plot(*full_circle(profile.angles, profile.contraction, symmetry), color=PRINTED)
    shown = profile.contraction
    if target is not None and target.contraction is not None:
        shown = np.append(shown, target.contraction[~np.isnan(target.contraction)])
    low = min(0.0, float(shown.min()))
    if low < 0:
        right.plot(turn, np.zeros(100), color="0.7", lw=0.8)
    right.set_rlim(1.2 * low, 1.1 * max(0.1, float(shown.max())))
    right.set_title("lateral contraction")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_curves(path: Path, curves: Sequence[Profile]) -> None:
    """Draw nominal stress and lateral contraction over strain, one line for each direction.

    Args:
        path: PNG file to write.
        curves: Profiles at increasing strains.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    strain = [100 * profile.strain for profile in curves]
    for k, angle in enumerate(curves[0].angles):
        stress = [profile.stress[k] for profile in curves]
        left.plot([0.0, *strain], [0.0, *stress], ".-", label=f"{np.degrees(angle):.4g}°")
        right.plot(strain, [profile.contraction[k] for profile in curves], ".-")
    left.set_ylabel("nominal stress in N/m")
    right.set_ylabel("lateral contraction")
    for axes in (left, right):
        axes.set_xlabel("strain in %")
        axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_tiles(path: Path, tile: Tile, region: BaseGeometry, count: int) -> None:
    """Draw the print on count × count tiles and the border of one, in mm.

    Args:
        path: PNG file to write.
        tile: The tile.
        region: Printed region of all of them, in m.
        count: Number of tiles along each side.
    """
    figure, axes = plt.subplots(figsize=(7, 7), layout="constrained")
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) @ tile.lattice * 1e3
    axes.add_collection(PolyCollection([count * corner[:-1]], facecolors=[FABRIC]))
    fill(axes, region, PRINTED)
    axes.plot(
        *(corner + (count // 2) * tile.lattice.sum(axis=0) * 1e3).T, color=TARGET_COLOUR, lw=1
    )
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("mm")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_deformed(
    path: Path,
    tile: Tile,
    printed: Bools,
    positions: Floats,
    gradient: Floats,
    count: int = 2,
) -> None:
    """Draw count × count tiles, flat and pulled, in mm.

    Args:
        path: PNG file to write.
        tile: The tile.
        printed: Whether each of its triangles is printed, (t,).
        positions: Positions of all its vertices, pulled along the first axis, (n, 3), in m.
        gradient: The mean deformation gradient, (3, 2).
        count: Number of tiles along each side.
    """
    colours = np.where(printed[:, None], PRINTED, FABRIC)
    mean = gradient[:2] @ tile.lattice.T
    flat = tile.pattern.corners
    moved = positions[tile.pattern.triangles][:, :, :2] + tile.wraps @ mean.T
    figure, axes = plt.subplots(
        1, 2, figsize=(12, 6), sharex=True, sharey=True, layout="constrained"
    )
    for ax, shape, steps, title in (
        (axes[0], flat, tile.lattice.T, "flat"),
        (axes[1], moved, mean, f"pulled by {100 * (gradient[0, 0] - 1):g} %"),
    ):
        for i in range(count):
            for j in range(count):
                corners = 1e3 * (shape + steps @ [i, j])
                ax.add_collection(
                    PolyCollection(list(corners), facecolors=colours, edgecolors="face", lw=0.2)
                )
        ax.set_title(title)
        ax.set_aspect("equal")
        ax.autoscale_view()
        ax.set_xlabel("mm")
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def plot_history(path: Path, history: Sequence[Iteration]) -> None:
    """Draw objective, volume and grey level over the iterations of the chosen start.

    Args:
        path: PNG file to write.
        history: Rows of the design loop.
    """
    count = np.arange(len(history))
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
    top.semilogy(count, [row.objective for row in history], color=PRINTED)
    top.set_ylabel("objective T")
    for k in range(1, len(history)):
        if history[k].stage != history[k - 1].stage:
            for axis in (top, bottom):
                axis.axvline(k, color="0.8", lw=1)
    bottom.plot(count, [row.volume_fraction for row in history], label="volume fraction")
    bottom.plot(count, [row.grey_level for row in history], label="grey level")
    bottom.set_ylim(0, 1)
    bottom.legend(frameon=False)
    bottom.set_xlabel("step; lines: β, mesh, constraints or target changed")
    for axis in (top, bottom):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


# Colour, line width and marker of each direction; both lines show where they cover each other.
LINE_STYLES = (("#0a7fc2", 3.0, "o"), ("#d1242f", 1.4, "s"))
# Longest side of a sheet's picture, in inches.
LONGEST_SIDE = 7.0


def plot_sheet(path: Path, pattern: Pattern, positions: Floats, printed: Bools, title: str) -> None:
    """Draw a sheet before and after the pull, in the same scale, in mm.

    Args:
        path: PNG file to write.
        pattern: The sheet.
        positions: Positions of all its vertices, (n, 3), in m.
        printed: Whether each triangle is printed, (t,).
        title: Title of the pulled one.
    """
    states = (("before", pattern.points), (title, positions))
    size = np.ptp(np.concatenate([pattern.points, positions]), axis=0)[:2]
    grid = (1, 2) if size[1] > size[0] else (2, 1)
    figure, row = plt.subplots(
        *grid,
        figsize=LONGEST_SIDE * size / size.max() * grid[::-1] + 1.2,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for axes, (name, points) in zip(row, states, strict=True):
        corners = points[pattern.triangles, :2]
        fill(axes, region_of_triangles(corners), FABRIC, edge="0.45")
        fill(axes, region_of_triangles(corners[printed]), PRINTED)
        axes.set_title(name)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.spines[["top", "right"]].set_visible(False)
        axes.set(xlabel="mm", ylabel="mm")
        axes.label_outer()
    figure.savefig(path, dpi=DPI, bbox_inches="tight")
    plt.close(figure)


def plot_pulls(path: Path, pulled: Sequence[PulledSheet]) -> None:
    """Draw stress and contraction over strain, of sheets and of the periodic tile.

    Args:
        path: PNG file to write.
        pulled: One pulled sheet for each direction.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5.6), layout="constrained")
    for one, (colour, lw, marker) in zip(pulled, LINE_STYLES, strict=False):
        test, predicted, name = one.test, one.predicted, one.sheet.direction
        strain, style = 100 * test.curve.strain, {"color": colour, "lw": lw}
        sheet = {"label": f"along {name}: sheet", "marker": marker, "ms": 4 + 2 * lw, "mfc": "none"}
        periodic = {"label": f"along {name}: predicted", "ls": "--"}
        middle = {"label": f"along {name}: sheet, over the strain of its middle", "ls": ":"}
        left.plot([0, *strain], [0, *test.curve.stress], **style, **sheet)
        left.plot([0, *strain], [0, *predicted.stress], **style, **periodic)
        right.plot(strain, test.curve.contraction, **style, **sheet)
        right.plot(strain, predicted.contraction, **style, **periodic)
        right.plot(strain, test.middle_contraction, **style, **middle)
    left.set_ylabel("force over width in N/m")
    right.set_ylabel("lateral contraction of the middle over strain")
    right.axhline(0.0, color="0.6", lw=0.8)
    for axes in (left, right):
        axes.set_xlabel("strain in %")
        axes.set_xlim(left=0)
        axes.grid(alpha=0.3)
    figure.legend(*right.get_legend_handles_labels(), frameon=False, ncols=2,
                  loc="outside lower center")  # fmt: skip
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
