# %% [markdown]
# # A sheet of tiles, pulled (paper section 4.3)
#
# A printed tile of 1 cm, here a simple one with its diagonals as lines of 1 mm, is laid side by
# side. Both ends of the sheet are clamped and one of them moves, in the plane. The force over the
# undeformed width, and the lateral contraction of the middle, are compared with those that the
# periodic tile predicts for an endless sheet:
#
#     sheet:  x minimises W_stretch(x; ρ),            x = X on one end, X + ε L n on the other
#     tile:   x = F̄ X + w minimises the same energy,  w periodic,  F̄n = (1 + ε) n,  free across
#
# The clamps keep the sheet from contracting, so a short one is stiffer than its prediction
# (docs/tiles.md). Nothing is random here, so there is no seed.
#
#     python demos/tile_sheet.py --coarse            # a few seconds
#     mpirun -n 2 python demos/tile_sheet.py

# %%
import argparse
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.base.files import guarded, if_possible, write_json, write_table
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.sheets.write import write_manufacture
from toros_fem.products.tiles import pull_test
from toros_fem.products.tiles.plots import plot_pulls, plot_sheet
from toros_fem.products.tiles.printed_tile import PrintedTile, print_layout, tile_sheet
from toros_fem.results.runs.folder import begin_folder

parser = argparse.ArgumentParser(description="Pull a sheet of tiles beside its prediction.")
parser.add_argument("--coarse", action="store_true", help="a coarse mesh, and fewer tiles")
parser.add_argument("--output", type=Path, default=Path("output/tile_sheet"), help="its folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

SIDE, EDGES, LINE, STRAIN, MARGIN = 0.01, 14, 1e-3, 0.1, 0.02  # m; MARGIN of cloth in the clamps
along, across, longer = (12, 3, 2.0) if given.coarse else (20, 5, 1.0)

# %% [markdown]
# ## The tile
#
# Polygons on the tile, whose borders are edges of its mesh. For a tile of demos/tile.py:
# `read_tile(comm, "output/tile")` of `toros_fem.products.tiles.printed_tile`.

# %%
low, high = -SIDE, 2 * SIDE
ways = shapely.linestrings([[(low, low), (high, high)], [(low, high), (high, low)]])
lines = shapely.union_all(shapely.buffer(ways, LINE / 2, cap_style="flat"))
region = lines & shapely.box(0, 0, SIDE, SIDE)
printed_tile = PrintedTile(region, (SIDE, SIDE), longer * SIDE / EDGES)
mesh, printed = printed_tile.tile(comm)

# %% [markdown]
# ## The sheets: what is printed, and what is pulled
#
# The print has unprinted cloth for the clamps at both ends. The simulated sheet has none: the cloth
# inside a clamp does not stretch.

# %%
directions = ("x", "y")
sheets = [tile_sheet(mesh, direction, along, across) for direction in directions]
cloth, regions = print_layout(sheets, region, MARGIN)
strains = np.linspace(0.0, STRAIN, 6, dtype=np.float64)[1:]
composite = printed_tile.composite
pulled = [pull_test.pull_sheet(comm, one, printed, composite, strains) for one in sheets]

# %% [markdown]
# ## Files
#
# `curve.png` has force and contraction over the strain, `pattern.svg` the sheets in true scale,
# `manufacture/make_it.html` shows how to print and cut them.


# %%
def write() -> None:
    """Write figures, curves, print and pictures (one rank)."""
    folder: Path = given.output
    write_json(folder / "pull.json", {one.sheet.direction: one.summary() for one in pulled})
    write_table(folder / "curve.csv", [row for one in pulled for row in one.rows()])
    write_svg(folder / "pattern.svg", cloth, regions)
    place = folder / "manufacture"
    if_possible("machine files", lambda: write_manufacture(place, cloth, regions))
    plot_pulls(folder / "curve.png", pulled)
    for one in pulled:
        title = f"pulled by {100 * STRAIN:g} % along {one.sheet.direction}"
        path, cells = folder / f"sheet_{one.sheet.direction}.png", printed[one.sheet.cell]
        plot_sheet(path, one.sheet.pattern, one.test.positions, cells, title)


begin_folder(comm, given.output, overwrite=given.overwrite)
guarded(comm, given.output, write)
if comm.rank == 0:
    for one in pulled:
        middle, predicted = one.stiffness
        print(f"{one.sheet.direction}: {middle:.0f} N/m in the middle, predicted {predicted:.0f}")
    print(f"see {given.output}/curve.png")
