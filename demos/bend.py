"""A tube that bends when inflated (paper Fig. 8b): design of its reinforcement pattern.

    python demos/bend.py --coarse
    mpirun -n 2 python demos/bend.py --coarse --output output/bend-2
    python demos/bend.py --coarse --whole
    python demos/bend.py --coarse --knit-ratio 3

The tube, 15 cm long and 2 cm wide, lies along z. Its end z = 0 is clamped. Its two end caps are
printed all over, as end plates are. Its wall is designed, at the 5 kPa that the paper states;
`--design-pressure` designs the pressure too. The target bends
towards +x, and the inner side of the bend keeps its length, because a skin under pressure does not
shorten. The end plate at the tip counts as much as all the rest, so that the design reaches the
angle and not only the shape. Constraints on the widths of lines and gaps act after the first
stage. The pattern is then thresholded, cleaned so that it can be printed, and simulated again.

The target is symmetric about the plane y = 0, so half the tube is designed, in about half the time.
Files, pictures and figures are those of the whole. A whole tube (`--whole`) may also find patterns
that are not symmetric.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tubes.bend import BendScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, BendScene(), Path("output/bend")))
