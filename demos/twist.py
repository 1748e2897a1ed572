"""A tube that twists when inflated (paper Fig. 8d): design its reinforcement pattern.

    python demos/twist.py --coarse

The tube of `bend.py`; its end plate is to turn by 300° about the axis, every section by its share.
Where the sections lie along the axis, and how far they swell, is left free. The start is a guess,
four left-handed helical lines; `--helices 0` starts without a pattern and ends near 255°.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.tube import COARSE_TUBE, SECTIONS, TUBE, section_scene, twist_metric
from toros_fem.command_line import command_line, run_of
from toros_fem.meshes import twist

DEFAULTS: dict[str, Any] = {
    **TUBE,
    **SECTIONS,
    "twist": 300.0,  # degrees
    "along": 0.0,
    "helices": 4,
    "helix_angle": -55.0,  # left-handed ones unwind to the left
    "helix_width": 2.5e-3,
    "pressure": 15e3,
}
COARSE = {**COARSE_TUBE, "helix_width": 4e-3}


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """The tube, what is held of it, and what it is to become."""
    target = twist(np.radians(inputs["twist"]), inputs["length"])
    return section_scene(comm, inputs, target, [twist_metric(inputs["twist"])])


run = run_of(scene, DEFAULTS)


if __name__ == "__main__":
    sys.exit(command_line(MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/twist")))
