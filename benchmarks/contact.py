"""Cost and safety of contact: scenes with and without it, and random scenes.

    scripts/fenicsx python3 benchmarks/contact.py --json contact.json
    scripts/fenicsx python3 benchmarks/contact.py --random 200 --rows output/contact/random.jsonl
    scripts/fenicsx python3 benchmarks/contact.py --iterations 20

Each row is a cold solve: pairs in contact at its end, wall time with and without contact, Newton
steps, smallest distance between faces. `penetrated` comes from another test than the solver's: it
looks for edges that cross triangles, of the skin's middle surface and of the bodies as they were
made. With `--iterations` the first iterations of two designs take the place of the solves, each
once with contact and once without. The exit code is 1 if anything is penetrated. It runs on one
rank.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import ipctk
import numpy as np
import random_scenes
from case_options import parsed, parser_of
from mpi4py import MPI
from page_tables import replaced
from petsc4py import PETSc
from random_scenes import logarithmic
from shared_rows import complete, deadline
from stability_scenes import Floats

from toros_fem.base.errors import TorosError
from toros_fem.base.validation import require_count
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact import Contact, Ground, RigidBody, rigid_sphere
from toros_fem.mechanics.contact.motion import placed
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.skin.supports import Supports, clamp, pin, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, finger, sew
from toros_fem.meshes.outline import two_panels
from toros_fem.meshes.sheet import one_panel
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.config import ActuatorConfig
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.gripper import gripper
from toros_fem.products.walker import walker

PAGE = Path(__file__).parent.parent / "docs" / "contact.md"
MARKS = ("<!-- cost of contact -->", "<!-- end of the cost of contact -->")
STEP_MARKS = ("<!-- design steps with contact -->", "<!-- end of the design steps -->")
RANDOM_MARKS = ("<!-- random contacts -->", "<!-- end of the random contacts -->")
# Wall time in s after which a scene counts as slow.
LONGEST = 100.0
OUTCOMES = ("equilibrium", "no equilibrium", "refused", "slow", "penetrated", "wrong")


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


def row_of(scene: ContactScene) -> dict[str, Any]:
    """Return the row of a scene, solved once with contact and once without."""
    skin = sew(MPI.COMM_SELF, scene.pattern)
    density = scene.density[skin.owned_cells]
    found: dict[str, Any] = {"triangles": len(scene.pattern.triangles)}
    for key, contact in (("without", None), ("with", scene.contact)):
        solver = EquilibriumSolver(skin, scene.composite, scene.supports, contact=contact)
        begin = time.perf_counter()
        result = solver.solve(density, scene.pressure, force=scene.force, raise_on_failure=False)
        found[f"seconds_{key}"] = round(time.perf_counter() - begin, 3)
        found[f"steps_{key}"] = result.steps
        found[f"converged_{key}"] = result.converged
        points = skin.gather_vertices(result.positions)
        found[f"penetrated_{key}"] = penetrated(
            points, scene.pattern.triangles, scene.contact, result.poses
        )
    touching = solver.model.contact
    assert touching is not None
    assert result.smallest_distance is not None
    found |= {
        "pairs": touching.count,
        "steps": found["steps_with"],
        "smallest_distance_mm": 1e3 * result.smallest_distance,
        "penetrated": found["penetrated_with"],
    }
    return found


def random_contact(seed: int, scene: random_scenes.RandomScene) -> tuple[Contact, Floats]:
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


def random_row(seed: int) -> dict[str, Any]:
    """Return the row of a random scene."""
    begin = time.perf_counter()
    row: dict[str, Any] = {
        "seed": seed, "shape": random_scenes.draw_shape(seed)[1], "outcome": "wrong", "why": "",
        "steps": 0, "pairs": 0, "smallest_distance_mm": None,
    }  # fmt: skip
    try:
        with deadline(LONGEST):
            row |= _solved(seed)
    except TorosError as error:
        row |= {"outcome": "refused", "why": f"{type(error).__name__}: {error}"}
    except (TimeoutError, PETSc.Error) as error:  # PETSc passes the interruption on as its own
        row |= {"outcome": "slow", "why": str(error).splitlines()[0]}
    except Exception as error:  # the table is to show it, not to stop at it
        row |= {"outcome": "wrong", "why": f"{type(error).__name__}: {error}"}
    return {**row, "seconds": round(time.perf_counter() - begin, 2)}


def _solved(seed: int) -> dict[str, Any]:
    scene = random_scenes.draw(seed, few_terms=True)
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
    result: EquilibriumResult
    try:
        result = solver.solve(density, load.pressures.tolist(), force=force)
    except EquilibriumError as error:
        result = error.result
    touching = solver.model.contact
    assert touching is not None
    points = skin.gather_vertices(result.positions)
    # An error's state may be the start, which may cross itself as it was drawn.
    solved = result.converged or result.load_factor > 0
    crossed = solved and penetrated(points, skin.pattern.triangles, contact, result.poses)
    outcome = "equilibrium" if result.converged else "no equilibrium"
    least = result.smallest_distance
    return {
        "outcome": "penetrated" if crossed else outcome,
        "steps": result.steps,
        "pairs": touching.count if result.converged else 0,
        "why": "" if result.converged else result.reason,
        "smallest_distance_mm": None if least is None or not solved else 1e3 * least,
    }


def design_row(
    name: str, case: ActuatorCase, config: ActuatorConfig, iterations: int
) -> dict[str, Any]:
    """Return the row of a design: seconds and factorisations an iteration, with and without.

    Args:
        name: Name of the scene.
        case: Its case, with contact.
        config: Its numbers.
        iterations: Number of iterations.
    """
    row: dict[str, Any] = {"scene": name, "triangles": len(case.pattern.triangles)}
    for key, made in (("with", case), ("without", replace(case, contact=None, further=None))):
        problem = actuator_problem(MPI.COMM_SELF, made, config)
        found = optimize(problem, DesignOptions((Stage(iterations),)), seed=0)
        rows = found.history[2:]  # the first compile forms and solve from the assembled skin
        seconds = [r.seconds for r in rows]
        row[f"seconds_{key}"] = round(float(np.mean(seconds)), 3)
        row[f"median_{key}"] = round(float(np.median(seconds)), 3)
        row[f"steps_{key}"] = round(float(np.mean([r.newton_steps for r in rows])), 1)
    return row


def step_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of design iterations."""
    lines = [
        "| design | triangles | Newton steps an iteration without, with | seconds without, with | "
        "ratio, of the medians |",
        "|---" * 5 + "|",
    ]
    lines += [
        f"| {r['scene']} | {r['triangles']} | {r['steps_without']}, {r['steps_with']} | "
        f"{r['seconds_without']:.2f}, {r['seconds_with']:.2f} | "
        f"{r['seconds_with'] / r['seconds_without']:.2f}, "
        f"{r['median_with'] / r['median_without']:.2f} |"
        for r in rows
    ]
    return "\n".join(lines)


def design_rows(iterations: int) -> list[dict[str, Any]]:
    """Return the rows of gripper and walker, coarse and on their default meshes."""
    rows = []
    for size, change in (("coarse", True), ("default mesh", False)):
        config = gripper.GripperConfig()
        config = gripper.coarse(config) if change else config
        case = gripper.case(MPI.COMM_SELF, config)
        rows.append(design_row(f"gripper, {size}", case, config, iterations))
        print(rows[-1], flush=True)
        legs = walker.WalkerConfig()
        legs = walker.coarse(legs) if change else legs
        quarter = replace(walker.case(MPI.COMM_SELF, legs), contact=Contact())
        rows.append(design_row(f"walker, {size}", quarter, legs, iterations))
        print(rows[-1], flush=True)
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of the scenes."""
    lines = [
        "| scene | triangles | pairs | steps without, with | seconds without, with | ratio | "
        "smallest distance | crosses without |",
        "|---" * 8 + "|",
    ]
    lines += [
        f"| {r['scene']} | {r['triangles']} | {r['pairs']} | {r['steps_without']}, "
        f"{r['steps_with']} | {r['seconds_without']:.1f}, {r['seconds_with']:.1f} | "
        f"{r['seconds_with'] / r['seconds_without']:.1f} | "
        f"{r['smallest_distance_mm']:.3f} mm | {'yes' if r['penetrated_without'] else 'no'} |"
        for r in rows
    ]
    return "\n".join(lines)


def random_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return outcomes by shape, and what is not an equilibrium."""
    lines = [
        f"| shape | scenes | in contact | {' | '.join(OUTCOMES)} | steps: median, most |",
        "|---" * (len(OUTCOMES) + 4) + "|",
    ]
    for shape in [*random_scenes.SHAPES, "all"]:
        group = [row for row in rows if shape in (row["shape"], "all")]
        counts = Counter(row["outcome"] for row in group)
        steps = [row["steps"] for row in group if row["outcome"] == "equilibrium"] or [0]
        touching = sum(row["pairs"] > 0 for row in group)
        cells = " | ".join(str(counts[outcome]) for outcome in OUTCOMES)
        lines.append(
            f"| {shape} | {len(group)} | {touching} | {cells} | "
            f"{np.median(steps):.0f}, {max(steps)} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Command line."""
    parser = parser_of(__doc__, PAGE)
    parser.add_argument("--only", choices=tuple(SCENES), help="one scene")
    parser.add_argument("--quick", action="store_true", help="the coarsest mesh of each scene")
    parser.add_argument("--random", type=int, default=None, help="random scenes in their place")
    parser.add_argument("--seed", type=int, default=0, help="of the first random scene")
    parser.add_argument(
        "--iterations", type=int, default=None, help="of two designs, in place of the scenes"
    )
    options = parsed(parser)
    marks, text_of = (RANDOM_MARKS, random_table) if options.random else (MARKS, table)
    if options.iterations:
        marks, text_of = STEP_MARKS, step_table
    if options.source:
        rows = json.loads(options.source.read_text(encoding="utf-8"))["rows"]
    elif options.iterations:
        require_count(4, iterations=options.iterations)
        rows = design_rows(options.iterations)
    elif options.random:
        require_count(1, random=options.random)
        seeds = range(options.seed, options.seed + options.random)
        tasks = {str(seed): seed for seed in seeds}
        rows = list(complete(tasks, random_row, options.rows, options.workers, _print_row).values())
    else:
        rows = []
        for name, (make, lengths) in SCENES.items():
            if options.only in (None, name):
                for edge_length in lengths[:1] if options.quick else lengths:
                    rows.append({"scene": name, **row_of(make(edge_length))})
                    print(rows[-1], flush=True)
    text = text_of(rows)
    print(f"\n{text}")
    bad = [row for row in rows if row.get("penetrated") or row.get("outcome") == "penetrated"]
    if options.json:
        lines = ",\n".join(json.dumps(row) for row in rows)
        options.json.write_text(
            f'{{"penetrated": {len(bad)}, "rows": [\n{lines}\n]}}\n', encoding="utf-8"
        )
    if options.docs:
        page = options.page.read_text(encoding="utf-8")
        options.page.write_text(replaced(page, *marks, text), encoding="utf-8")
    return 1 if bad else 0


def _print_row(key: str, row: dict[str, Any]) -> None:
    why = f": {row['why']}" if row["why"] else ""
    print(f"{key} {row['outcome']}, {row['steps']} steps, {row['seconds']} s{why}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
