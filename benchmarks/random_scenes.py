"""Random skins under random loads, as a fuzzer would choose them.

    scripts/fenicsx python3 benchmarks/random_scenes.py --rows output/stability/random.jsonl

Outlines, panels, seams, materials, thickness, densities, pressures, dead forces, chambers and
supports are drawn by a seed, over many orders of magnitude. Each scene must end in an equilibrium
that the judge of `stability.py` finds stable, or in a typed error that is true: where the solver
gives up, the oracle of `stability.py` searches on. The exit code is 1 if a result is wrong, or a
scene that has a solution failed. It runs on one rank.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from case_options import parsed, parser_of
from mpi4py import MPI
from page_tables import replaced
from scipy.spatial import ConvexHull
from shared_rows import complete, deadline
from stability_judge import Judge
from stability_oracle import search_equilibrium
from stability_scenes import Floats, triangle_panels

from toros_fem.base.errors import TorosError
from toros_fem.base.validation import require_count
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load_case import LoadCase
from toros_fem.mechanics.skin.supports import Supports, pin
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.outline import two_panels
from toros_fem.meshes.planar import region_mesh
from toros_fem.meshes.sheet import one_panel

PAGE = Path(__file__).parent.parent / "docs" / "stability.md"
MARKS = ("<!-- random scenes -->", "<!-- end of the random scenes -->")
# Wall time in s after which a scene counts as hanging.
LONGEST = 300.0
OUTCOMES = ("equilibrium", "refused", "no equilibrium", "failed", "wrong")
Random = np.random.Generator


@dataclass(frozen=True, eq=False)
class RandomScene:
    """Everything that a solve needs.

    Attributes:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: Fixed components.
        chambers: Pressure chambers; None for one.
        density: Of the pattern's triangles.
        load: Pressures in Pa, dead forces in N, displacement of supports in m.
    """

    skin: Skin
    composite: Composite
    supports: Supports
    chambers: Chambers | None
    density: Floats
    load: LoadCase

    def solver(self, options: NewtonOptions | None = None) -> EquilibriumSolver:
        """Return a solver of the scene."""
        return EquilibriumSolver(
            self.skin, self.composite, self.supports, options, chambers=self.chambers
        )


def logarithmic(rng: Random, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def star(rng: Random, size: float) -> Floats:
    """Return the corners (k, 2) of a star-shaped outline, counter-clockwise."""
    count = int(rng.integers(4, 11))
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    radius = size / 2 * rng.uniform(0.45, 1.0, count)
    return np.asarray(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def edge_length(area: float, triangles: float) -> float:
    """Return the edge length in m of a number of equilateral triangles that fill an area."""
    return float(np.sqrt(4 / np.sqrt(3) * area / triangles))


def shoelace(corners: Floats) -> float:
    """Return the area inside an outline."""
    x, y = corners.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def layers(rng: Random, size: float, triangles: float) -> Pattern:
    """Two layers of a random outline."""
    corners = star(rng, size)
    return two_panels(MPI.COMM_SELF, corners, edge_length(2 * shoelace(corners), triangles))


def tube(rng: Random, size: float, triangles: float) -> Pattern:
    """A capped tube, from a flat can to a slender one."""
    diameter = size / logarithmic(rng, 0.5, 12)
    area = np.pi * diameter * (size + diameter / 2)
    mesh = str(rng.choice(["structured", "unstructured"]))
    return cylinder(MPI.COMM_SELF, size, diameter, edge_length(area, triangles), mesh=mesh)


def polyhedron(rng: Random, size: float, triangles: float) -> Pattern:
    """The convex hull of random points; each of its faces is a panel of its own."""
    points = rng.standard_normal((int(rng.integers(4, 11)), 3))
    points *= (
        size / 2 / np.linalg.norm(points, axis=1)[:, None] * rng.uniform(0.7, 1, (len(points), 1))
    )
    hull = ConvexHull(points)
    count = max(2, round(np.sqrt(triangles / len(hull.simplices))))
    outward = [
        face if np.linalg.det(points[face] - points.mean(axis=0)) > 0 else face[::-1]
        for face in hull.simplices
    ]
    return triangle_panels(points, np.array(outward), count)


def sheet(rng: Random, size: float, triangles: float) -> Pattern:
    """An open sheet of a random outline."""
    corners = star(rng, size)
    flat, cells, _ = region_mesh(corners, edge_length(shoelace(corners), triangles), (), ())
    return one_panel(flat, cells)


SHAPES: dict[str, Callable[[Random, float, float], Pattern]] = {
    "two layers": layers,
    "tube": tube,
    "polyhedron": polyhedron,
    "sheet": sheet,
}


def random_composite(rng: Random, size: float, *, few_terms: bool) -> Composite:
    """Return materials, thickness and stretch bounds; with few terms the default bending."""
    young, thickness = logarithmic(rng, 1e4, 1e8), size * logarithmic(rng, 3e-4, 3e-2)
    contrast = logarithmic(rng, 1.0, 1e4)
    thicker = thickness * rng.choice([1.0, logarithmic(rng, 1, 4)])
    composite = Composite(
        fabric=Material(young, rng.uniform(0, 0.5), thickness),
        reinforcement=Material(contrast * young, rng.uniform(0, 0.5), thicker),
        c1=1 + logarithmic(rng, 0.1, 3.0),
        c2=1 + logarithmic(rng, 0.2, 5.0),
        bending=Bending(
            seams=str(rng.choice(["continuous", "hinged"])),
            rest=str(rng.choice(["flat", "assembled"], p=[0.8, 0.2])),
        ),
    )
    if few_terms:
        return composite
    terms: dict[str, Any] = {}
    kind = str(
        rng.choice(["midedge", "average", "quadratic", "membrane"], p=[0.55, 0.2, 0.2, 0.05])
    )
    assert composite.bending is not None
    terms["bending"] = (
        None
        if kind == "membrane"
        else Bending(kind, composite.bending.seams, composite.bending.rest)
    )
    if rng.random() < 0.2:
        terms["bladder"] = Bladder(logarithmic(rng, 1e4, 1e7), 0.3 * thickness)
    if rng.random() < 0.2:
        terms["knit"] = Knit(logarithmic(rng, 1, 4), rng.uniform(0, np.pi))
    return Composite(composite.fabric, composite.reinforcement, composite.c1, composite.c2, **terms)


def random_supports(rng: Random, pattern: Pattern) -> Supports:
    """Return pins, a clamped region, two regions of which one moves; rarely too few of them."""
    kind = rng.choice(["pin", "clamp", "moved", "two points"], p=[0.35, 0.4, 0.2, 0.05])
    if kind == "pin":
        return pin(pattern)
    points = pattern.points
    direction = rng.standard_normal(3) * [1, 1, np.ptp(points[:, 2]) > 0.1 * pattern.size]
    place = points @ direction
    fixed = place <= np.quantile(place, rng.uniform(0.05, 0.3))
    if kind == "two points":
        fixed = np.zeros(len(points), dtype=bool)
        fixed[rng.choice(len(points), 2, replace=False)] = True
    displacement = None
    if kind == "moved":
        other = place >= np.quantile(place, rng.uniform(0.8, 0.95))
        by = logarithmic(rng, 1e-3, 0.1) * pattern.size * rng.standard_normal(3)
        displacement = np.where(other[:, None], by, 0.0)
        fixed |= other
    return Supports(np.repeat(fixed[:, None], 3, axis=1), displacement=displacement)


def random_density(rng: Random, pattern: Pattern) -> Floats:
    """Return one value for each triangle: smooth, of two values, noise, or everywhere the same."""
    kind = rng.choice(["smooth", "binary", "noise", "fabric", "reinforced"])
    if kind in ("fabric", "reinforced"):
        return np.full(len(pattern.panel), float(kind == "reinforced"))
    if kind == "noise":
        return rng.random(len(pattern.panel))
    waves = rng.standard_normal((4, 3)) * 2 * np.pi / pattern.size * rng.uniform(0.5, 3)
    centre = pattern.points[pattern.triangles].mean(axis=1)
    wave = np.cos(centre @ waves.T + rng.uniform(0, 2 * np.pi, 4)).mean(axis=1)
    smooth = np.clip(0.5 + wave, 0, 1)
    return np.asarray(smooth > rng.uniform(0.3, 0.7), dtype=float) if kind == "binary" else smooth


def random_load(
    rng: Random, pattern: Pattern, composite: Composite, chambers: int, supports: Supports
) -> LoadCase:
    """Return pressures, which only a closed skin has, and dead forces at a few vertices or all."""
    stiffness = composite.fabric.young * composite.fabric.thickness
    pressures = np.zeros(chambers)
    if not len(pattern.free_edges) and rng.random() < 0.85:
        pressures += stiffness / pattern.size * logarithmic(rng, 1e-3, 30)
        pressures[1:] *= rng.uniform(0.5, 1, chambers - 1)
    force = None
    if rng.random() < (0.35 if pressures.any() else 0.8):
        total = stiffness * pattern.size * logarithmic(rng, 1e-5, 0.3)
        chosen = rng.random(len(pattern.points)) < rng.choice([0.03, 1.0])
        chosen[rng.integers(len(chosen))] = True
        force = chosen[:, None] * rng.standard_normal(3) * total / chosen.sum()
    return LoadCase(pressures, force, supports.displacement)


def draw_shape(seed: int) -> tuple[Random, str]:
    """Return a seed's generator, and the first thing that it draws."""
    rng = np.random.default_rng([7, seed])
    return rng, str(rng.choice(list(SHAPES)))


def draw(seed: int, *, few_terms: bool = False) -> RandomScene:
    """Return the scene of a seed.

    Args:
        seed: The seed.
        few_terms: Whether all scenes have the default bending, one chamber and no bladder and
            no knit, so that few forms are compiled.

    Raises:
        TorosError: What was drawn is no skin.
    """
    rng, shape = draw_shape(seed)
    size = logarithmic(rng, 0.01, 0.5)
    pattern = SHAPES[shape](rng, size, rng.uniform(100, 300))
    composite = random_composite(rng, pattern.size, few_terms=few_terms)
    supports = random_supports(rng, pattern)
    density = random_density(rng, pattern)
    chambers = None
    if not few_terms and shape in ("two layers", "tube") and rng.random() < 0.2:
        apart = (pattern.panel == rng.integers(len(pattern.panel_names))).astype(np.int64)
        chambers = Chambers(("one", "other"), apart)
    count = 1 if chambers is None else 2
    load = random_load(rng, pattern, composite, count, supports)
    skin = sew(MPI.COMM_SELF, pattern)
    return RandomScene(skin, composite, supports, chambers, density, load)


def outcome_of(seed: int, *, few_terms: bool = False, ask_oracle: bool = True) -> dict[str, Any]:
    """Return the row of a scene: outcome, why, Newton steps, wall time in s.

    Args:
        seed: The seed.
        few_terms: As in `draw`.
        ask_oracle: Whether to search on where the solver gives up; else its error is believed.
    """
    begin = time.perf_counter()
    shape = draw_shape(seed)[1]
    row: dict[str, Any] = {
        "seed": seed,
        "shape": shape,
        "outcome": "wrong",
        "why": "",
        "steps": 0,
        "reason": "",
    }
    try:
        with deadline(LONGEST):
            row |= _solved(seed, few_terms=few_terms, ask_oracle=ask_oracle)
    except TorosError as error:
        row |= {"outcome": "refused", "why": type(error).__name__, "reason": str(error)}
    except Exception as error:  # the table is to show it, not to stop at it
        row |= {"outcome": "wrong", "why": f"{type(error).__name__}: {error}"}
    return {**row, "seconds": round(time.perf_counter() - begin, 2)}


def _solved(seed: int, *, few_terms: bool, ask_oracle: bool) -> dict[str, Any]:
    scene = draw(seed, few_terms=few_terms)
    solver = scene.solver()
    judge = Judge(scene.skin, scene.composite)
    owned = scene.density[scene.skin.owned_cells]
    load = scene.load
    try:
        result = solver.solve(owned, load.pressures, force=load.force)
    except EquilibriumError as error:
        result = error.result
    found = {"steps": result.steps, "reason": result.reason}
    reached = load.scaled(result.load_factor)
    if result.converged or result.load_factor > 0:
        faults = judge.check(solver.model, owned, reached, result.state).faults
        if faults:
            return {**found, "outcome": "wrong", "why": "; ".join(faults)}
    if result.converged:
        return {**found, "outcome": "equilibrium"}
    if not ask_oracle:
        return {**found, "outcome": "no equilibrium"}
    many_steps = scene.solver(NewtonOptions(max_steps=400, min_increment=1.0))
    solvable, why = search_equilibrium(judge, many_steps, owned, load)
    return {**found, "outcome": "failed" if solvable else "no equilibrium", "why": why}


def tables(rows: list[dict[str, Any]]) -> str:
    """Return Markdown: outcomes and Newton steps by shape, errors, and what needed most steps."""
    lines = [
        f"{len(rows)} scenes. `refused`: a typed error before anything is solved. "
        "`no equilibrium`: an error of the solver that the oracle does not contradict.",
        "",
        f"| shape | scenes | {' | '.join(OUTCOMES)} | steps: median | 95 % | most |",
        "|---" * (len(OUTCOMES) + 5) + "|",
    ]
    for shape in [*SHAPES, "all"]:
        group = [row for row in rows if shape in (row["shape"], "all")]
        if not group:
            continue
        counts = Counter(row["outcome"] for row in group)
        steps = [row["steps"] for row in group if row["outcome"] == "equilibrium"] or [0]
        cells = [counts[outcome] for outcome in OUTCOMES]
        cells += [round(np.quantile(steps, q)) for q in (0.5, 0.95, 1)]
        lines.append(f"| {shape} | {len(group)} | {' | '.join(map(str, cells))} |")
    refused = Counter(row["why"] for row in rows if row["outcome"] == "refused")
    listed = ", ".join(f"{number} `{name}`" for name, number in refused.most_common())
    lines += ["", f"Refused: {listed or 'none'}."]
    for outcome in ("no equilibrium", "failed", "wrong"):
        group = [row for row in rows if row["outcome"] == outcome]
        if group:
            lines += ["", f"{outcome.capitalize()}:", ""]
            lines += [
                f"- seed {r['seed']}, {r['shape']}, {r['steps']} steps: {r['why']}" for r in group
            ]
    return "\n".join(lines)


def main() -> int:
    """Command line."""
    parser = parser_of(__doc__, PAGE)
    parser.add_argument("--scenes", type=int, default=1000, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    options = parsed(parser)
    require_count(1, scenes=options.scenes)
    if options.source:
        rows = json.loads(options.source.read_text(encoding="utf-8"))["rows"]
    else:
        seeds = range(options.seed, options.seed + options.scenes)
        tasks = {str(seed): seed for seed in seeds}
        rows = list(complete(tasks, outcome_of, options.rows, options.workers, _print_row).values())
    text = tables(rows)
    print(f"\n{text}")
    counts = Counter(row["outcome"] for row in rows)
    if options.json:
        head = {"wrong": counts["wrong"], "failed_although_solvable": counts["failed"]}
        lines = ",\n".join(json.dumps(row) for row in rows)
        text_head = json.dumps(head)[:-1]
        options.json.write_text(f'{text_head}, "rows": [\n{lines}\n]}}\n', encoding="utf-8")
    if options.docs:
        page = options.page.read_text(encoding="utf-8")
        options.page.write_text(replaced(page, *MARKS, text), encoding="utf-8")
    return 1 if counts["wrong"] or counts["failed"] else 0


def _print_row(key: str, row: dict[str, Any]) -> None:
    why = f": {row['why']}" if row["why"] else ""
    print(f"{key} {row['outcome']}, {row['steps']} steps, {row['seconds']} s{why}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
