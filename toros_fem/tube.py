"""The capped tube that bends, shortens or twists (paper Fig. 8): what its demos share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.meshes.cylinder import BASE, TIP, WALL, cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.targets import Deformer
from toros_fem.parameters import require_between
from toros_fem.scene import Scene
from toros_fem.supports import clamp

Floats = npt.NDArray[np.float64]

TUBE: dict[str, Any] = {
    "length": 0.15,  # m
    "diameter": 0.02,  # m
    "edge_length": 1.4e-3,  # m
    "mesh": "unstructured",
    "tip_weight": 1.0,  # of the end plate's place in the objective, over that of all the rest
    "lever": 0.03,  # m; turning the plate by 0.1 rad counts as if the whole skin were off by 3 mm
}


def tube_scene(
    comm: MPI.Comm,
    inputs: dict[str, Any],
    target: Deformer,
    measure: Callable[[Pattern, Floats], float],
    angle_target: float,
) -> Scene:
    """A tube along z, its base clamped, its end caps printed all over, its wall designed.

    Args:
        comm: Communicator.
        inputs: Values for the names in `TUBE`.
        target: What the assembled tube is to become.
        measure: Angle reached, in rad, from pattern and positions.
        angle_target: Angle asked for, in degrees.

    Raises:
        ParameterError: A number is out of bounds.
    """
    o = inputs
    require_between(0.0, np.inf, tip_weight=o["tip_weight"], lever=o["lever"])
    pattern = cylinder(comm, o["length"], o["diameter"], o["edge_length"], mesh=o["mesh"])
    plate, area = pattern.vertices_of(TIP), pattern.vertex_areas
    weights = np.ones(len(pattern.points))
    weights[plate] += o["tip_weight"] * area.sum() / area[plate].sum()
    # The ring, not the plate, which bulges. Turned by a small angle about a diameter it moves by
    # angle · radius/√2 in root mean square.
    ring = np.intersect1d(plate, pattern.vertices_of(WALL))
    relative = np.zeros(len(pattern.points))
    ratio = np.sqrt(2) * o["lever"] / (o["diameter"] / 2)
    relative[ring] = ratio**2 * (area @ weights) / area[ring].sum()
    return Scene(
        pattern=pattern,
        target=target(pattern.points),
        supports=clamp(pattern, [BASE]),
        angle=lambda of, positions: float(np.degrees(measure(of, positions))),
        angle_target=angle_target,
        passive=np.where(pattern.panel == pattern.panel_index(WALL), np.nan, 1.0),
        weights=weights,
        relative=relative,
    )
