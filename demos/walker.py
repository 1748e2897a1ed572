"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

    python demos/walker.py --coarse
    python demos/walker.py --coarse --motion crawl
    python demos/walker.py --coarse --motion crawl --aim stride --design-pressure

Two flat panels, top and bottom, are sewn along an X: a body and four legs along the diagonals. A
quarter with one leg is designed, by symmetry, at 20 kPa. The leg is to turn down by 90° (stand), or
by 60° while the body reaches out (crawl); or the stride of the gait is to be long (--aim stride).
The whole robot is printed. Half of it then walks on the ground, with three chambers that are filled
and emptied fully, its own weight, friction and contact (docs/walking.md).
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.walker.walker import WalkerScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, WalkerScene(), Path("output/walker")))
