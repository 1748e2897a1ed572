# %% [markdown]
# # A gripper whose fingers close on a sphere (paper Fig. 1)
#
# Three flat fingers stand around a sphere of 5 cm. Each is two panels sewn all around, clamped at
# its root in a mount, which carries the inner panel on a stem too. By symmetry half a finger is
# designed, in contact with the sphere, and so is its pressure. The density ρ of print minimises
#
#     T(ρ, p) = cross-sections of the finger, as in eqs. (17, 18)
#             + ½ g ∫ d² dA / A l²          d: distance of the inner panel from the sphere
#             + v max(0, 1 − a·F / F₀)²     F: normal force on it, F₀: 1.5 times its weight
#
# at the equilibrium x(ρ, p), a minimum of W_stretch + W_bend − p V + W_contact (eqs. 1-10, and the
# barriers of Li et al. 2020). Then the printed fingers lift it.
#     python demos/gripper.py --coarse            # two minutes
#     mpirun -n 2 python demos/gripper.py         # the mesh of the figures in docs/demos.md

# %%
import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.measures.gap import Body, GapObjective, mean_gap
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.paths.pull_out import largest_force, pull_out
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.meshes import curl, finger, plane_centroids
from toros_fem.products.actuators.legs import Leg, LegWeights
from toros_fem.products.gripper.lift import write_lift

parser = argparse.ArgumentParser(description="Design a gripper, and let it lift a sphere.")
parser.add_argument("--coarse", action="store_true", help="a coarse mesh")
parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/gripper"), help="its folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

LENGTH, WIDTH, ROOT, STEM, DEPTH = 0.09, 0.02, 0.015, 0.025, 0.016  # m; DEPTH when inflated
RADIUS, MASS, FRICTION, FINGERS, GRAVITY = 0.025, 0.1, 0.6, 3, 9.81  # m, kg, m/s²
ALONG, TOWARD, WRAP = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), np.pi / 2  # rad around the sphere
edge, filter_radius = (1.8e-3, 3.225e-3) if given.coarse else (1.2e-3, 2.15e-3)

# %% [markdown]
# ## Panels, supports, contact, target
# The inner panel keeps its length: a line along it is always printed. It goes around the sphere.
# By symmetry fingers meet in planes through the sphere's axis, which act as walls.

# %%
pattern = finger(comm, edge, length=LENGTH, width=WIDTH, root=ROOT, planes=(1,))
begin = LENGTH - WRAP * RADIUS
body = Body("sphere", 2 * RADIUS, (begin, 0.0, DEPTH / 2 + RADIUS))
bent = curl(WRAP, WRAP * RADIUS, origin=(begin, 0, DEPTH / 2), along=ALONG, toward=TOWARD)
target = bent(pattern.points)
inner = pattern.panel == pattern.panel_index("top")
on_inner = np.isin(np.arange(len(pattern.points)), pattern.vertices_of("top"))
x, y, _ = pattern.points.T
strip = on_inner & (x > begin) & (x < LENGTH - WIDTH / 4) & (np.abs(y) < WIDTH / 6)
middle = strip & (np.abs(y) < WIDTH / 24)  # an inflated finger is round
held = (x <= ROOT * (1 + 1e-9)) | (on_inner & (x <= STEM * (1 + 1e-9)))
supports = tf.clamp_where(pattern, lambda _: held) | tf.symmetry_plane(pattern, 1)
composite = tf.Composite(bending=tf.Bending(seams="hinged"))  # sewn seams carry no moment
wall = (0.0, -np.cos(np.pi / FINGERS), -np.sin(np.pi / FINGERS))
ball, ground = rigid_sphere("object", RADIUS, body.centre), tf.Ground((0, 0, body.centre[2]), wall)
contact = tf.Contact(ground, bodies=[ball], self_contact=False)
# Upwards, and towards the sphere's axis as far as friction makes use of it.
up, needed = FRICTION * np.array(TOWARD) - ALONG, 1.5 * MASS * GRAVITY / (2 * FINGERS)
sizes, leg = contact.sizes(composite), Leg(ALONG, TOWARD, ROOT)
tip = leg.angle_metric(0.0, outer_count=3)
weights = LegWeights(orientation_length=0.02, cross_sections=4, centreline_weight=0.3)
gap = tf.Metric("gap", "mm", 0.0, lambda of, x: 1e3 * mean_gap(body, of, x, middle), 2e3 * RADIUS)
ribs = 0.385 + 0.265 * np.cos(2 * np.pi * pattern.centroids[:, 0] / (0.4 * WIDTH))
case = tf.Case(
    pattern,
    target,
    supports,
    pressure=15e3,  # Pa, the most that the pump gives
    pressure_bounds=(1.5e3, 15e3),
    composite=composite,
    parts=[
        leg.sections(pattern, weights),
        lambda nodes, _: GapObjective(nodes, body, strip.astype(float), factor=100.0),
        lambda nodes, _: HoldingObjective(nodes, contact, sizes, supports.fixed, up, needed, 0.1),
    ],
    metrics=[gap, replace(tip, target=tip.measure(pattern, target))],
    passive=np.where(inner & (np.abs(plane_centroids(pattern)[:, 1]) < 3e-3), 1.0, np.nan),
    start=np.where(inner, 0.65, ribs),  # else it is the same in and out
    symmetry=(1,),
    contact=contact,
)

# %% [markdown]
# ## Design, print, files
# Steps that only raise the holding force are small: no stage ends because T falls slowly.
# %%
options = tf.DesignOptions((tf.Stage(60), tf.Stage(40, constrained=True)))
design = tf.ShapeDesign(comm, case, tf.Regularisation(filter_radius))
reporter = tf.DesignReporter(comm, given.output, overwrite=given.overwrite)
result = tf.optimize_levels([design], [options], seed=given.seed, callback=reporter)
limits, area = tf.PrintLimits(0.6e-3, 0.6e-3), 20e-6
printed = tf.trimmed(tf.as_printed(design, result, limits, island_area=area))
result, printed = tf.corrected(result, printed, callback=reporter)
tf.write_results(given.output, result, printed, seconds=reporter.seconds)

# %% [markdown]
# ## The lift
# Seen from the mounts the sphere goes down, by up to 5 mm, until the fingers bear it. Nothing moves
# it back, so the largest force up to there tells the largest mass. Friction acts from here on.
# %%
made, parts, limit = printed.evaluation or result.final, 2 * FINGERS, 5e-3
problem = made.problem  # that of the print has a mesh of its own, along its borders
assert isinstance(problem, tf.ShapeDesign)
of, pulling = problem.case, replace(problem.case.contact, friction=FRICTION)
solver = tf.EquilibriumSolver(
    problem.skin, composite, of.supports, contact=pulling, quadratic=of.quadratic
)
at = made.projected, made.equilibrium.pressure, limit * np.linspace(0.0, 1.0, 9) ** 2, ALONG
pull = list(pull_out(solver, *at, made.equilibrium))
end = next((point for point in pull if point.force >= MASS * GRAVITY / parts), pull[-1])
closed, lifted = (problem.whole.at_vertices(one.positions) for one in (pull[0], end))
shapes = [("closed", closed, 0.0, 0.0), ("lifted", lifted, end.depth, 0.05)]
rows = [(problem.whole.at_cells(problem.skin.gather_cells(at[0])), shapes)]
grams = 1e3 * parts / GRAVITY * largest_force(pull, limit)
told = f"The fingers bear {grams:.0f} g at {at[1]:.0f} Pa"
write_lift(comm, given.output, printed.pattern, rows, printed.regions, ball, FINGERS, told)
if comm.rank == 0:
    print(f"{told}; see shape.png and lift.png in {given.output}/")
