"""Colours of all pictures, filled regions, and skins in space on axes in mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.panels import CutTriangles

FABRIC = np.array([0.93, 0.86, 0.72])
PRINTED = np.array([0.13, 0.20, 0.33])
TARGET = np.array([0.62, 0.76, 0.62])
DPI = 150
# Direction to the light: to the left, upwards and towards the viewer.
LIGHT = np.array([-0.35, 0.45, 0.82])
# Brightness of a surface across the light, and what it gains towards the light.
SHADE = 0.65, 0.35
# Polygons are drawn wider by half of this, in points, so that no line shows between neighbours.
OVERLAP = 0.4


def fill(axes: Axes, shape: BaseGeometry, colour: Floats, edge: str = "none") -> None:
    """Fill a region given in m on axes in mm."""
    for polygon in shapely.get_parts(shape):
        if polygon.is_empty:
            continue
        rings = [shapely.get_coordinates(r) * 1e3 for r in (polygon.exterior, *polygon.interiors)]
        codes = [
            [Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY]
            for ring in rings
        ]
        outline = Outline(np.concatenate(rings), np.concatenate(codes))
        axes.add_patch(PathPatch(outline, facecolor=colour, edgecolor=edge, lw=0.8))


@dataclass(frozen=True)
class View:
    """Orthographic view; at (0, 0) the viewer looks along +y, with x to the right and z upwards.

    Attributes:
        elevation: Angle in degrees by which the viewer is above the x-y plane.
        turn: Angle in degrees by which the viewer is turned about z.
    """

    elevation: float = 0.0
    turn: float = 0.0

    @property
    def directions(self) -> Floats:
        """Unit vectors to the right, upwards and towards the viewer, as rows."""
        e, t = np.radians([self.elevation, self.turn])
        right = np.array([np.cos(t), np.sin(t), 0])
        toward = np.array([np.sin(t) * np.cos(e), -np.cos(t) * np.cos(e), np.sin(e)])
        return np.stack([right, np.cross(toward, right), toward])

    def project(self, points: Floats) -> Floats:
        """Return the coordinates (…, 2) of points (…, 3) on the picture."""
        return np.asarray(points @ self.directions[:2].T)

    def depth(self, points: Floats) -> Floats:
        """Return how far points (…, 3) lie towards the viewer, (…,)."""
        return np.asarray(points @ self.directions[2])


def frame(axes: Axes, points: Floats, view: View) -> None:
    """Set limits and scale of axes in mm to points, (n, 3), in m, seen from a direction."""
    axes.update_datalim(1e3 * view.project(points))
    axes.set_aspect("equal")
    axes.autoscale_view()


def draw_polygons(axes: Axes, polygons: Sequence[Floats], colours: Floats, view: View) -> None:
    """Draw shaded polygons in space, those behind hidden by those before.

    They are sorted by their mean depth.

    Args:
        axes: Axes in mm.
        polygons: Corners of each polygon, (k, 3), in m, counter-clockwise from outside.
        colours: Colour of each polygon, (p, 3) or (p, 4).
        view: Where the viewer is.
    """
    normals = np.array([np.cross(p[1] - p[0], p[2] - p[0]) for p in polygons])
    depth = np.array([view.depth(polygon).mean() for polygon in polygons])
    outlines = [Outline(1e3 * view.project(polygon), closed=False) for polygon in polygons]
    _add(axes, outlines, _shaded(colours, normals, view), np.argsort(depth, kind="stable"))


def draw_skin(
    axes: Axes,
    triangles: Ints,
    points: Floats,
    colours: Floats,
    view: View,
    printed: CutTriangles | None = None,
) -> None:
    """Draw the outside of a closed skin, and its print with the borders that it has.

    The inside is left out: where two panels lie on each other, as in a flat target, only the one
    towards the viewer is to be seen.

    Args:
        axes: Axes in mm.
        triangles: Vertices of each triangle, (t, 3).
        points: Positions of all vertices, (n, 3), in m.
        colours: Colour of each triangle, (t, 3).
        view: Where the viewer is.
        printed: The print; None for none.
    """
    corners = points[triangles]
    sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.asarray(np.cross(*sides), dtype=np.float64)
    seen = normals @ view.directions[2] > 0
    flat, depth = 1e3 * view.project(corners), view.depth(corners).mean(axis=1)
    cut = np.zeros(len(triangles), dtype=bool)
    if printed is not None:
        cut[printed.cell] = True
    cells = np.flatnonzero(seen & ~cut)
    outlines, inks = [Outline(flat[cell]) for cell in cells], colours[cells]
    on_top: Bools = np.zeros(len(cells), dtype=bool)
    if printed is not None:
        shown = np.flatnonzero(seen[printed.cell])
        parts, inside = _outlines(printed, flat), printed.inside[shown]
        outlines += [parts[k] for k in shown]
        own = np.where(inside[:, None], PRINTED, colours[printed.cell[shown]])
        cells, inks = np.append(cells, printed.cell[shown]), np.concatenate([inks, own])
        on_top = np.append(on_top, inside)
    # The print of a triangle is on top of its fabric, so that it has the border.
    order = np.lexsort((on_top, cells, depth[cells]))
    _add(axes, outlines, _shaded(inks, normals[cells], view), order)


def _outlines(printed: CutTriangles, corners: Floats) -> list[Outline]:
    """Return the outline of each polygon, from the corners of the triangles, (t, 3, 2)."""
    points = printed.corners(corners)
    codes = np.full(len(points), Outline.LINETO, dtype=Outline.code_type)
    codes[printed.first[:-1]] = Outline.MOVETO
    codes[printed.first[1:] - 1] = Outline.CLOSEPOLY
    starts = printed.first[np.searchsorted(printed.polygon, np.arange(1, len(printed.cell)))]
    pairs = zip(np.split(points, starts), np.split(codes, starts), strict=True)
    return [Outline(corner, code) for corner, code in pairs] if len(points) else []


def _shaded(colours: Floats, normals: Floats, view: View) -> Floats:
    """Return colours, (p, 3) or (p, 4), in the light, of polygons with normals of any length."""
    length = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    light = LIGHT @ view.directions / np.linalg.norm(LIGHT)
    brightness = SHADE[0] + SHADE[1] * (normals @ light) / length
    shaded = np.array(colours, dtype=np.float64)
    shaded[:, :3] *= brightness[:, None]
    return shaded


def _add(axes: Axes, outlines: Sequence[Outline], colours: Floats, order: Ints) -> None:
    """Draw filled outlines, those that come first in an order below the others."""
    sorted_colours = colours[order]
    axes.add_collection(
        PathCollection(
            [outlines[k] for k in order],
            facecolors=sorted_colours,
            edgecolors=sorted_colours,
            linewidths=OVERLAP,
            joinstyle="bevel",
        ),
        autolim=False,
    )
