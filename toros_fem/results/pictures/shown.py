"""Skins in space as they are drawn: print, target, bodies and lines on them; axes in mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.making.printability import printed_fractions
from toros_fem.meshes.triangles import equilateral_edge
from toros_fem.results.pictures.raster import (
    DrawnSurface,
    Image,
    Ink,
    View,
    Window,
    ink_of,
    oblique_view,
    render,
    side_view,
    window_of,
)
from toros_fem.results.pictures.style import (
    ACCENT,
    BODY,
    DPI,
    FABRIC,
    GROUND,
    PRINT,
    Box,
    bar_length,
    note,
    scale_bar,
)
from toros_fem.results.runs.frames import ShownSkin

# Lines on a skin: fractions of the width of its largest panel.
LINES = (0.25, 0.5, 0.75)
# Effect of light on colours that are data, and brightness of the print beside fabric there.
DATA, DARKER = 0.5, 0.8
# A line is hidden where it is this far behind what is seen, over the size of the skin.
HIDDEN = 0.02
# Distance in points of the points that stand for a covered area.
EVERY = 3.0


class DrawnSkin:
    """A skin, ready to be drawn in any of its states.

    Where it has no print, the density of all triangles, (t,), is shown; None for bare fabric.
    """

    def __init__(self, skin: ShownSkin, density: Floats | None = None) -> None:
        self.skin, self.pattern = skin, skin.pattern
        self._density = density
        self._closed = len(skin.pattern.free_edges) == 0

    @cached_property
    def ink(self) -> Ink | None:
        """The print, to draw with."""
        regions = self.skin.regions
        return None if regions is None else ink_of(self.pattern, regions)

    @cached_property
    def print_share(self) -> Floats:
        """Printed fraction of each triangle, (t,); without a print it is the density."""
        if self.skin.regions is not None:
            return printed_fractions(self.pattern, self.skin.regions)
        if self._density is None:
            return np.zeros(len(self.pattern.triangles))
        return np.clip(np.nan_to_num(self._density), 0, 1)

    @cached_property
    def lines(self) -> Sequence[tuple[Ints, Floats]]:
        """Lines along the largest panel, at `LINES` of its width, by which twist is seen.

        Of each point of a line there are its triangle, (m,), and its weights, (m, 3).
        """
        pattern = self.pattern
        areas = np.bincount(pattern.panel, pattern.areas, len(pattern.panel_names))
        cells = np.flatnonzero(pattern.panel == np.argmax(areas))
        flat = pattern.corners[cells]
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        across = int(np.argmin(high - low))
        edge = equilateral_edge(pattern.areas[cells].mean())
        lines: list[tuple[Ints, Floats]] = []
        for fraction in LINES:
            # No vertex lies on it.
            level = low[across] + fraction * (high - low)[across] + 1e-6 * edge
            triangle, weights = _crossings(flat[..., across] - level)
            along = np.einsum("mi,mi->m", weights, flat[triangle, :, 1 - across])
            order = np.argsort(along, kind="stable")
            parts = np.split(order, np.flatnonzero(np.diff(along[order]) > 3 * edge) + 1)
            lines += [(cells[triangle[k]], weights[k]) for k in parts if len(k) > 1]
        return lines

    def surfaces(self, positions: Floats, colours: Floats | None = None) -> list[DrawnSurface]:
        """Return the skin at positions of all vertices, (n, 3), in m, and the body beside it.

        Colours, as of a `DrawnSurface`, take the place of fabric and print.
        """
        skin = DrawnSurface(
            self.pattern.triangles, positions, FABRIC, self.ink, closed=self._closed
        )
        if colours is not None:
            skin = replace(skin, colour=colours, contrast=DATA, ink_shade=DARKER)
        elif self.ink is None:
            skin = replace(skin, colour=FABRIC + self.print_share[:, None] * (PRINT - FABRIC))
        drawn = [skin]
        if self.skin.body is not None:
            points, triangles = self.skin.body
            drawn.append(DrawnSurface(triangles, points, BODY, closed=True))
        return drawn

    def views(self, positions: Floats) -> tuple[View, View]:
        """Return the side view and the oblique view of a state, by its target if it has one."""
        target = self.skin.target
        side = side_view(positions if target is None else target)
        return side, oblique_view(self.pattern.triangles, positions, self.print_share, side)


def _crossings(values: Floats) -> tuple[Ints, Floats]:
    """Return triangle and barycentric coordinates of zeros on edges, of values (t, 3)."""
    following = np.roll(values, -1, axis=1)
    triangle, first = np.nonzero(values * following < 0)
    here, there = values[triangle, first], following[triangle, first]
    part = (here / (here - there))[:, None]
    corner = np.eye(3)
    return triangle, (1 - part) * corner[first] + part * corner[(first + 1) % 3]


def visible(points: Floats, view: View, image: Image, size: float) -> Bools:
    """Return whether points in space, (m, 3), are seen on a picture of surfaces of a size in m."""
    height, width = image.depth.shape
    window = image.window
    share = (view.project(points) - window.low) / (window.high - window.low)
    column = (share[:, 0] * width).astype(int)
    row = ((1 - share[:, 1]) * height).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    depth = image.depth[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.asarray(inside & (view.depth(points) >= depth - HIDDEN * size))


def ground_below(points: Floats, height: float) -> Floats:
    """Return the corners in space, (4, 3), of the ground below points, (n, 3), at a height in m."""
    low, high = points.min(axis=0), points.max(axis=0)
    reach = 0.1 * float(np.ptp(points[:, :2], axis=0).max())
    (left, front), (right, back) = low[:2] - reach, high[:2] + reach
    return np.array(
        [[x, y, height] for x, y in ((left, front), (right, front), (right, back), (left, back))]
    )


class Axonometry:
    """A part of a page with a view in space of points (n, 3), in m, that must be seen.

    Further room around them is left at the left, right, bottom and top, over their extent.
    """

    def __init__(
        self,
        figure: Figure,
        box: Box,
        view: View,
        points: Floats,
        room: Box = (0.0, 0.0, 0.0, 0.0),
    ) -> None:
        self.view = view
        flat = view.project(points)
        low, size = flat.min(axis=0), np.ptp(flat, axis=0)
        left, right, below, above = room
        wider = np.array([low - size * [left, below], low + size * [1 + right, 1 + above]])
        width, height = figure.get_size_inches() * box[2:]
        self.window: Window = window_of(wider, width / height, round(width * DPI))
        self.size = float(np.ptp(points, axis=0).max())
        low, high = 1e3 * self.window.low, 1e3 * self.window.high
        self._extent = (low[0], high[0], low[1], high[1])
        self.axes: Axes = figure.add_axes(box)
        self.axes.set_axis_off()
        self._covered: list[Floats] = []
        self._limit()

    @property
    def covered(self) -> Floats:
        """Points in mm, (n, 2), close to each other, of all that surfaces and outlines cover."""
        return np.concatenate([np.zeros((0, 2)), *self._covered])

    def draw(self, surfaces: Sequence[DrawnSurface], opacity: float = 1.0) -> Image:
        """Draw surfaces, and return their picture."""
        image = render(surfaces, self.view, self.window)
        (left, low), (right, high) = 1e3 * image.window.low, 1e3 * image.window.high
        self.axes.imshow(
            image.colours, extent=(left, right, low, high), interpolation="none", alpha=opacity
        )
        self._covered.append(_filled(image))
        self._limit()
        return image

    def outline(self, drawn: DrawnSkin, positions: Floats) -> None:
        """Draw the dashed outline of a target, and its lines where they are seen."""
        image = render(drawn.surfaces(positions)[:1], self.view, self.window)
        # What is cut off at the border of the view has no outline there.
        covered = np.pad(np.flipud(image.colours[..., 3]), 1, mode="edge")
        window, pixel = image.window, 1 / image.window.scale
        (left, low), (right, high) = 1e3 * (window.low - pixel), 1e3 * (window.high + pixel)
        self.axes.contour(
            covered, levels=[127.5], colors=[ACCENT], linewidths=1.6, linestyles="--",
            extent=(left, right, low, high),
        )  # fmt: skip
        self._covered.append(_filled(image))
        self.lines(drawn, positions, image, ACCENT, ":")

    def lines(
        self, drawn: DrawnSkin, positions: Floats, image: Image, colour: str, style: str = "-"
    ) -> None:
        """Draw the lines of a skin where they are seen on its picture."""
        for triangle, weights in drawn.lines:
            corners = positions[drawn.pattern.triangles[triangle]]
            points = np.einsum("mi,mic->mc", weights, corners)
            flat = 1e3 * self.view.project(points)
            flat[~visible(points, self.view, image, self.size)] = np.nan
            self.axes.plot(*flat.T, color=colour, ls=style, lw=0.9)

    def ground(self, height: float, points: Floats) -> None:
        """Draw the ground below points in space, (n, 3), at a height in m."""
        flat = 1e3 * self.view.project(ground_below(points, height))
        if np.ptp(flat[:, 1]) > 0.01 * np.ptp(flat[:, 0]):
            self.axes.fill(*flat.T, color=GROUND, zorder=-1)
        else:
            self.axes.axhline(float(flat[:, 1].mean()), color="0.6", lw=1, zorder=-1)

    def arrow(self, tail: Floats, tip: Floats, colour: str) -> None:
        """Draw an arrow between two points of the view, (2,) in mm each."""
        look = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
        (x, y), (left, low) = tip, tail
        self.axes.annotate("", (x, y), (left, low), zorder=6, arrowprops=look)

    def way(self, begin: Floats, end: Floats, colour: str) -> None:
        """Draw an arrow between two points in space, (3,) in m each, with its length in mm."""
        tail, tip = 1e3 * self.view.project(np.stack([begin, end]))
        self.arrow(tail, tip, colour)
        words = f"{1e3 * np.linalg.norm(end - begin):.3g} mm"
        note(self.axes, words, (tail + tip) / 2, (0, -3), colour, ha="center", va="top")

    def bar(self) -> None:
        """Draw a bar that shows the scale."""
        box = self.axes.get_position()
        left = max(0.02, (0.02 - box.x0) / box.width)  # at least as far from the border as a title
        scale_bar(self.axes, bar_length(self._extent[1] - self._extent[0]), (left, 0.03))

    def caption(self, words: str, at: float, up: float) -> None:
        """Write words below a height, over that of the axes, which is moved by some points."""
        note(self.axes, words, (0.5, at), (0, up), xycoords="axes fraction", ha="center", va="top")

    def _limit(self) -> None:
        self.axes.set_xlim(self._extent[:2])
        self.axes.set_ylim(self._extent[2:])


def _filled(image: Image) -> Floats:
    """Return points in mm, (n, 2), `EVERY` points apart, of what a picture covers."""
    step = max(1, round(EVERY * DPI / 72))
    rows, columns = np.nonzero(image.colours[..., 3])
    wide = image.colours.shape[1] // step + 1
    row, column = np.divmod(np.unique(rows // step * wide + columns // step), wide)
    window = image.window
    across, up = (np.array([column, row]) + 0.5) * step / window.scale
    return 1e3 * np.column_stack([window.low[0] + across, window.high[1] - up])
