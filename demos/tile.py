# %% [markdown]
# # A fabric of designed stiffness (paper Fig. 7)
#
# A square tile of 1 cm repeats. Pulled by 10 % along the direction n, free across, it has the
# stiffness s(n) = n·P̄n / (λ − 1), where P̄ is the mean stress of the tile at the equilibrium
#
#     x = F̄ X + w,   w periodic,   F̄n = λ n,   no mean stress on lines across n,
#
# a minimum of the membrane energy (eq. 1). The density ρ of print on it minimises
#
#     T(ρ) = Σ (s(nₖ) / s*(nₖ) − 1)² / k
#
# over k directions. The target s* is that of a linear sheet: 4000 N/m along x and y, 800 at 45°,
#
#     1/s* = cos⁴/s₀ + sin⁴/s₉₀ + (4/s₄₅ − 1/s₀ − 1/s₉₀) sin² cos².
#
# Profiles have many local minima: several random families of lines, and long waves, are tried. The
# two best go on, on finer meshes and with less grey. What a print misses is added to the target
# of a last design (docs/tiles.md).
#
#     python demos/tile.py --coarse            # two minutes
#     mpirun -n 2 python demos/tile.py         # ranks share the directions

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.products.tiles.problem import TileCase, TileDesignScene, measure_print
from toros_fem.products.tiles.report import TileRun, write_tile_results
from toros_fem.products.tiles.stiffness_profile import ProfileSolver, ProfileTarget, tile_solver
from toros_fem.products.tiles.tile import design_tile, linear_profile

parser = argparse.ArgumentParser(description="Design a tile of fabric with a target stiffness.")
parser.add_argument("--coarse", action="store_true", help="coarse meshes")
parser.add_argument("--seed", type=int, default=2, help="seed of the first random start")
parser.add_argument("--output", type=Path, default=Path("output/tile"), help="folder of the files")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

SIZE, STRAIN, SYMMETRY, MESH = 0.01, 0.1, "tetragonal", "crossed"  # SIZE in m
edge, radius = (0.2e-3, 0.8e-3) if given.coarse else (0.125e-3, 0.7e-3)

# %% [markdown]
# ## Mesh, target
#
# Starts are tried on a mesh of twice the edge length, prints on one along their borders. A
# tetragonal tile repeats its stiffness every 45° mirrored, so four directions tell all.

# %%
angles = np.linspace(0.0, np.pi / 4, 4, dtype=np.float64)
stiffness = linear_profile(angles, along=4000.0, diagonal=800.0, across=4000.0)
case = TileCase(comm, (SIZE, SIZE), edge, MESH, SYMMETRY, angles, ProfileTarget(stiffness))

# %% [markdown]
# ## What is solved
#
# One evaluation of the profile, here of the plain fabric: its stiffness is the same all around. The
# design adds the gradient of s by ρ, from the same factorisation.

# %%
composite = tf.Composite(bending=None)  # the sheet stays flat
coarse = case.coarse.tile
alone = tf.sew(MPI.COMM_SELF, coarse.pattern)  # each rank has the whole tile
solver = ProfileSolver(tile_solver(alone, composite, Periodic(coarse)), angles, STRAIN, comm)
plain = solver.solve(np.zeros(len(alone.owned_cells)), gradients=False)
if comm.rank == 0:
    print(f"plain fabric {plain.stiffness.round()}, asked {stiffness.round()} N/m")

# %% [markdown]
# ## Search, print
#
# A start or a print with islands, or with lines or gaps that are too narrow for the printer, counts
# as worse. Steps are those of MMA with constraints on widths (eqs. 13, 14).

# %%
settings = TileDesignScene.of(
    strain=STRAIN,
    filter_radius=radius,
    seed=given.seed,
    print_width=0.6e-3,
    island_area=0.1e-6,
)
reporter = tf.DesignReporter(comm, given.output, overwrite=given.overwrite)
result = design_tile(case, settings, reporter)
measured = measure_print(result)  # in all directions, and over the strain

# %% [markdown]
# ## Files
#
# `profile.png` has the stiffness over the direction beside the target, `pattern.svg` the print in
# true scale, `tile.npz` what demos/tile_sheet.py lays side by side.

# %%
run = TileRun(result, measured, reporter.seconds)
write_tile_results(given.output, run)
if comm.rank == 0:
    print(f"{run.sentence()}; see {given.output}/profile.png")
