"""A tube that shortens when inflated (paper Fig. 8c): design of its reinforcement pattern.

    python demos/contract.py --coarse

The tube of `bend.py` is to become 8 % shorter at 10 kPa. It may swell freely, and it must: the work
of the pressure on a larger cross-section is what pulls the ends together. The positions of twelve
cross-sections and of the end plate along the axis count, and that all of them stay perpendicular to
it. The default materials allow little more than 8 % (docs/limits.md). Half the tube is designed, by
symmetry; `--whole` designs all of it.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tubes.contract import ContractScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, ContractScene(), Path("output/contract")))
