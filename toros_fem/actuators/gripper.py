"""Figures and pictures of a gripper that is closed on an object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats, Ints
from toros_fem.frames.files import Frame
from toros_fem.frames.record import repeated, write_series
from toros_fem.frames.shown_skin import ShownSkin
from toros_fem.meshes.cut_triangles import cut_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.gap import Body
from toros_fem.output.files import write_json
from toros_fem.output.writer import if_plotting, write_together

FINGERS = 3


def write_grasp(
    comm: MPI.Comm,
    folder: Path,
    pattern: Pattern,
    positions: Floats,
    regions: Sequence[BaseGeometry],
    body: Body,
    figures: Mapping[str, Any],
) -> None:
    """Write load.json and pictures of three equal fingers around the object (collective).

    The fingers hang down along their own x; their own z points to the object's axis.

    Args:
        comm: Communicator.
        folder: Output folder, which exists.
        pattern: The pattern of one whole finger.
        positions: Positions of its vertices, (n, 3), in m.
        regions: Print on each of its panels, polygons in m.
        body: The object, in the finger's frame.
        figures: Content of load.json.

    Raises:
        OutputError: A file cannot be written.
    """

    def write() -> None:
        write_json(folder / "load.json", figures)
        around = 2 * np.pi * np.arange(FINGERS) / FINGERS
        fingers = [_in_room(positions, body, angle) for angle in around]
        ball, faces = _body_mesh(body)
        points = np.concatenate([*fingers, _in_room(ball, body, 0.0)])
        triangles, count = pattern.triangles, len(positions)
        cells = np.concatenate(
            [triangles + k * count for k in range(FINGERS)] + [faces + FINGERS * count]
        )
        bare, other = np.zeros(len(triangles)), np.full(len(faces), np.nan)
        printed = cut_triangles(pattern, regions)
        shapes = [("closed on the object", points)]
        three, prints = repeated(pattern, regions, FINGERS)
        skin = ShownSkin(three, regions=prints, body=(_in_room(ball, body, 0.0), faces))
        write_series(folder, skin, [Frame("load", 0, "", np.concatenate(fingers), None, {})])
        side = np.concatenate([fingers[0], _in_room(ball, body, 0.0)])

        def draw() -> None:
            from toros_fem.output.shape_plot import plot_shapes

            plot_shapes(
                folder / "grasp.png",
                cells,
                shapes,
                np.append(np.tile(bare, FINGERS), other),
                view=(15.0, 25.0),
                printed=printed.repeated(FINGERS, len(triangles)),
            )
            plot_shapes(
                folder / "finger.png",
                np.concatenate([triangles, faces + count]),
                [("one finger, from the side", side)],
                np.append(bare, other),
                printed=printed,
            )

        if_plotting(draw)

    write_together(comm, folder, write)


def _in_room(points: Floats, body: Body, angle: float) -> Floats:
    """Return points of a finger's frame in the room: z up, the object's axis at x = y = 0."""
    out = body.centre[2] - points[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    y = -points[:, 1]  # mirrored like z, since otherwise the skin would be inside out
    return np.column_stack([c * out - s * y, s * out + c * y, -points[:, 0]])


def _body_mesh(body: Body, count: int = 48) -> tuple[Floats, Ints]:
    """Return a mesh of the object's surface, oriented outwards, in the finger's frame."""
    polar, turn = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, count // 2 + 1), np.linspace(0, 2 * np.pi, count + 1)
    )
    rays = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=2
    ).reshape(-1, 3)
    low: Floats = np.zeros(len(rays))
    high: Floats = np.full(len(rays), 2 * body.size)
    for _ in range(50):  # each ray from the centre leaves the object once
        middle = (low + high) / 2
        outside = body.distance(body.centre + middle[:, None] * rays)[0] > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    node = np.arange(len(rays)).reshape(polar.shape)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]
    faces = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], 2).reshape(-1, 3)
    return body.centre + low[:, None] * rays, faces
