"""What is drawn of a skin in space: its print, its target, bodies beside it, and lines on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.making.print.printability import printed_fractions
from toros_fem.meshes.triangles import equilateral_edge
from toros_fem.results.frames import ShownSkin
from toros_fem.results.pictures.raster import DrawnSurface, Image, Ink, ink_of
from toros_fem.results.pictures.style import BODY, FABRIC, PRINT
from toros_fem.results.pictures.view import View, oblique_view, side_view

# Lines on a skin: fractions of the width of its largest panel.
LINES = (0.25, 0.5, 0.75)
# Effect of light on colours that are data, and brightness of the print beside fabric there.
DATA, DARKER = 0.5, 0.8
# A line is hidden where it is this far behind what is seen, over the size of the skin.
HIDDEN = 0.02


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
