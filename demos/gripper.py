"""A gripper whose fingers close on an object when inflated, and lift it (paper Fig. 1).

    python demos/gripper.py --coarse
    python demos/gripper.py --coarse --shape box

Each finger is flat, made of two panels, and clamped at its root in a mount. The mount also carries
the inner panel on a stem: held in a flat line alone the finger would turn about it like a hinge.
Three fingers stand around a sphere, four around a box. Half a finger is designed, by symmetry, in
contact with the object, which is held in its place. A line along the inner panel is always printed,
so that this panel keeps its length. The target shape goes around the object. The objective also
asks for a holding force, that of the normal forces upwards and of the friction that they allow.

The printed gripper then lifts the object from a thin post. The object slides until the fingers bear
its weight. The summary gives the largest mass that they bear, the sliding at the object's own mass,
contact area and pressure, and the force of each finger.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.gripper.gripper import GripperScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, GripperScene(), Path("output/gripper")))
