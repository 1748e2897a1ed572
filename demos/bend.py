# %% [markdown]
# # A tube that bends (paper Fig. 8b)
#
# A tube of thin fabric swells when it is inflated. Where TPU is printed on it, it hardly stretches:
# the right pattern makes it bend by 180°. This pattern, a density ρ in each triangle, minimises
#
#     T(ρ) = ½ ∫ w |x(ρ) − x*|² dA / A l²  +  perimeter of the print        (eqs. 15-18)
#
# where x(ρ) is the stable equilibrium under the pressure p, a minimum of
#
#     E(x; ρ) = W_stretch(x; ρ) + W_bend(x; ρ) − p V(x)                     (eqs. 1-10)
#
# and lines and gaps keep a least width (eqs. 11-14). MMA takes the adjoint gradient (eq. 19).
#
#     python demos/bend.py --coarse            # 80 s; mpirun -n 2 python … does the same

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.mechanics.readings.bare_tube import tube_pressure
from toros_fem.meshes import bend, cylinder, mirrored

parser = argparse.ArgumentParser(description="Design a tube that bends when it is inflated.")
parser.add_argument("--coarse", action="store_true", help="a coarse mesh, and one instead of two")
parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/bend"), help="folder of the files")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

ANGLE, LENGTH, DIAMETER = 180.0, 0.15, 0.02  # deg, m, m
PUMP = 10e3  # Pa, the most that it gives

# %% [markdown]
# ## Panels, seams, supports, target
#
# The wall is one flat panel, rolled up and sewn along a line; the end caps are two discs. All is
# symmetric about y = 0, so half the tube is enough. The end z = 0 is clamped. The target bends
# towards +x, and the line 1 cm off the axis keeps its length: a skin under pressure does not
# shorten. The end plate at the tip counts as much as all the rest, in place and in orientation.
# The pressure is designed too. It starts where the plain tube is longer by 1.3 times the strain of
# the bend's outer side, and a part of T prefers less of it, so that no more is printed than needed.

# %%
sheets = tf.Composite()  # fabric and printed TPU of docs/materials.md
strain = np.radians(ANGLE) * (DIAMETER / 2 + 0.01) / LENGTH  # of the outer side
start, least = (tube_pressure(sheets, DIAMETER / 2, k * strain) for k in (1.3, 1.1))


def case(edge: float) -> tf.Case:
    """Return the tube on a mesh, and its target."""
    pattern = cylinder(comm, LENGTH, DIAMETER, edge, planes=(1,))
    whole = mirrored(pattern, (1,)).pattern
    plate, area = whole.vertices_of("tip"), whole.vertex_areas
    weights, turning = np.ones(len(whole.points)), np.zeros(len(whole.points))
    weights[plate] += area.sum() / area[plate].sum()
    rim = np.intersect1d(plate, whole.vertices_of("wall"))
    # Turned by 0.1 rad the tip costs as much as a skin that is 3 mm off.
    turning[rim] = 2 * (0.03 / (DIAMETER / 2)) ** 2 * (area @ weights) / area[rim].sum()
    angle_of = tf.Metric("angle", "deg", ANGLE, lambda of, x: np.degrees(tf.bend_angle(of, x)))
    return tf.Case(
        pattern,
        target=bend(np.radians(ANGLE), LENGTH, neutral=0.01),
        supports=tf.clamp(pattern, ["base"]) | tf.symmetry_plane(pattern, 1),
        pressure=start,
        pressure_bounds=(least, PUMP),
        composite=sheets,
        parts=[tf.ShapePart(weights, turning)],
        parts_of_whole=True,
        metrics=[angle_of.of_whole((1,))],
        printed_panels=["base", "tip"],
        symmetry=(1,),
    )


# %% [markdown]
# ## Design, print, verdict
#
# 60 free steps begin with a soft projection (β = 4, 8, then 20), since with β = 20 the noise of the
# start freezes. 40 more have the constraints on widths; a finer mesh goes on with 10 small ones.
# The print is inflated on a mesh whose edges are its borders. Its pressure goes where the worst
# figure is least, by 15 % at most. If it misses, the design goes on towards a target that is moved
# by the miss. The same print on two coarser meshes tells the intervals.

# %%
edge, radius = (2.8e-3, 4.4e-3) if given.coarse else (1.4e-3, 2.15e-3)  # m
first, second = (40, 30) if given.coarse else (60, 40)
made = tf.design_skin(
    comm,
    case,
    edge,
    given.output,
    overwrite=given.overwrite,
    seed=given.seed,
    levels=1 if given.coarse else 2,
    filter_radius=radius,  # on the finest mesh
    iterations=first,
    constrained_iterations=second,
    perimeter_weight=1e-4,
    check_refinement=2,  # the print once more, on edges half as long, tells the figures
)
if comm.rank == 0:
    print(made)

# %% [markdown]
# `summary.json` has the figures, `report.html` all pictures, `pattern.svg` the flat pattern in true
# scale, `manufacture/` the files for printer and cutter, `skin.vtu` the shape for ParaView.
