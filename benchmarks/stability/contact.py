"""Cost and safety of contact: scenes with and without it, and random scenes.

Each scene is a cold solve: pairs in contact at its end, wall time and Newton steps with and without
contact, smallest distance between faces. "crosses" comes from another test than the solver's: it
looks for edges that cross triangles, of the skin's middle surface and of the bodies as they were
made. The first iterations of two designs are run once with contact and once without.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from benchmarks.bench import Row, deadline, timed
from benchmarks.stability.drawn import Outcome, RandomScene, draw, draw_shape, logarithmic
from benchmarks.stability.scenes import Floats
from toros_fem.base.errors import TorosError
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import Ground, RigidBody, placed
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, clamp, pin, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, finger, sew
from toros_fem.meshes.outlines import two_panels
from toros_fem.meshes.sheets import one_panel
from toros_fem.products import gripper, walker

# Wall time in s after which a scene counts as slow.
LONGEST = 100.0
WAYS = ("without", "with")


@dataclass(frozen=True, eq=False)
class ContactScene:
    """Everything that a cold solve needs.

    Attributes:
        pattern: The pattern.
        supports: Fixed components.
        density: Of the pattern's triangles.
        pressure: In Pa.
        contact: What the skin touches.
        force: Dead forces in N; None for none.
        composite: Materials.
    """

    pattern: Pattern
    supports: Supports
    density: Floats
    pressure: float
    contact: Contact
    force: Floats | None = None
    composite: Composite = field(default_factory=Composite)


def pressed_tube(edge_length: float) -> ContactScene:
    """A tube that swells against a floor, and a ball on its other side."""
    pattern = cylinder(MPI.COMM_SELF, 0.06, 0.02, edge_length)
    floor = Ground((-0.0112, 0.0, 0.0), (1.0, 0.0, 0.0))
    ball = rigid_sphere("ball", 0.01, (0.004, 0.0202, 0.035))
    supports = clamp(pattern, ["base"])
    plain = np.zeros(len(pattern.panel))
    return ContactScene(pattern, supports, plain, 5e3, Contact(ground=floor, bodies=[ball]))


def finger_on_ball(edge_length: float) -> ContactScene:
    """Half a finger of a gripper, printed outside, that bends around a ball of 40 mm."""
    pattern = finger(MPI.COMM_SELF, edge_length, length=0.09, width=0.025, root=0.015, planes=(1,))
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[pattern.points[:, 0] <= 0.015 * (1 + 1e-9)] = True
    supports = Supports(fixed) | symmetry_plane(pattern, 1)
    inner = pattern.panel == pattern.panel_index("top")
    ball = rigid_sphere("ball", 0.02, (0.055, 0.0, 0.028))
    density = np.where(inner, 1.0, 0.0)
    return ContactScene(pattern, supports, density, 10e3, Contact(bodies=[ball]))


def pillow(edge_length: float) -> ContactScene:
    """A pillow whose print of stripes folds it at a low pressure: layers close on each other."""
    side = 0.04
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float64)
    pattern = two_panels(MPI.COMM_SELF, corners, edge_length)
    x, y = pattern.centroids.T
    stripes = (np.sin(2 * np.pi * (x + y) / 0.012) > 0.6).astype(np.float64)
    return ContactScene(pattern, pin(pattern), stripes, 300.0, Contact())


def folded_strip(edge_length: float) -> ContactScene:
    """A strip bent over into a hairpin by a dead force at its end."""
    length, width = 0.06, 0.012
    nx, ny = max(4, round(length / edge_length)), max(2, round(width / edge_length))
    u, v = np.meshgrid(np.linspace(0, length, nx + 1), np.linspace(0, width, ny + 1))
    node = np.arange(u.size).reshape(u.shape)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    cells = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    flat = np.column_stack([u.ravel(), v.ravel()])

    def bent(points: Floats) -> Floats:
        """Half of it turns back above the other half."""
        radius = 0.003
        s, y = points[:, 0] - 0.028, points[:, 1]
        turn = np.clip(s / radius, 0.0, np.pi)
        x = np.where(s < 0, s, radius * np.sin(turn)) - np.maximum(s - np.pi * radius, 0.0)
        return np.column_stack([x, y, radius * (1 - np.cos(turn))])

    pattern = one_panel(flat, cells, bent)
    fixed = np.repeat((flat[:, 0] < 0.03)[:, None], 3, axis=1)
    force = np.zeros((len(flat), 3))
    upper = flat[:, 0] > 0.042
    force[upper, 2] = -0.02 * pattern.vertex_areas[upper] / pattern.vertex_areas[upper].sum()
    return ContactScene(pattern, Supports(fixed), np.zeros(len(cells)), 0.0, Contact(), force)


SCENES: dict[str, tuple[Callable[[float], ContactScene], tuple[float, ...]]] = {
    "pressed tube": (pressed_tube, (3e-3, 1.5e-3, 0.95e-3)),
    "finger on a ball": (finger_on_ball, (2.4e-3, 1.2e-3, 0.8e-3)),
    "pillow": (pillow, (2.5e-3, 1.25e-3, 0.75e-3)),
    "folded strip": (folded_strip, (2e-3, 1e-3, 0.5e-3)),
}


def penetrated(scene_points: Floats, triangles: Any, contact: Contact, poses: Any) -> bool:
    """Return whether edges cross triangles, or a vertex is below the ground."""
    import ipctk  # an extra

    points, faces, count = [scene_points], [triangles], len(scene_points)
    for k, body in enumerate(contact.bodies):
        pose = np.zeros(6) if poses is None else np.asarray(poses[k])
        points.append(placed(body.points, body.centre, pose))
        faces.append(body.triangles + count)
        count += len(body.points)
    every, cells = np.concatenate(points), np.concatenate(faces).astype(np.int32)
    below = any(
        ((scene_points - np.array(g.point)) @ np.array(g.normal) < 0).any() for g in contact.grounds
    )
    mesh = ipctk.CollisionMesh(
        np.asfortranarray(every), ipctk.edges(cells), np.asfortranarray(cells)
    )
    return below or bool(ipctk.has_intersections(mesh, np.asfortranarray(every)))


def scene_rows(name: str, edge_length: float) -> Iterator[Row]:
    """Return the rows of a scene, solved once with contact and once without."""
    scene = SCENES[name][0](edge_length)
    skin = sew(MPI.COMM_SELF, scene.pattern)
    density = scene.density[skin.owned_cells]
    place = ("contact", name, f"{len(scene.pattern.triangles)}")
    for way, contact in zip(WAYS, (None, scene.contact), strict=True):
        solver = EquilibriumSolver(skin, scene.composite, scene.supports, contact=contact)
        result, seconds = timed(
            lambda solver=solver: solver.solve(  # type: ignore[misc]
                density, Load(scene.pressure, force=scene.force), raise_on_failure=False
            )
        )
        points = skin.gather_vertices(result.positions)
        crosses = penetrated(points, scene.pattern.triangles, scene.contact, result.poses)
        yield Row(*place, f"steps {way}", float(result.steps))
        yield Row(*place, f"seconds {way}", seconds, "s")
        yield Row(*place, f"crosses {way}", float(crosses))
    touching = solver.model.contact
    assert touching is not None
    assert result.smallest_distance is not None
    yield Row(*place, "pairs", float(touching.count_pairs(result.state)))
    yield Row(*place, "smallest distance", result.smallest_distance, "m")


def random_contact(seed: int, scene: RandomScene) -> tuple[Contact, Floats]:
    """Return a floor and up to two balls near a random skin, and the direction out of the floor."""
    rng = np.random.default_rng([25, seed])
    points, size = scene.skin.pattern.points, scene.skin.pattern.size
    thickness = scene.composite.fabric.thickness
    flat = np.ptp(points[:, 2]) < 0.1 * size
    up = np.array([0.0, 0.0, 1.0]) if flat else rng.standard_normal(3)
    up /= np.linalg.norm(up)
    gap = thickness + size * logarithmic(rng, 3e-3, 0.1)
    ground = None
    if rng.random() < 0.7:
        least = (points @ up).min() - gap
        ground = Ground(tuple(least * up), tuple(up))
    bodies: list[RigidBody] = []
    for k in range(int(rng.integers(0 if ground else 1, 3))):
        radius = size * logarithmic(rng, 0.05, 0.4)
        out = up * rng.choice([-1.0, 1.0]) if flat else rng.standard_normal(3)
        if ground is not None and out @ up < 0:
            out = -out
        out /= np.linalg.norm(out)
        place = points[rng.integers(len(points))]
        # Moved outwards until it is clear of the skin, and of the bodies before it.
        for distance in np.arange(0.0, 3.0, 0.01) * size + radius + gap:
            centre = place + distance * out
            clear = np.linalg.norm(points - centre, axis=1).min() > radius + gap
            others = all(np.linalg.norm(b.centre - centre) > b.radius + radius for b in bodies)
            if clear and others:
                bodies.append(rigid_sphere(f"ball {k}", radius, tuple(centre)))
                break
    return Contact(ground=ground, bodies=bodies), up


def drawn_with_contact(seed: int) -> Outcome:
    """Return what becomes of a random scene beside a floor and balls."""
    begin, found = time.perf_counter(), Outcome(draw_shape(seed)[1])
    try:
        with deadline(LONGEST):
            _solve(found, seed)
    except TorosError as error:
        found.outcome, found.why = "refused", f"{type(error).__name__}: {error}"
    except (TimeoutError, PETSc.Error) as error:  # PETSc passes the interruption on as its own
        found.outcome, found.why = "slow", str(error).splitlines()[0]
    except Exception as error:  # the table is to show it, not to stop at it
        found.outcome, found.why = "wrong", f"{type(error).__name__}: {error}"
    found.seconds = time.perf_counter() - begin
    return found


def _solve(found: Outcome, seed: int) -> None:
    scene = draw(seed, few_terms=True)
    contact, up = random_contact(seed, scene)
    skin, load = scene.skin, scene.load
    force = load.force
    if contact.grounds and (force is None or seed % 2):
        # Pressed onto the floor.
        pattern = skin.pattern
        press = scene.composite.fabric.membrane_stiffness * 0.02 / pattern.areas.sum()
        more = -np.outer(pattern.vertex_areas * press * pattern.size, up)
        force = more if force is None else force + more
    solver = EquilibriumSolver(skin, scene.composite, scene.supports, contact=contact)
    density = scene.density[skin.owned_cells]
    try:
        result = solver.solve(density, Load(load.pressures.tolist(), force=force))
    except EquilibriumError as error:
        result = error.result
    touching = solver.model.contact
    assert touching is not None
    points = skin.gather_vertices(result.positions)
    # An error's state may be the start, which may cross itself as it was drawn.
    solved = result.converged or result.load_factor > 0
    found.steps = result.steps
    found.pairs = touching.count_pairs(result.state) if result.converged else 0
    found.outcome = "equilibrium" if result.converged else "no equilibrium"
    found.why = "" if result.converged else result.reason
    if solved and penetrated(points, skin.pattern.triangles, contact, result.poses):
        found.outcome = "penetrated"


def design_cases(*, coarse: bool) -> dict[str, tuple[Any, Any]]:
    """Return case and configuration of a gripper and of a walker, both in contact."""
    grip, legs = gripper.GripperScene(), walker.WalkerScene()
    if coarse:
        grip, legs = grip.coarse(), legs.coarse()
    finger, quarter = (x.case(MPI.COMM_SELF, x.finest_level) for x in (grip, legs))
    return {"gripper": (finger, grip), "walker": (replace(quarter, contact=Contact()), legs)}


def design_rows(name: str, *, coarse: bool, iterations: int) -> Iterator[Row]:
    """Return what an iteration of a design costs, with and without contact."""
    case, config = design_cases(coarse=coarse)[name]
    size = "coarse" if coarse else "default mesh"
    place = ("design in contact", f"{name}, {size}", f"{len(case.pattern.triangles)}")
    without = replace(case, contact=None, parts=case.parts[:2])  # without the holding force
    for way, made in zip(WAYS, (without, case), strict=True):
        problem = config.problem(MPI.COMM_SELF, made, config.finest_level)
        found = optimize(problem, DesignOptions((Stage(iterations),)), seed=0)
        rows = found.history[2:]  # the first compile forms and solve from the assembled skin
        seconds = [row.seconds for row in rows]
        steps = float(np.mean([row.newton_steps for row in rows]))
        yield Row(*place, f"steps {way}", steps)
        yield Row(*place, f"seconds {way}", float(np.mean(seconds)), "s")
        yield Row(*place, f"median {way}", float(np.median(seconds)), "s")
