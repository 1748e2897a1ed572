"""A tube that shortens when inflated (paper Fig. 8c): design its reinforcement pattern.

    python demos/contract.py --coarse

The tube of `bend.py`, to become 8 % shorter. How far it swells is left free, and it must: the work
of the pressure on a larger section is what pulls the ends together. Wanted are the places along the
axis of twelve cross-sections and of the end plate, and that all stay upright on it. The start is a
guess, helical lines that cross at 28° to the axis as in a McKibben muscle: from a start of no
pattern the design stays a stiff tube. 8 % is about the most that the default materials allow, with
lines finer than these (docs/limits.md).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.tube import COARSE_TUBE, SECTIONS, TUBE, section_scene, shortening_metric
from toros_fem.command_line import command_line, run_of
from toros_fem.meshes import contract

DEFAULTS: dict[str, Any] = {
    **TUBE,
    **SECTIONS,
    "contraction": 8.0,  # per cent
    "tip_weight": 10.0,
    "helices": 3,  # as many each way
    "helix_angle": 28.0,
    "helix_width": 2.5e-3,
    "crossed": 1,
    "iterations": 90,
    "pressure": 5e3,
}
COARSE = {**COARSE_TUBE, "helix_width": 3e-3}


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """The tube, what is held of it, and what it is to become."""
    asked = inputs["contraction"]
    target = contract(1 - asked / 100)
    return section_scene(comm, inputs, target, [shortening_metric(asked)])


run = run_of(scene, DEFAULTS)


if __name__ == "__main__":
    sys.exit(command_line(MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/contract")))
