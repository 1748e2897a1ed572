# %% [markdown]
# # A tube without reinforcement (paper Fig. 8a)
#
# Inflated, a plain tube of fabric swells and lengthens, then saturates: up to some kPa the fabric
# stretches more and more, and above about 10 kPa it is close to its stretch bounds. At each
# pressure p the stable equilibrium x is a minimum of
#
#     E(x) = ∫ ψ_fabric(F) dA + W_bend(x) − p V(x),        F = ∂x/∂X         (eqs. 1-10)
#
# and each is reached from the one before. The curves show the radius of the middle third and the
# distance of the ends, each over its initial value.
#
#     python demos/inflate.py --coarse         # ten seconds
#     mpirun -n 2 python demos/inflate.py

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.meshes import cylinder, mirrored
from toros_fem.results.result import write_summary
from toros_fem.results.runs.open_run import begin_folder
from toros_fem.results.writer import PathResult, draw_pictures, write_pressure_path

parser = argparse.ArgumentParser(description="Inflate a tube without reinforcement.")
parser.add_argument("--coarse", action="store_true", help="a coarse mesh and half the pressures")
parser.add_argument("--seed", type=int, default=2, help="plays no part: nothing is drawn here")
parser.add_argument("--output", type=Path, default=Path("output/inflate"), help="folder of files")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

LENGTH, DIAMETER, SATURATED, HIGHEST = 0.15, 0.02, 10e3, 20e3  # m, m, Pa, Pa
edge, levels = (2.8e-3, 20) if given.coarse else (1.4e-3, 40)

# %% [markdown]
# ## Panels, seams, supports, materials
#
# The wall is one flat panel, rolled up and sewn along a line; the end caps are two discs, printed
# all over. The tube is symmetric about x = 0 and y = 0, so a quarter of it is enough; lengths and
# radii are those of the whole. The end z = 0 is clamped.

# %%
planes = (0, 1)
pattern = cylinder(comm, LENGTH, DIAMETER, edge, planes=planes)
supports = tf.clamp(pattern, ["base"])
for plane in planes:
    supports |= tf.symmetry_plane(pattern, plane)
skin = tf.sew(comm, pattern)
composite = tf.Composite()  # fabric and TPU of docs/materials.md
density = np.where(pattern.panel == pattern.panel_index("wall"), 0.0, 1.0)
metrics = (
    tf.Metric("radius", "percent", None, lambda of, x: 100 * tf.swelling(of, x)),
    tf.Metric("length", "percent", None, lambda of, x: 100 * tf.length_ratio(of, x)),
)

# %% [markdown]
# ## Equilibria over the pressure

# %%
solver = tf.EquilibriumSolver(skin, composite, supports)
pressures = [float(p) for p in np.linspace(0, HIGHEST, levels + 1)]
points = []
for point in tf.trace(
    solver, density[skin.owned_cells], pressures, [m.of_whole(planes) for m in metrics]
):
    points.append(point)
    radius, length = point.metrics["radius_percent"], point.metrics["length_percent"]
    if comm.rank == 0:
        kpa = point.result.pressure / 1e3
        print(f"{kpa:5.1f} kPa  radius {radius:6.1f} %  length {length:6.1f} %", flush=True)

# %% [markdown]
# ## Files
#
# `curve.csv` and `curve.png` have the curves, `inflation.png` shows some of the shapes, and
# `skin.vtu` the last one for ParaView.

# %%
path = PathResult(pattern, points, density, metrics, mirrored(pattern, planes), composite)
begin_folder(comm, given.output, overwrite=given.overwrite)
write_pressure_path(comm, given.output, path)
write_summary(comm, given.output, path)
draw_pictures(comm, given.output)
radii = {point.result.pressure: point.metrics["radius_percent"] for point in points}
half, last = radii[SATURATED], radii[HIGHEST]
if comm.rank == 0:
    growth = 100 * (last - half) / (half - radii[0.0])
    print(f"Above 10 kPa the radius grows by {growth:.0f} % of that below; see {given.output}/")
