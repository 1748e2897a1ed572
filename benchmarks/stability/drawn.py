"""Random skins under random loads, as a fuzzer would choose them.

Outlines, panels, seams, materials, thickness, densities, pressures, dead forces, chambers and
supports are drawn by a seed, over many orders of magnitude. Each scene must end in an equilibrium
that the judge finds stable, or in a typed error that is true: where the solver gives up, the oracle
searches on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import ConvexHull

from benchmarks.bench import deadline
from benchmarks.stability.judge import Judge
from benchmarks.stability.oracle import search_equilibrium
from benchmarks.stability.scenes import Floats, triangle_panels
from toros_fem.base.errors import TorosError
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, pin
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.outlines import region_mesh, two_panels
from toros_fem.meshes.sheets import one_panel

# Wall time in s after which a scene counts as hanging.
LONGEST = 300.0
OUTCOMES = ("equilibrium", "refused", "no equilibrium", "failed", "wrong")
WITH_CONTACT = ("equilibrium", "no equilibrium", "refused", "slow", "penetrated", "wrong")
Random = np.random.Generator


@dataclass
class Outcome:
    """What became of a drawn scene.

    Attributes:
        shape: First thing that was drawn.
        outcome: One of `OUTCOMES`, or of `WITH_CONTACT`.
        why: What is wrong, who solved what failed, or the type of an error.
        steps: Newton steps.
        reason: What the solver says.
        pairs: In contact.
        seconds: Wall time.
    """

    shape: str
    outcome: str = "wrong"
    why: str = ""
    steps: int = 0
    reason: str = ""
    pairs: int = 0
    seconds: float = field(default=0.0, init=False)


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
    load: Load

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
    kind = str(rng.choice(["midedge", "average", "membrane"], p=[0.55, 0.4, 0.05]))
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
) -> Load:
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
    return Load(pressures, force, supports.displacement)


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


def outcome_of(seed: int, *, few_terms: bool = False, ask_oracle: bool = True) -> Outcome:
    """Return what becomes of a scene.

    Args:
        seed: The seed.
        few_terms: As in `draw`.
        ask_oracle: Whether to search on where the solver gives up; else its error is believed.
    """
    begin, found = time.perf_counter(), Outcome(draw_shape(seed)[1])
    try:
        with deadline(LONGEST):
            _solve(found, draw(seed, few_terms=few_terms), ask_oracle=ask_oracle)
    except TorosError as error:
        found.outcome, found.why, found.reason = "refused", type(error).__name__, str(error)
    except Exception as error:  # the table is to show it, not to stop at it
        found.outcome, found.why = "wrong", f"{type(error).__name__}: {error}"
    found.seconds = time.perf_counter() - begin
    return found


def _solve(found: Outcome, scene: RandomScene, *, ask_oracle: bool) -> None:
    solver, load = scene.solver(), scene.load
    judge = Judge(scene.skin, scene.composite)
    owned = scene.density[scene.skin.owned_cells]
    try:
        result = solver.solve(owned, Load(load.pressures, force=load.force))
    except EquilibriumError as error:
        result = error.result
    found.steps, found.reason = result.steps, result.reason
    if result.converged or result.load_factor > 0:
        reached = load.scaled(result.load_factor)
        faults = judge.check(solver.model, owned, reached, result.state).faults
        if faults:
            found.why = "; ".join(faults)
            return
    found.outcome = "equilibrium" if result.converged else "no equilibrium"
    if ask_oracle and not result.converged:
        many_steps = scene.solver(NewtonOptions(max_steps=400, min_increment=1.0))
        solvable, found.why = search_equilibrium(judge, many_steps, owned, load)
        if solvable:
            found.outcome = "failed"
