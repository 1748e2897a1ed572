"""A tube that bends and twists at once when inflated: design its reinforcement pattern.

    python demos/bend_twist.py --coarse

The tube of `bend.py`, bent by 90° while its tip turns by 60° about its own axis. Targets are
composed: first `twist`, then `bend`, which takes the body as lying along z. Wanted are the places
and orientations of twelve cross-sections and of the tip; how far they swell is left free. The start
is a guess, helical lines as in `twist.py`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.tube import (
    COARSE_TUBE,
    SECTIONS,
    TUBE,
    bend_metric,
    section_scene,
    twist_metric,
)
from toros_fem.command_line import command_line, run_of
from toros_fem.meshes import bend, compose, twist

DEFAULTS: dict[str, Any] = {
    **TUBE,
    **SECTIONS,
    "angle": 90.0,  # degrees
    "twist": 60.0,  # degrees
    "helices": 4,
    "helix_angle": -45.0,  # left-handed ones unwind to the left
    "helix_width": 2.5e-3,
    "neutral": 0.01,  # m; the inner side of the bend keeps its length
    "pressure": 10e3,
}
COARSE = {**COARSE_TUBE, "helix_width": 4e-3}


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """The tube, what is held of it, and what it is to become."""
    o = inputs
    target = compose(
        twist(np.radians(o["twist"]), o["length"]),
        bend(np.radians(o["angle"]), o["length"], neutral=o["neutral"]),
    )
    return section_scene(comm, o, target, [bend_metric(o["angle"]), twist_metric(o["twist"])])


run = run_of(scene, DEFAULTS)


if __name__ == "__main__":
    sys.exit(
        command_line(MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/bend_twist"))
    )
