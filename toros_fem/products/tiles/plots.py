"""Pictures of a tile: profile, curves, pattern, deformed shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.tiles import SYMMETRIES, Tile
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileTarget
from toros_fem.results.pictures import style

# Directions that differ by less than a part of this, in rad, are the same.
ROUND = 1e9
# Corners of triangles closer than this to a straight border of the print, in m, are left out.
COLLINEAR = 1e-9
# Most circles of a polar chart, so that their numbers stay apart.
RINGS = 4
# Points that the lines of a polar chart are divided into; room around the numbers of its circles in
# pixels, and angles in degrees along which they are tried, between those that have names.
SAMPLES, ROOM, TURNS = 2000, 2.0, [one + 45 * k for k in range(8) for one in (22.5, 15.0, 30.0)]
# Inches: width and height of all panes of a page at most, the space around them, that for a title
# and for names above them, and that for a bar of the scale below them.
MOST, AROUND, TITLED, NAMED, BAR = (7.0, 5.2), 0.16, 0.5, 0.3, 0.4
# Least width of a page with its title in inches; panes flatter than this stand below one another.
LEAST, FLAT = 4.5, 0.4


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
            if isinstance(axes, PolarAxes):
                axes.yaxis.set_major_locator(MaxNLocator(RINGS))
                _turn_ring_numbers(axes)
        right.set_title("lateral contraction", pad=14)
        words = [("— printed", style.DARK), ("- - fabric without print", style.SOFT)]
        words += [("○ target", style.ACCENT)] if target is not None else []
        for k, (text, colour) in enumerate(words):
            figure.text(0.02, 0.10 - 0.04 * k, text, color=colour)


def _turn_ring_numbers(axes: PolarAxes) -> None:
    """Write the numbers of circles along the direction in which they cover curves least."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    curves = []
    for line in axes.lines:
        turn, value = np.array(line.get_data(), dtype=float)
        fine, at = np.linspace(0, len(turn) - 1, SAMPLES), np.arange(len(turn))
        points = np.column_stack([np.interp(fine, at, turn), np.interp(fine, at, value)])
        curves.append(axes.transData.transform(points))
    drawn = np.concatenate(curves)

    def covered(angle: float) -> int:
        axes.set_rlabel_position(angle)
        figure.draw_without_rendering()
        shown = [text for text in axes.get_yticklabels() if text.get_text()]
        return sum(text.get_window_extent().padded(ROOM).count_contains(drawn) for text in shown)

    axes.set_rlabel_position(min(TURNS, key=covered))


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
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) @ tile.lattice * 1e3
    size, (box,) = _panes(count * corner, 1)
    with style.page(path, title, size) as figure:
        axes = _pane(figure, box, count * corner)
        axes.add_collection(PolyCollection([count * corner[:-1]], facecolors=[style.FABRIC]))
        style.fill(axes, region, style.PRINT)
        border = corner + (count // 2) * tile.lattice.sum(axis=0) * 1e3
        axes.plot(*border.T, color=style.ACCENT, lw=1.2)
        _write_bar(axes)


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
    every = 1e3 * np.concatenate([pattern.points, positions])[:, :2]
    size, boxes = _panes(every, 2)
    with style.page(path, title[:1].upper() + title[1:], size) as figure:
        panes = [_pane(figure, box, every) for box in boxes]
        for axes, name, points in zip(
            panes, ("before", "pulled"), (pattern.points, positions), strict=True
        ):
            corners = points[pattern.triangles, :2]
            style.fill(axes, region_of_triangles(corners), style.FABRIC, edge=style.EDGE)
            style.fill(axes, region_of_triangles(corners[printed]), style.PRINT)
            axes.set_title(name, color=style.SOFT)
        _write_bar(panes[0])


def _panes(points: Floats, count: int) -> tuple[tuple[float, float], list[style.Box]]:
    """Return the size of a page in inches, and places on it for panes that show points, (n, 2).

    They stand beside each other, flat ones below one another; the page leaves no more space.
    """
    extent = np.ptp(points, axis=0)
    across, down = (1, count) if extent[1] < FLAT * extent[0] else (count, 1)
    width, height = extent / max(extent * [across, down] / MOST)
    named = NAMED if count > 1 else 0.0
    wide = max(across * (width + AROUND) + AROUND, LEAST)
    tall = TITLED + down * (height + named) + BAR
    left = (wide - across * (width + AROUND) + AROUND) / 2
    boxes = []
    for k in range(count):
        row, column = divmod(k, across)
        low = tall - TITLED - (row + 1) * (height + named)
        box = (left + column * (width + AROUND)) / wide, low / tall, width / wide, height / tall
        boxes.append(box)
    return (wide, tall), boxes


def _pane(figure: Figure, box: style.Box, points: Floats) -> Axes:
    """Return axes in mm that show points, (n, 2)."""
    axes = figure.add_axes(box)
    axes.set_axis_off()
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(left, right), ylim=(low, high))
    return axes


def _write_bar(axes: Axes) -> None:
    """Draw a bar of the scale below a pane."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    below = -0.75 * BAR / (figure.get_figheight() * axes.get_position().height)
    style.scale_bar(axes, style.bar_length(float(np.ptp(axes.get_xlim()))), (0.0, below))


def region_of_triangles(triangles: Floats) -> BaseGeometry:
    """Return the union of triangles (t, 3, 2) of one mesh."""
    return shapely.simplify(shapely.coverage_union_all(shapely.polygons(triangles)), COLLINEAR)
