"""A tube that bends when inflated (paper Fig. 8b): design its reinforcement pattern.

    python demos/bend.py --coarse
    mpirun -n 2 python demos/bend.py --coarse --output output/bend-2

The tube, 15 cm long and 2 cm wide, lies along z. Its end z = 0 is clamped; its two end caps are
reinforced all over, as end plates are; its wall is designed, and the pressure with it. It is to
bend towards +x, with the inner side of the bend keeping its length: a skin under pressure does not
shorten by itself. The end plate at the tip counts as much as all the rest, so that the angle is
reached and not only the shape. Constraints on the widths of lines and gaps are switched on when the
free design has found its way; the pattern is then thresholded, cleaned of islands, and simulated
again as it is printed.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.tube import COARSE_TUBE, TUBE, bend_metric, tube_scene
from toros_fem.command_line import command_line, run_of
from toros_fem.meshes import bend

DEFAULTS: dict[str, Any] = {
    **TUBE,
    "angle": 180.0,  # degrees
    "neutral": 0.01,  # m; the inner side of the bend keeps its length
}
COARSE = COARSE_TUBE


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """The tube, what is held of it, and what it is to become."""
    o = inputs
    target = bend(np.radians(o["angle"]), o["length"], neutral=o["neutral"])
    return tube_scene(comm, o, target, [bend_metric(o["angle"])])


run = run_of(scene, DEFAULTS)


if __name__ == "__main__":
    sys.exit(command_line(MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/bend")))
