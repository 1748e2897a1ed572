"""A fabric with designed stiffness: a tile that repeats (paper section 4.3, Fig. 7).

    python demos/tile.py --target tetragonal --coarse
    python demos/tile.py --target orthotropic

The print of a square tile of 1 cm is designed so that the fabric has the target stiffness when it
is pulled by 10 % in any direction and free across. Several random starts are tried,
families of straight and wavy lines and long waves of the density by turns, and the best is
continued; islands and lines or gaps below `--print-width` count against a start and a print. All
figures are those of the printed pattern, simulated again on a mesh of half the edge length.

Targets: "orthotropic" (2000 N/m along x, 500 along y and at 45°), "tetragonal" (2000 along x and y,
400 at 45°), "isotropic" (700 everywhere), "anisotropic" (the largest ratio of stiffness along x to
that along y), "auxetic" (widens when pulled along x or y). `demos/tile_sheet.py` makes a sheet of
the result.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tile_design.tile import TileScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, TileScene(), Path("output/tile")))
