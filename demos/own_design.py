# %% [markdown]
# # Your own mesh: a finger from an STL file that bends
#
# Any closed surface of triangles can be a skin. Here it is a finger with an elliptic section, 90 mm
# high, in millimetres. It is cut into flat panels, held at its foot, and its print is designed so
# that it bends by 60° towards +x. The pressure p is designed too. The density ρ of print in each
# triangle and p minimise
#
#     T(ρ, p) = ½ ∫ w |x(ρ, p) − x*|² dA / A l²                             (eqs. 15-18)
#
# where x(ρ, p) is the stable equilibrium, a minimum of
#
#     E(x; ρ, p) = W_stretch(x; ρ) + W_bend(x; ρ) − p V(x)                  (eqs. 1-10)
#
# and lines and gaps keep a least width in the second stage (eqs. 11-14). Copy this script and
# change what differs in your case: every step is one call. `demos/scenes/own_design.toml` is the
# same design without a script, and `examples/finger.toml` shows more.
#
#     python demos/own_design.py --coarse      # a minute
#     mpirun -n 2 python demos/own_design.py

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.mechanics.readings.bare_tube import tube_pressure
from toros_fem.meshes import bend, mirrored, read_surface, unwrap
from toros_fem.meshes.surfaces.planes import cut_at_planes, straightened
from toros_fem.meshes.surfaces.surface import volume
from toros_fem.products.tables.loads import TipWeights

FILE = Path(__file__).parent / "surfaces" / "finger.stl"

parser = argparse.ArgumentParser(description="Design the print of a skin from a mesh file.")
parser.add_argument("--coarse", action="store_true", help="half the steps, on the same mesh")
parser.add_argument("--seed", type=int, default=0, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/own_design"), help="folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

ANGLE, FOOT = 60.0, 4e-3  # deg, m
PUMP = 15e3  # Pa, the most that it gives

# %% [markdown]
# ## From the file to flat panels
#
# The finger is symmetric about y = 0, and half of it is designed: from a random start a whole one
# gets a lopsided print, and leans. The half is cut until each part can be laid flat with little
# distortion. Panels are sewn along the cuts. The two flat ends are printed all over.

# %%
surface = read_surface(comm, FILE, scale=1e-3)  # the file is in mm
pattern = straightened(unwrap(comm, cut_at_planes(surface, [1])[0]).pattern, [1])
whole = mirrored(pattern, [1]).pattern
low, high = whole.points.min(axis=0), whole.points.max(axis=0)
length, half_width = high[2] - low[2], (high[0] - low[0]) / 2
middle = np.array([*(low + high)[:2] / 2, low[2]])  # of the foot; the axis goes up from here
height = {name: pattern.points[pattern.vertices_of(name), 2] for name in pattern.panel_names}

# %% [markdown]
# ## Supports, target, loads
#
# The target is any map of positions; in place of `bend` it may be a function of your own. A skin
# under pressure does not shorten, so the inner side of the bend keeps its length.

# %%
deform = bend(np.radians(ANGLE), length, neutral=half_width)
sheets = tf.Composite()  # fabric and printed TPU of docs/materials.md
# The pressure is designed too. It starts where a plain tube of the same volume and area is longer
# by 1.9 times the strain of the bend's outer side.
radius = abs(2 * volume(whole.points, whole.triangles)) / whole.areas.sum()
strain = np.radians(ANGLE) * 2 * half_width / length
start, least = (tube_pressure(sheets, radius, k * strain) for k in (1.9, 1.1))


def angle_of(of: tf.meshes.Pattern, x: np.ndarray) -> float:
    """Return the angle in degrees by which the tip bends towards +x, on any mesh."""
    z, way = of.points[:, 2], {"along": (0, 0, 1), "toward": (1, 0, 0)}
    return float(np.degrees(tf.bend_between(of, x, z > high[2] - 1e-6, z < low[2] + FOOT, **way)))


foot = tf.clamp_where(pattern, lambda x: x[:, 2] - low[2] < FOOT)
tip = np.flatnonzero(whole.points[:, 2] > high[2] - 1e-6)
areas = whole.vertex_areas[tip]
arm = whole.points[tip] - np.average(whole.points[tip], axis=0, weights=areas)
radius_of_tip = float(np.sqrt(np.average((arm**2).sum(axis=1), weights=areas)))
case = tf.Case(
    pattern,
    target=lambda points: deform(points - middle) + middle,
    supports=foot | tf.symmetry_plane(pattern, 1),
    pressure=start,
    pressure_bounds=(least, PUMP),
    composite=sheets,
    # The tip counts as much as all the rest, in place and in orientation.
    parts=[TipWeights().shape_part(whole, tip, tip, radius_of_tip)],
    parts_of_whole=True,
    metrics=[tf.Metric("angle", "deg", ANGLE, angle_of).of_whole([1])],
    printed_panels=[name for name, z in height.items() if np.ptp(z) < 1e-6],
    symmetry=(1,),
)

# %% [markdown]
# ## Design and print
# %%
first, second = (40, 30) if given.coarse else (60, 40)
stages = (tf.Stage(first), tf.Stage(second, constrained=True))
design = tf.ShapeDesign(comm, case, tf.Regularisation(3.9e-3))
reporter = tf.DesignReporter(comm, given.output, overwrite=given.overwrite)
options = tf.DesignOptions(stages, min_relative_decrease=0.05)
result = tf.optimize(design, options, seed=given.seed, callback=reporter)
limits = tf.PrintLimits(width=0.6e-3, gap=0.6e-3)
printed = tf.trimmed(tf.as_printed(design, result, limits, island_area=50e-6))
result, printed = tf.corrected(result, printed, callback=reporter)

# %% [markdown]
# ## Files
#
# `summary.json` has the figures, `pattern.svg` the flat panels in true scale, `skin.vtu` the shape
# for ParaView. `toros export FOLDER` writes the files for printer and cutter.

# %%
summary = tf.write_results(given.output, result, printed, seconds=reporter.seconds)
if comm.rank == 0:
    rows = [f"{row['name']} {row['value']:.4g} {row['unit']}" for row in summary["figures"][:2]]
    print(f"{', '.join(rows)} as printed; see {given.output}/shape.png")
