"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

    python demos/walker.py --coarse
    python demos/walker.py --coarse --motion crawl

Two flat panels, top and bottom, are sewn along an X: a body and four legs along the diagonals. A
quarter with one leg is designed, by symmetry, at 20 kPa. The leg is to turn down by 90° (stand), or
by 60° while the body reaches out (crawl). The whole robot is printed. It is then simulated with
three chambers, body, front legs and rear legs, through one cycle of a gait.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.command_line.scripts import run_from_command_line
from toros_fem.scenes.walker import WalkerConfig, coarse, run, sentence

if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            WalkerConfig(),
            run,
            Path("output/walker"),
            coarse=coarse,
            sentence=sentence,
        )
    )
