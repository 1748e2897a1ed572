# %% [markdown]
# # A walker that stands up (paper Fig. 9)
#
# Two flat panels are sewn along an X: a body and four legs. Inflated to 20 kPa at most, each leg is
# to turn down by 90°, so that the robot stands. By symmetry a quarter with one leg is designed. A
# density ρ of print in each triangle minimises
#
#     T(ρ) = Σ w |x̄ₖ − x̄ₖ*|² + v |Rₖ − Rₖ*|²,                             (eqs. 17, 18)
#
# where x̄ₖ and Rₖ are mean position and rotation of cross-section k of the leg at the equilibrium
# x(ρ), a minimum of W_stretch + W_bend − p V (eqs. 1-10). Orientations count most.
#
# The printed robot then walks. It lies on the ground with its weight, friction and pads that slide
# forwards easily, and its chambers are filled and emptied in turn. This gait is a path of
# equilibria, without inertia (docs/walking.md).
#     python demos/walker.py --coarse            # two minutes
#     mpirun -n 2 python demos/walker.py         # the mesh of the figures in docs/demos.md

# %%
import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.mechanics.contact.sliding import Pads
from toros_fem.meshes import Star, mirrored, plane_centroids, stand, walker
from toros_fem.products.actuators.legs import Leg, LegWeights, rest_on_body
from toros_fem.products.gait import Gait, flat_on_ground, walk_of, write_gait
from toros_fem.products.walker import chambers

parser = argparse.ArgumentParser(description="Design a walker that stands up, and let it walk.")
parser.add_argument("--coarse", action="store_true", help="a coarse mesh, and printed feet")
parser.add_argument("--seed", type=int, default=2, help="seed of the random start")
parser.add_argument("--output", type=Path, default=Path("output/walker"), help="its folder")
parser.add_argument("--overwrite", action="store_true", help="replace the run in it")
given = parser.parse_args()
comm = MPI.COMM_WORLD

ANGLE, PRESSURE = 90.0, 20e3  # deg, Pa
star = Star(4, 0.06, 0.024, body_radius=0.02, corner_radius=6e-3, angle=np.pi / 4)
edge, radius, foot = (2.8e-3, 4.3e-3, 15e-3) if given.coarse else (1.8e-3, 2.75e-3, 0.0)  # m

# %% [markdown]
# ## Panels, seams, supports, target
#
# The target bends the leg over 3 cm from its root; the rest of it stays straight. A closed skin
# under pressure needs no force to stay in place: the bottom's centre keeps its height, the planes
# of symmetry do the rest. On the coarse mesh the feet are printed: few steps leave holes there.

# %%
along = np.append(star.directions[0], 0.0)
bent = stand(np.radians(ANGLE), 0.03, directions=star.directions[:1], root=star.root)
leg = Leg(along, (0.0, 0.0, -1.0), star.root)
weights = LegWeights(cross_sections=6, centreline_weight=0.02, orientation_length=0.03)
composite = tf.Composite(bending=tf.Bending(seams="hinged"))  # sewn seams carry no moment


def case(edge: float) -> tf.Case:
    """Return a quarter of the robot on a mesh, and its target."""
    pattern = walker(comm, edge, star, planes=(0, 1))
    return tf.Case(
        pattern,
        target=bent(pattern.points),
        supports=rest_on_body(pattern, star.body_radius, (0, 1)),
        pressure=PRESSURE,  # the most that the pump gives
        pressure_bounds=(PRESSURE / 10, PRESSURE),
        composite=composite,
        parts=[leg.sections(pattern, weights)],
        metrics=[leg.angle_metric(ANGLE)],
        passive=np.where(plane_centroids(pattern) @ along[:2] > star.reach - foot, 1.0, np.nan),
        # The top is to stretch; without this hint the start does not tell up from down.
        start=np.where(pattern.panel == pattern.panel_index("top"), 0.35, 0.65),
        symmetry=(0, 1),
    )


first, second = (40, 30) if given.coarse else (60, 40)
found = tf.design_skin(
    comm,
    case,
    edge,
    given.output,
    overwrite=given.overwrite,
    seed=given.seed,
    filter_radius=radius,
    iterations=first,
    constrained_iterations=second,
    check_refinement=2,  # a mesh with edges half as long tells the figures
)

# %% [markdown]
# ## The gait
#
# Half of the robot, front and rear leg on one side, has three chambers: body, front and rear legs.
# All are filled, then the legs are emptied, and so on. Full legs draw the rear feet up to the front
# ones; emptied, they push the front ones ahead.
# %%
made = found.printed.evaluation or found.design.final
assert isinstance(made.problem, tf.ShapeDesign)
quarter, quadratic = made.problem.skin, made.problem.case.quadratic  # on the print's own mesh
both = mirrored(quarter.pattern, (0,))
half = both.pattern
skin, supports = tf.sew(comm, half), tf.symmetry_plane(half, 1)
sizes = tf.Contact().sizes(composite)
start, height = flat_on_ground(comm, half, supports, sizes)
reach = (half.points[:, :2] @ star.directions.T).max(axis=1)
solver = tf.EquilibriumSolver(
    skin,
    composite,
    supports,
    chambers=chambers(half, star),
    quadratic=None if quadratic is None else quadratic[both.cell],
    weight=tf.Weight(0.25, 0.25 + 0.6),  # kg/m² of fabric, and of fabric and print
    contact=tf.Contact(
        tf.Ground((0.0, 0.0, height)),
        friction=0.8,
        pads=Pads(reach > star.reach - 0.015, (1.0, 0.0, 0.0), forward=0.2, backward=0.8),
    ),
)
gait = Gait(("body", "front", "rear"), np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0]]), steps=8)
density = both.at_cells(quarter.gather_cells(made.projected))[skin.owned_cells]
pressures = [list(made.equilibrium.pressure * row) for row in gait.pressure_fractions]
points = list(tf.trace(solver, density, pressures, start=start[skin.owned_vertices]))
touching = sizes.thickness / 2 + sizes.distance
walk = walk_of(gait, points, mirrored(half, (1,)), star.directions, height, touching)
write_gait(comm, given.output, walk, found.printed.regions)
if comm.rank == 0:
    print(found)
    print(f"A stride of {1e3 * walk.stride:.1f} mm; see report.html and gait.png in {given.output}")
