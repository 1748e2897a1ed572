# %% [markdown]
# # A tube that bends and twists at once
#
# Inflated, the tube bends by 90° while its tip turns by 60° about its own axis. A target is a map
# of positions, and maps are composed: x* = bend(twist(X)), since `bend` takes a body along z. Two
# families of fine stiff lines with shares sₖ and directions tₖ are designed in each triangle,
# whose energy per flat area is
#
#     f(s) ψ_fabric(F) + Σ sₖ ½ E h (|F dₖ| − 1)²,        dₖ = (cos tₖ, sin tₖ)
#
# (docs/discovery.md). Places x̄ᵢ and rotations Rᵢ of twelve cross-sections and of the end plate
# count, and a little the share of the lines; the skin may swell freely:
#
#     T = ½ Σᵢ wᵢ |x̄ᵢ − x̄ᵢ*|² + vᵢ |Rᵢ − Rᵢ*|²  +  0.001 · mean of s₁ + s₂
#
# Lines of printable width are laid along the families, cleaned and inflated. This print bends and
# twists by half as much. Then its lines are moved and widened, by what the print misses of its
# shape: the centres of its cross-sections, the direction of its tip, and both angles.
#
#     python demos/bend_twist.py --coarse      # about eleven minutes
#     mpirun -n 2 python demos/bend_twist.py --coarse

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.measures.cross_sections import label_cross_sections
from toros_fem.meshes import bend, compose, cylinder, twist

parser = argparse.ArgumentParser(description="Design a tube that bends and twists when inflated.")
parser.add_argument("--coarse", action="store_true", help="coarse meshes and wider lines")
parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/bend_twist"), help="folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

AIMS = np.array([90.0, 60.0])  # bend and twist, deg
LENGTH, DIAMETER, PRESSURE = 0.15, 0.02, 10e3  # m, m, Pa
relaxed_edge, print_edge = (5e-3, 2e-3) if given.coarse else (4e-3, 1.4e-3)

# %% [markdown]
# ## Panels, seams, supports, target
#
# The line 1 cm off the axis, towards the inner side, keeps its length in the bend. The tube has no
# plane of symmetry, so all of it is designed.


# %%
def case(edge: float) -> tf.Case:
    """Return the tube on a mesh, and its target."""
    pattern = cylinder(comm, LENGTH, DIAMETER, edge)
    (bending, twisting), count = np.radians(AIMS), 12
    labels = label_cross_sections(pattern, pattern.vertices_of("wall"), (0, 0, 1), count)
    places = np.outer(np.append(np.full(count, 1 / count), 1.0), [1.0, 1.0, 1.0])
    turning = np.full(count + 1, (count + 1) * (0.03 / pattern.size) ** 2)
    return tf.Case(
        pattern,
        target=compose(twist(twisting, LENGTH), bend(bending, LENGTH, neutral=0.01)),
        supports=tf.clamp(pattern, ["base"]),
        pressure=PRESSURE,  # the most that the pump gives
        pressure_bounds=(PRESSURE / 10, PRESSURE),
        composite=tf.Composite(),  # fabric and TPU of docs/materials.md
        parts=[tf.CrossSections(labels, places, turning)],
        metrics=[
            tf.Metric("angle", "deg", AIMS[0], lambda of, x: np.degrees(tf.bend_angle(of, x))),
            tf.Metric("twist", "deg", AIMS[1], lambda of, x: np.degrees(tf.twist_angle(of, x))),
        ],
        printed_panels=["base", "tip"],
    )


# %% [markdown]
# ## Relaxed design, lines, print, verdict
#
# Many lines, also where few are asked for, and with room for other widths: of a few wide ones each
# decides about the shape.

# %%
made = tf.design_skin(
    comm,
    case,
    print_edge,
    given.output,
    overwrite=given.overwrite,
    start="relaxed",
    seed=given.seed,
    relaxed_edge_length=relaxed_edge,
    relaxed_iterations=60,
    share_weight=1e-3,
    laid_width=0.9e-3,
    least_share=0.012,
    spread=2.0,
    corrections=8,
)
if comm.rank == 0:
    print(made)

# %% [markdown]
# `report.html` has all pictures, `manufacture/` the files for printer and cutter.
