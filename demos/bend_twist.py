"""A tube that bends and twists at once when inflated: design of its reinforcement pattern.

    python demos/bend_twist.py --coarse

The tube of `bend.py` is to bend by 90° while its tip turns by 60° about its own axis, at 10 kPa.
Targets are composed: first `twist`, then `bend`, which takes a body along z. The positions and
orientations of twelve cross-sections and of the tip count; the skin may swell freely.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tubes.bend_twist import BendTwistScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, BendTwistScene(), Path("output/bend_twist")))
