"""A gripper of three fingers that close on a sphere or a box when inflated (paper Fig. 1).

    python demos/gripper.py --coarse
    python demos/gripper.py --coarse --shape box

Each finger is flat, made of two panels, and clamped at its root in a mount. Three of them hang
around the object at 120°. Half a finger is designed, by symmetry. A line along its inner panel is
always printed, so that this panel keeps its length. The target follows from the object. Around a
sphere the finger goes as far as it reaches. The edges of a box are sharper than a finger can bend:
its outer panel would have to stretch fourfold. So the finger bends evenly from its root on, touches
the lower edge, and its tip ends below the box. The distance of the inner panel from the object,
where it is to touch, also counts. The printed finger is simulated again. The summary gives the
remaining gap, and how it changes when the object's weight hangs on the fingers.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.command_line.scripts import run_from_command_line
from toros_fem.scenes.gripper import GripperConfig, coarse, run, sentence

if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            GripperConfig(),
            run,
            Path("output/gripper"),
            coarse=coarse,
            sentence=sentence,
        )
    )
