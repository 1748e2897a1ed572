"""Colours of all pictures, filled regions, and skins in space on axes in mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import LightSource
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats, Ints

FABRIC = np.array([0.93, 0.86, 0.72])
PRINTED = np.array([0.13, 0.20, 0.33])
TARGET = np.array([0.62, 0.76, 0.62])
DPI = 150
# Direction to the light: to the right, upwards and towards the viewer.
LIGHT = (-0.35, 0.45, 0.82)


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


def frame(axes: Axes, points: Floats, view: View) -> None:
    """Set limits and scale of axes in mm to points, (n, 3), in m, seen from a direction."""
    axes.update_datalim(1e3 * view.project(points))
    axes.set_aspect("equal")
    axes.autoscale_view()


def draw_polygons(axes: Axes, polygons: Sequence[Floats], colours: Floats, view: View) -> None:
    """Draw shaded polygons in space, those behind hidden by those before.

    Matplotlib's three-dimensional axes are square and have no room for ticks in a plane. They are
    laid over the given axes in the same scale. So the figure must have its final layout, and the
    limits must be set by `frame`.

    Args:
        axes: Axes in mm.
        polygons: Corners of each polygon, (k, 3), in m, counter-clockwise from outside.
        colours: Colour of each polygon, (p, 3) or (p, 4).
        view: Where the viewer is.
    """
    figure, directions = axes.figure, view.directions
    points = 1e3 * np.concatenate(polygons)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    space: Any = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho", facecolor="none")
    space.set_in_layout(False)
    space.set_axis_off()
    low, high = centre - radius, centre + radius
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect((1, 1, 1))
    space.view_init(elev=view.elevation, azim=view.turn - 90)
    space.apply_aspect()
    # Matplotlib sets scale and place of its box: they are measured, and the square put accordingly.
    ends = np.stack([centre, centre + radius * directions[0]])
    there = space.transAxes.inverted().transform(
        space.transData.transform(np.transpose(proj_transform(*ends.T, space.get_proj())[:2]))
    )
    here = axes.transData.transform(view.project(ends))
    side = np.ptp(here[:, 0]) / np.ptp(there[:, 0])
    size = np.array(figure.bbox.size)
    space.set_position((*((here[0] - side * there[0]) / size), *(side / size)))
    light = np.asarray(LIGHT) @ directions / np.linalg.norm(LIGHT)
    space.add_collection3d(
        Poly3DCollection(
            [1e3 * np.asarray(polygon) for polygon in polygons],
            facecolors=colours,
            edgecolors=colours,
            linewidths=0.6,
            shade=True,
            lightsource=LightSource(
                azdeg=90 - np.degrees(np.arctan2(light[1], light[0])),
                altdeg=np.degrees(np.arcsin(light[2])),
            ),
        ),
        autolim=False,
    )


def draw_skin(axes: Axes, triangles: Ints, points: Floats, colours: Floats, view: View) -> None:
    """Draw the outside of a closed skin; arguments as of `draw_polygons`.

    The inside is left out: where two panels lie on each other, as in a flat target, only the one
    towards the viewer is to be seen.

    Args:
        axes: Axes in mm.
        triangles: Vertices of each triangle, (t, 3).
        points: Positions of all vertices, (n, 3), in m.
        colours: Colour of each triangle, (t, 3).
        view: Where the viewer is.
    """
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outside = normal @ view.directions[2] > 0
    draw_polygons(axes, list(corners[outside]), colours[outside], view)
