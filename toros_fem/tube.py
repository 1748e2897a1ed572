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
    "tip_weight": 1.0,  # of the end plate in the objective, over that of all the rest
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
    require_between(0.0, np.inf, tip_weight=o["tip_weight"])
    pattern = cylinder(comm, o["length"], o["diameter"], o["edge_length"], mesh=o["mesh"])
    plate, area = pattern.vertices_of(TIP), pattern.vertex_areas
    weights = np.ones(len(pattern.points))
    weights[plate] += o["tip_weight"] * area.sum() / area[plate].sum()
    return Scene(
        pattern=pattern,
        target=target(pattern.points),
        supports=clamp(pattern, [BASE]),
        angle=lambda positions: float(np.degrees(measure(pattern, positions))),
        angle_target=angle_target,
        passive=np.where(pattern.panel == pattern.panel_index(WALL), np.nan, 1.0),
        weights=weights,
    )
