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
# barriers of Li et al. 2020). Then the printed fingers lift it; `toros design` on
# `demos/scenes/gripper.toml` draws this too.
#     python demos/gripper.py --coarse            # three minutes
#     mpirun -n 2 python demos/gripper.py         # the mesh of the figures in docs/demos.md

# %%
import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.measures.regions import Body, GapObjective, mean_gap
from toros_fem.measures.shape import Nodes
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.paths.pull_out import largest_force, pull_out
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import curl, finger, plane_centroids
from toros_fem.products.actuators.legs import Leg, LegWeights

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
begin = LENGTH - WRAP * RADIUS
body = Body("sphere", 2 * RADIUS, (begin, 0.0, DEPTH / 2 + RADIUS))
bent = curl(WRAP, WRAP * RADIUS, origin=(begin, 0, DEPTH / 2), along=ALONG, toward=TOWARD)
composite = tf.Composite(bending=tf.Bending(seams="hinged"))  # sewn seams carry no moment
wall = (0.0, -np.cos(np.pi / FINGERS), -np.sin(np.pi / FINGERS))
ball, ground = rigid_sphere("object", RADIUS, body.centre), tf.Ground((0, 0, body.centre[2]), wall)
contact = tf.Contact(ground, bodies=[ball], self_contact=False)
# Upwards, and towards the sphere's axis as far as friction makes use of it.
direction, needed = FRICTION * np.array(TOWARD) - ALONG, 1.5 * MASS * GRAVITY / (2 * FINGERS)
sizes, leg = contact.sizes(composite), Leg(ALONG, TOWARD, ROOT)
tip = leg.angle_metric(0.0, outer_count=3)
weights = LegWeights(orientation_length=0.02, cross_sections=4, centreline_weight=0.3)


def on_inner(pattern: tf.meshes.Pattern) -> np.ndarray:
    """Return which vertices lie on the inner panel."""
    return np.isin(np.arange(len(pattern.points)), pattern.vertices_of("top"))


def touching(pattern: tf.meshes.Pattern, part: float) -> np.ndarray:
    """Return which vertices are to touch, in the middle of the inner panel."""
    x, y, _ = pattern.points.T
    beyond = (x > begin) & (x < LENGTH - WIDTH / 4)
    return on_inner(pattern) & beyond & (np.abs(y) < part * WIDTH)


def held(pattern: tf.meshes.Pattern) -> Supports:
    """Return the supports by the mount, whose stem carries the inner panel, and by symmetry."""
    x, far = pattern.points[:, 0], 1 + 1e-9
    fixed = (x <= ROOT * far) | (on_inner(pattern) & (x <= STEM * far))
    return tf.clamp_where(pattern, lambda _: fixed) | tf.symmetry_plane(pattern, 1)


def gap(of: tf.meshes.Pattern, x: np.ndarray) -> float:
    """Return the distance of the inner panel's middle from the sphere in mm: fingers are round."""
    return 1e3 * mean_gap(body, of, x, touching(of, 1 / 24))


def close(nodes: Nodes, _: np.ndarray) -> GapObjective:
    """Return the part of T by the distance."""
    return GapObjective(nodes, body, touching(nodes.pattern, 1 / 6).astype(float), factor=100.0)


def hold(nodes: Nodes, _: np.ndarray) -> HoldingObjective:
    """Return the part of T by the force."""
    fixed = held(nodes.pattern).fixed
    return HoldingObjective(nodes, contact, sizes, fixed, direction, needed, 0.1)


def case(edge: float) -> tf.Case:
    """Return half a finger on a mesh, and its target."""
    pattern = finger(comm, edge, length=LENGTH, width=WIDTH, root=ROOT, planes=(1,))
    inner, target = pattern.panel == pattern.panel_index("top"), bent(pattern.points)
    ribs = 0.385 + 0.265 * np.cos(2 * np.pi * pattern.centroids[:, 0] / (0.4 * WIDTH))
    return tf.Case(
        pattern,
        target,
        held(pattern),
        pressure=15e3,  # Pa, the most that the pump gives
        pressure_bounds=(1.5e3, 15e3),
        composite=composite,
        parts=[leg.sections(pattern, weights), close, hold],
        metrics=[
            tf.Metric("gap", "mm", 0.0, gap, 2e3 * RADIUS),
            replace(tip, target=tip.measure(pattern, target)),
        ],
        passive=np.where(inner & (np.abs(plane_centroids(pattern)[:, 1]) < 3e-3), 1.0, np.nan),
        start=np.where(inner, 0.65, ribs),  # else it is the same in and out
        symmetry=(1,),
        contact=contact,
    )


# %% [markdown]
# ## Design, print, verdict. Steps that only raise the holding force are small: none ends a stage.
# %%
found = tf.design_skin(
    comm,
    case,
    edge,
    given.output,
    overwrite=given.overwrite,
    seed=given.seed,
    filter_radius=filter_radius,
    min_decrease=None,
    polish_iterations=40,
)

# %% [markdown]
# ## The lift
# Seen from the mounts the sphere goes down, by up to 5 mm, until the fingers bear it. Nothing moves
# it back, so the largest force up to there tells the largest mass. Friction acts from here on.
# %%
made, limit = found.printed.evaluation or found.design.final, 5e-3  # m
problem = made.problem  # that of the print has a mesh of its own, along its borders
assert isinstance(problem, tf.ShapeDesign)
of, pulling = problem.case, replace(problem.case.contact, friction=FRICTION)
solver = tf.EquilibriumSolver(
    problem.skin, composite, of.supports, contact=pulling, quadratic=of.quadratic
)
depths, state = limit * np.linspace(0.0, 1.0, 9) ** 2, made.equilibrium
pull = list(pull_out(solver, made.projected, state.pressure, depths, ALONG, state))
grams = 1e3 * 2 * FINGERS / GRAVITY * largest_force(pull, limit)
if comm.rank == 0:
    print(found)
    print(f"The fingers bear {grams:.0f} g; see report.html in {given.output}/")
