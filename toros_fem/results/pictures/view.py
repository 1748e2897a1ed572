"""Directions that pictures, pages and films show a skin from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import normals

# Turns about z that are tried for the side view, and for the oblique one beside it, in degrees.
# The latter is from the same side, so that both views are seen to be of one body.
SIDE_TURNS, OBLIQUE_TURNS = range(0, 180, 15), (-60, -45, -30, 30, 45, 60)
# Elevation of the oblique view in degrees.
ABOVE = 20.0
# The side view is turned only where the points spread this many times further by it.
WIDER = 1.1
# Weight of bare fabric beside print, where a view is judged by what it shows.
BARE = 0.3


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


def side_view(points: Floats) -> View:
    """Return the horizontal view that spreads the points (n, 3), in m, of a shape most.

    It looks across the plane of a bent tube. A shape whose points spread about as much from
    everywhere, as those of equal legs do, is seen along y.
    """
    views = [View(0.0, float(turn)) for turn in SIDE_TURNS]
    widths = [float(np.std(view.project(points)[:, 0])) for view in views]
    best = int(np.argmax(widths))
    return views[best] if widths[best] > WIDER * widths[0] else views[0]


def oblique_view(triangles: Ints, points: Floats, print_share: Floats, side: View) -> View:
    """Return the view from above that shows most of the shape and of its print.

    It is turned against the side view, so that both together tell the shape. That a part of the
    skin may hide another is not considered. The share is the printed part of each triangle, (t,).
    """
    areas, weights = normals(points, triangles) / 2, BARE + print_share

    def score(view: View) -> float:
        seen = np.maximum(areas @ view.directions[2], 0) @ weights
        return float(seen * np.sqrt(np.prod(np.ptp(view.project(points), axis=0))))

    return max((View(ABOVE, side.turn + turn) for turn in OBLIQUE_TURNS), key=score)
