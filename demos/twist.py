# %% [markdown]
# # A tube that twists (paper Fig. 8d)
#
# Inflated, the end of the tube turns by 300° about the axis. From noise, densities of such a tube
# end in traps. So the design begins with a relaxed material: in each triangle two families of fine
# stiff lines with shares s₁, s₂ and directions t₁, t₂. Their energy per flat area,
#
#     f(s) ψ_fabric(F) + Σ sₖ ½ E h (|F dₖ| − 1)²,        dₖ = (cos tₖ, sin tₖ),
#
# is smooth in sₖ and tₖ, and MMA finds coherent families from a random start (docs/discovery.md).
# Lines of printable width are then laid along the families, cleaned and inflated. A print has few
# lines where the relaxed material has infinitely many, so it twists less. What it misses is asked
# for again: by other widths of its lines, or by a relaxed design of a larger angle.
#
#     python demos/twist.py --coarse           # about eight minutes
#     mpirun -n 2 python demos/twist.py --coarse

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.measures.cross_sections import label_cross_sections
from toros_fem.meshes import cylinder, twist

parser = argparse.ArgumentParser(description="Design a tube that twists when it is inflated.")
parser.add_argument("--coarse", action="store_true", help="coarse meshes and wider lines")
parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/twist"), help="folder of the files")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

TWIST, LENGTH, DIAMETER, PRESSURE = 300.0, 0.15, 0.02, 15e3  # deg, m, m, Pa
relaxed_edge, print_edge, width = (5e-3, 2e-3, 1.2e-3) if given.coarse else (4e-3, 1.4e-3, 0.9e-3)

# %% [markdown]
# ## Panels, seams, supports, target
#
# Twelve cross-sections and the end plate have a target: their places across the axis, and how far
# they are turned. They may move along the axis, and the skin may swell.


# %%
def case(edge: float, twist_deg: float = TWIST) -> tf.Case:
    """Return the tube on a mesh, and its target; another one is asked for what a print misses."""
    pattern = cylinder(comm, LENGTH, DIAMETER, edge)
    count = 12
    labels = label_cross_sections(pattern, pattern.vertices_of("wall"), (0, 0, 1), count)
    places = np.outer(np.append(np.full(count, 1 / count), 1.0), [1.0, 1.0, 0.0])
    turning = np.full(count + 1, (count + 1) * (0.03 / pattern.size) ** 2)
    angle = tf.Metric("twist", "deg", twist_deg, lambda of, x: np.degrees(tf.twist_angle(of, x)))
    return tf.Case(
        pattern,
        target=twist(np.radians(twist_deg), LENGTH),
        supports=tf.clamp(pattern, ["base"]),
        pressure=PRESSURE,  # the most that the pump gives
        pressure_bounds=(PRESSURE / 10, PRESSURE),
        composite=tf.Composite(),  # fabric and TPU of docs/materials.md
        parts=[tf.CrossSections(labels, places, turning)],
        metrics=[angle],
        printed_panels=["base", "tip"],
    )


# %% [markdown]
# ## Relaxed design, lines, print, verdict

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
    laid_width=width,
    corrections=8,
)
if comm.rank == 0:
    print(made)

# %% [markdown]
# `report.html` has all pictures, `manufacture/` the files for printer and cutter.
