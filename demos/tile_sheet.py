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

import toros_fem as tf
from toros_fem.base.files import guarded, if_possible, write_table
from toros_fem.making.machine_files import write_manufacture
from toros_fem.making.panel_drawing import write_svg
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.products.tiles.plots import plot_sheet
from toros_fem.products.tiles.report import PrintedTile, print_layout
from toros_fem.products.tiles.stiffness_profile import profiles, tile_solver
from toros_fem.results.runs.open_run import begin_folder

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
# `read_tile(comm, "output/tile")` of `toros_fem.products.tiles.report`.

# %%
low, high = -SIDE, 2 * SIDE
ways = shapely.linestrings([[(low, low), (high, high)], [(low, high), (high, low)]])
lines = shapely.union_all(shapely.buffer(ways, LINE / 2, cap_style="flat"))
region = lines & shapely.box(0, 0, SIDE, SIDE)
printed_tile = PrintedTile(region, (SIDE, SIDE), longer * SIDE / EDGES)
tile, printed = printed_tile.tile(comm)
composite = printed_tile.composite

# %% [markdown]
# ## The sheet
#
# The print has unprinted cloth for the clamps at both ends. The simulated sheet has none: the cloth
# inside a clamp does not stretch. Reactions of the moving end are the force. The middle is as long
# as two tiles: a whole number of them averages out what varies within one.

# %%
cloth, whole = print_layout(tile, region, (along, across), MARGIN)
pattern, copied = tile.sheet(along, across)
cells = printed[copied]
x, length, width = pattern.points[:, 0], along * SIDE, across * SIDE
near, far = x < 1e-9, x > length - 1e-9
fixed = np.zeros(pattern.points.shape, dtype=bool)
fixed[:, 2], fixed[near | far] = True, True

skin = tf.sew(comm, pattern)
solver = tf.EquilibriumSolver(skin, composite, Supports(fixed), quadratic=cells)
middle = np.abs(pattern.centroids[:, 0] - length / 2) < SIDE
areas, flat = pattern.areas[middle], pattern.corners[middle]

# %% [markdown]
# ## The pull, and the prediction by the tile at the strain of the middle

# %%
rows, at = [], None
for strain in np.linspace(0.0, STRAIN, 6)[1:]:
    moved = np.where(far[:, None], strain * length * np.eye(3)[0], 0.0)
    at = solver.solve(cells[skin.owned_cells].astype(float), tf.Load(displacement=moved), at)
    positions, forces = skin.gather_vertices(at.positions), solver.reactions(at)
    corners = positions[pattern.triangles[middle], :2]
    edges, sides = corners[:, 1:] - corners[:, :1], flat[:, 1:] - flat[:, :1]
    stretches = np.average(np.linalg.solve(sides, edges), axis=0, weights=areas)  # F̄ transposed
    rows.append({"strain": strain, "stress_n_per_m": forces[far, 0].sum() / width,
                 "middle_strain": stretches[0, 0] - 1, "across": stretches[1, 1]})  # fmt: skip

alone = tf.sew(comm, tile.pattern)
periodic = tile_solver(alone, composite, Periodic(tile), quadratic=printed)
strains = [row["middle_strain"] for row in rows]
predicted = profiles(periodic, printed[alone.owned_cells].astype(float), [0.0], strains)
for row, one in zip(rows, predicted, strict=True):
    row["contraction"] = (1 - row.pop("across")) / row["middle_strain"]
    row["stress_predicted_n_per_m"] = one.stress[0]
    row["contraction_predicted"] = one.contraction[0]

# %% [markdown]
# ## Files
#
# `curve.csv` has force and contraction over the strain, `pattern.svg` the sheet in true scale,
# `manufacture/make_it.html` shows how to print and cut it.


# %%
def write() -> None:
    """Write curves, print and picture (one rank)."""
    folder: Path = given.output
    write_table(folder / "curve.csv", rows)
    write_svg(folder / "pattern.svg", cloth, [whole])
    place = folder / "manufacture"
    if_possible("machine files", lambda: write_manufacture(place, cloth, [whole]))
    title = f"pulled by {100 * STRAIN:g} % along x"
    plot_sheet(folder / "sheet_x.png", pattern, positions, cells, title)


begin_folder(comm, given.output, overwrite=given.overwrite)
guarded(comm, given.output, write)
if comm.rank == 0:
    found, asked = (rows[-1][f"stress{word}_n_per_m"] / strains[-1] for word in ("", "_predicted"))
    print(f"{found:.1f} N/m in the middle, predicted {asked:.1f}; see {given.output}/sheet_x.png")
