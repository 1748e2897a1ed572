"""Pictures of a tile: profile, curves, pattern, deformed shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.ticker import MaxNLocator
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.meshes.makers.tile import SYMMETRIES, Tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileTarget
from toros_fem.results.pictures import style

# Directions that differ by less than a part of this, in rad, are the same.
ROUND = 1e9
# Corners of triangles closer than this to a straight border of the print, in m, are left out.
COLLINEAR = 1e-9
# Most circles of a polar chart, so that their numbers stay apart.
RINGS = 4


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
    """Draw stiffness and contraction over all directions, and their target at `angles` in rad.

    A contraction that is negative somewhere, as of an auxetic tile, has Cartesian axes: a polar
    plot hides it in its middle.
    """
    goals = (None, None) if target is None else (target.stiffness, target.contraction)
    contraction = full_circle(profile.angles, profile.contraction, symmetry)
    wanted = None if goals[1] is None else full_circle(angles, goals[1], symmetry)
    every = np.concatenate([contraction[1], [0.0] if wanted is None else wanted[1]])
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    with style.page(
        path, f"Stiffness and contraction at {100 * profile.strain:g} % of strain"
    ) as figure:
        left = figure.add_axes((0.06, 0.10, 0.38, 0.66), projection="polar")
        left.plot(*full_circle(profile.angles, profile.stiffness, symmetry), color=style.DARK)
        turn = np.linspace(0, 2 * np.pi, 100)
        left.plot(turn, np.full(100, fabric_stiffness), "--", color=style.SOFT)
        if goals[0] is not None:
            left.plot(
                *full_circle(angles, goals[0], symmetry), "o", ms=5, mfc="none", color=style.ACCENT
            )
        left.set_ylim(0)
        left.set_title("secant stiffness (N/m)", pad=14)
        if low < 0:
            right = figure.add_axes((0.58, 0.16, 0.38, 0.58))
            right.plot(np.degrees(contraction[0]), contraction[1], color=style.DARK)
            if wanted is not None:
                right.plot(
                    np.degrees(wanted[0]), wanted[1], "o", ms=5, mfc="none", color=style.ACCENT
                )
            right.axhline(0, color=style.SOFT, lw=0.8)
            right.set(xlabel="direction (°)", xticks=range(0, 361, 90))
            right.grid(axis="y")
        else:
            right = figure.add_axes((0.56, 0.10, 0.38, 0.66), projection="polar")
            right.plot(*contraction, color=style.DARK)
            if wanted is not None:
                right.plot(*wanted, "o", ms=5, mfc="none", color=style.ACCENT)
            right.set_ylim(0, 1.1 * max(0.1, high))
        for axes in figure.axes:
            if axes.name == "polar":
                axes.yaxis.set_major_locator(MaxNLocator(RINGS))
        right.set_title("lateral contraction", pad=14)
        words = [("— printed", style.DARK), ("- - fabric without print", style.SOFT)]
        words += [("○ target", style.ACCENT)] if target is not None else []
        for k, (text, colour) in enumerate(words):
            figure.text(0.01, 0.10 - 0.04 * k, text, color=colour)


def plot_curves(path: Path, curves: Sequence[Profile]) -> None:
    """Draw stress and contraction of profiles at increasing strains, a line for each direction."""
    strain = [100 * profile.strain for profile in curves]
    with style.page(path, "Each direction of the tile over the strain") as figure:
        where = {"left": 0.09, "right": 0.95, "bottom": 0.12, "top": 0.87, "wspace": 0.3}
        left, right = figure.subplots(1, 2, gridspec_kw=where)
        left.set(xlabel="strain (%)", ylabel="nominal stress (N/m)")
        right.set(xlabel="strain (%)", ylabel="lateral contraction")
        left.grid(axis="y")
        right.grid(axis="y")
        count = len(curves[0].angles)
        for k, angle in enumerate(curves[0].angles):
            colour = colormaps[style.SEQUENTIAL](0.85 * k / max(1, count - 1))
            stress = [profile.stress[k] for profile in curves]
            left.plot([0.0, *strain], [0.0, *stress], ".-", color=colour)
            right.plot(strain, [profile.contraction[k] for profile in curves], ".-", color=colour)
            name = f"{np.degrees(angle):.4g}°"
            style.note(left, name, (strain[-1], stress[-1]), (4, 0), colour, va="center")


def plot_tiles(path: Path, tile: Tile, region: BaseGeometry, count: int) -> None:
    """Draw the print `region` in m on count × count tiles and the border of one."""
    title = f"{count} × {count} tiles; the framed one is repeated"
    with style.page(path, title, style.TALL) as figure:
        axes = figure.add_axes((0.02, 0.03, 0.96, 0.86))
        corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) @ tile.lattice * 1e3
        axes.add_collection(PolyCollection([count * corner[:-1]], facecolors=[style.FABRIC]))
        style.fill(axes, region, style.PRINT)
        border = corner + (count // 2) * tile.lattice.sum(axis=0) * 1e3
        axes.plot(*border.T, color=style.ACCENT, lw=1.2)
        _to_scale(axes)
        style.bar_below(axes)


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
    """Draw a sheet before and after the pull to `positions` (n, 3) in m, to scale."""
    size = np.ptp(np.concatenate([pattern.points, positions]), axis=0)[:2]
    grid = (1, 2) if size[1] > size[0] else (2, 1)
    with style.page(path, title[:1].upper() + title[1:], style.TALL) as figure:
        where = {"left": 0.02, "right": 0.98, "bottom": 0.03, "top": 0.86, "hspace": 0.15}
        row = figure.subplots(*grid, sharex=True, sharey=True, gridspec_kw=where)
        for axes, name, points in zip(
            row, ("before", "pulled"), (pattern.points, positions), strict=True
        ):
            corners = points[pattern.triangles, :2]
            style.fill(axes, region_of_triangles(corners), style.FABRIC, edge=style.EDGE)
            style.fill(axes, region_of_triangles(corners[printed]), style.PRINT)
            axes.set_title(name, color=style.SOFT)
            _to_scale(axes)
        style.bar_below(row[-1])


def region_of_triangles(triangles: Floats) -> BaseGeometry:
    """Return the union of triangles (t, 3, 2) of one mesh."""
    return shapely.simplify(shapely.coverage_union_all(shapely.polygons(triangles)), COLLINEAR)


def _to_scale(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
