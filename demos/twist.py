"""A tube that twists when inflated (paper Fig. 8d): design of its reinforcement pattern.

    python demos/twist.py --coarse
    python demos/twist.py --coarse --keep-length

The end plate of the tube of `bend.py` is to turn by 300° about the axis at 15 kPa, and each
cross-section in proportion to its height. The skin may swell freely. The positions of the
cross-sections along the axis are free: the tube grows longer, since helical lines unwind. With
`--keep-length` the tube is to keep its length.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tubes.twist import TwistScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, TwistScene(), Path("output/twist")))
