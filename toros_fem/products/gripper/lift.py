"""Object, pictures and frames of a gripper that lifts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.files import guarded, if_plotting
from toros_fem.measures.gap import Body
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.solids import rigid_box, rigid_sphere
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.results.frames import Frame, ShownSkin
from toros_fem.results.record import repeated, write_series

# Directions of a finger's frame: from the mount to the tip, and towards the object.
ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
# Rays on which a body's surface is found, over its size: it lies no further out.
FARTHEST = 2.0
# Half the width of the post and its distance from the object in pictures, over the object's size.
POST, BELOW = 0.06, 0.01
VIEW = (12.0, 25.0)


LiftShape = tuple[str, Floats, float, float]
"""Fingers and object at one moment of a lift: a title, positions of the vertices of one whole
finger in its frame, (n, 3), by how far the object has moved down, seen from the mounts, and by how
far the mounts have moved up, all in m."""


def solid(body: Body) -> RigidBody:
    """Return a sphere, or a box with rounded edges, as a rigid body."""
    if body.shape == "sphere":
        return rigid_sphere("object", body.size / 2, body.centre)
    ball = rigid_sphere("object", 1.0)
    rays = ball.points / np.linalg.norm(ball.points, axis=1)[:, None]
    low: Floats = np.zeros(len(rays))
    high: Floats = np.full(len(rays), FARTHEST * body.size)
    for _ in range(50):  # each ray from the centre leaves the body once
        middle = (low + high) / 2
        outside = body.distance(body.centre + middle[:, None] * rays)[0] > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    return RigidBody("object", body.centre + low[:, None] * rays, ball.triangles)


def write_lift(
    comm: MPI.Comm,
    folder: Path,
    pattern: Pattern,
    rows: Sequence[tuple[Floats, Sequence[LiftShape]]],
    regions: Regions,
    body: RigidBody,
    fingers: int,
    title: str,
) -> None:
    """Write frames, and a picture of all fingers around the object (collective).

    Args:
        pattern: The pattern of one whole finger.
        rows: Density of its triangles, (t,), and shapes of a lift, a row of the picture each; the
            last one is that of the print.
        regions: Print on each of its panels, polygons in m.
        body: The object before the lift, in the finger's frame.
        fingers: Number of fingers around it.
        title: A sentence with the result.

    Raises:
        OutputError: A file cannot be written.
    """
    axis, post = float(body.centre[2]), _post(body)
    angles = 2 * np.pi * np.arange(fingers) / fingers
    every, prints = repeated(pattern, regions, fingers)

    def fingers_of(positions: Floats, raised: float) -> Floats:
        up = [0.0, 0.0, raised]
        return np.concatenate([in_room(positions, axis, angle) + up for angle in angles])

    def object_of(height: float) -> Floats:
        return in_room(body.points, axis, 0.0) + [0.0, 0.0, height]

    def draw() -> None:
        from toros_fem.results.pictures.raster import DrawnSurface
        from toros_fem.results.pictures.shapes import plot_states
        from toros_fem.results.pictures.shown import DrawnSkin
        from toros_fem.results.pictures.style import BODY
        from toros_fem.results.pictures.view import View

        stand = DrawnSurface(post.triangles, post.points, BODY, closed=True)
        states = []
        for density, row in rows:
            # The print itself is drawn where there is one.
            printed = density is rows[-1][0]
            drawn = DrawnSkin(
                ShownSkin(every, regions=prints if printed else None), np.tile(density, fingers)
            )
            states.append(
                [
                    (
                        name,
                        [
                            *drawn.surfaces(fingers_of(positions, raised)),
                            DrawnSurface(
                                body.triangles, object_of(raised - sunk), BODY, closed=True
                            ),
                            stand,
                        ],
                    )
                    for name, positions, sunk, raised in row
                ]
            )
        plot_states(folder / "lift.png", states, View(*VIEW), title)

    def write() -> None:
        _, positions, sunk, raised = rows[-1][1][-1]
        skin = ShownSkin(every, regions=prints, body=(object_of(raised - sunk), body.triangles))
        write_series(folder, skin, [Frame("load", 0, "", fingers_of(positions, raised), None, {})])
        if_plotting(draw)

    guarded(comm, folder, write)


def in_room(points: Floats, axis: float, angle: float) -> Floats:
    """Return points of a finger's frame in the room: z up, the object's axis at x = y = 0.

    Args:
        points: Points, (n, 3), in m.
        axis: Distance in m of the object's axis from the flat finger.
        angle: Angle in rad of the finger around the axis.
    """
    out = axis - points[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    y = -points[:, 1]  # mirrored like z, since otherwise the skin would be inside out
    return np.column_stack([c * out - s * y, s * out + c * y, -points[:, 0]])


def from_room(points: Floats, axis: float) -> Floats:
    """Return points of the room in the frame of the finger at the angle 0, as of `in_room`."""
    x, y, z = points.T
    return np.column_stack([-z, -y, axis - x])


def _post(body: RigidBody) -> RigidBody:
    """Return a post below the object, in the room."""
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    size = float((high - low).max())
    half = np.array([POST * size, POST * size, size / 2])
    return rigid_box("post", 2 * half, (0.0, 0.0, -high[0] - BELOW * size - half[2]))
