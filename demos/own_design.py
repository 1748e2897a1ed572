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
from toros_fem.meshes.surface import cut_at_planes, straightened, volume
from toros_fem.meshes.transfer import refine
from toros_fem.products.common.tables import TipWeights

FILE = Path(__file__).parent / "surfaces" / "finger.stl"

parser = argparse.ArgumentParser(description="Design the print of a skin from a mesh file.")
parser.add_argument("--coarse", action="store_true", help="half the steps, on the same mesh")
parser.add_argument("--seed", type=int, default=0, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/own_design"), help="folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

ANGLE, FOOT, EDGE = 60.0, 4e-3, 2.43e-3  # deg, m; EDGE is the mean edge of the file
PUMP = 15e3  # Pa, the most that it gives

# %% [markdown]
# ## From the file to flat panels
#
# The finger is symmetric about y = 0, and half of it is designed: from a random start a whole one
# gets a lopsided print, and leans. The half is cut until each part can be laid flat with little
# distortion. Panels are sewn along the cuts. The two flat ends are printed all over.

# %%
surface = read_surface(comm, FILE, scale=1e-3)  # the file is in mm
file_mesh = straightened(unwrap(comm, cut_at_planes(surface, [1])[0]).pattern, [1])
whole = mirrored(file_mesh, [1]).pattern
low, high = whole.points.min(axis=0), whole.points.max(axis=0)
length, half_width = high[2] - low[2], (high[0] - low[0]) / 2
middle = np.array([*(low + high)[:2] / 2, low[2]])  # of the foot; the axis goes up from here

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


def case(edge: float) -> tf.Case:
    """Return half the finger on the mesh of the file, or on one whose triangles are divided."""
    if edge > 1.01 * EDGE:
        raise tf.errors.ParameterError("the mesh of the file is the coarsest that there is.")
    mesh = file_mesh
    for _ in range(round(np.log2(EDGE / edge))):
        mesh = refine(mesh).pattern
    z, both = mesh.points[:, 2], mirrored(mesh, [1]).pattern
    tip = np.flatnonzero(both.points[:, 2] > high[2] - 1e-6)
    areas = both.vertex_areas[tip]
    arm = both.points[tip] - np.average(both.points[tip], axis=0, weights=areas)
    radius_of_tip = float(np.sqrt(np.average((arm**2).sum(axis=1), weights=areas)))
    foot = tf.clamp_where(mesh, lambda x: x[:, 2] - low[2] < FOOT)
    return tf.Case(
        mesh,
        target=lambda points: deform(points - middle) + middle,
        supports=foot | tf.symmetry_plane(mesh, 1),
        pressure=start,
        pressure_bounds=(least, PUMP),
        composite=sheets,
        # The tip counts as much as all the rest, in place and in orientation.
        parts=[TipWeights().shape_part(both, tip, tip, radius_of_tip)],
        parts_of_whole=True,
        metrics=[tf.Metric("angle", "deg", ANGLE, angle_of).of_whole([1])],
        printed_panels=[n for n in mesh.panel_names if np.ptp(z[mesh.vertices_of(n)]) < 1e-6],
        symmetry=(1,),
    )


# %% [markdown]
# ## Design, print, verdict

# %%
first, second = (40, 30) if given.coarse else (60, 40)
made = tf.design_skin(
    comm,
    case,
    EDGE,
    given.output,
    overwrite=given.overwrite,
    seed=given.seed,
    filter_radius=3.9e-3,
    iterations=first,
    constrained_iterations=second,
    polish_iterations=10 if given.coarse else 20,
    island_area=50e-6,
    curve_pressure=None,
)
if comm.rank == 0:
    print(made)

# %% [markdown]
# `report.html` has all pictures, `pattern.svg` the flat panels in true scale, `skin.vtu` the shape
# for ParaView, `manufacture/` the files for printer and cutter.
