"""A tube without reinforcement swells and lengthens, then saturates (paper Fig. 8a).

    python demos/inflate.py --coarse

The tube of `bend.py` with plain walls is inflated from 0 to 20 kPa. The curves show the radius of
its middle third and the distance of its ends, each over its initial value. Up to some kPa the
fabric stretches more and more; above about 10 kPa it is close to its stretch bounds, and the curve
bends down. A quarter of the tube is simulated, by symmetry; `--whole` takes all of it.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tubes.inflate import InflateScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, InflateScene(), Path("output/inflate")))
