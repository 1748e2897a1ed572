"""A sheet of tiles: a file to print, and a pull test beside its prediction.

    python demos/tile_sheet.py --coarse
    python demos/tile_sheet.py --tile output/tile

A designed tile is read from the output folder of `demos/tile.py` and laid side by side: 10 along
the pull and 5 across. The print file shows the whole sheet in true scale. The lines of neighbouring
tiles are joined, and there is unprinted cloth for clamps at both ends. The simulated sheet is as
long as the print, since the cloth inside a clamp does not stretch. Both its ends are fixed in all
components and one of them moves, in the plane. The prediction is that of the periodic tile on the
same mesh: its stiffness and its lateral contraction. Without a tile the demo takes a simple one,
with its diagonals as lines of 1 mm.
"""

import sys
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_scene_script
from toros_fem.products.tiles.pulled_sheet import TileSheetScene

if __name__ == "__main__":
    sys.exit(run_scene_script(MPI.COMM_WORLD, __doc__, TileSheetScene(), Path("output/tile_sheet")))
