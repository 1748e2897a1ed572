"""Stages that are pairs of forward and backward, each at a point where nothing is special."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from helpers.designs import border_term, full, make_problem, passive_in, widths_of  # fmt: skip
from helpers.line_fields import two_sheets
from helpers.models import line_design
from helpers.objectives import TARGET, tube_sections
from helpers.pillow import pillow
from helpers.scenes import square
from helpers.standing import solver_on_base
from helpers.tiles import CONTRAST, DIRECTIONS, EDGES, SIDE
from helpers.tiles import RADIUS as TILE_RADIUS
from helpers.tiles import TARGET as PROFILE
from helpers.touching import EXACT, dragged, on_pads, sheet_with_ball, tube_on_floor_and_ball
from mpi4py import MPI

from toros_fem.base.mpi import dot, total
from toros_fem.base.validation import Floats
from toros_fem.design.density.filters import Filter, cone_filter, group_mean, make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.options import Stage as DesignStage
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import DesignProblem, ObjectiveTerm
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.design.loop.steps import Steps, Variables
from toros_fem.design.mma.optimizer import Functions
from toros_fem.design.relaxed.problem import (
    Families,
    FixedDirections,
    FreeDirections,
    relaxed_problem,
    smoothing,
)
from toros_fem.materials.sheet import Composite
from toros_fem.measures.cross_sections import CrossSectionObjective
from toros_fem.measures.miss import AlignedObjective, MirroredObjective
from toros_fem.measures.regions import Body, GapObjective
from toros_fem.measures.shape import Nodes, Objective, ShapeObjective, SumObjective
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.designs import LineDesign
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.periodic import UNIAXIAL, Periodic
from toros_fem.meshes import Pattern, Skin, Tile, cylinder, mirrored, sew, tile
from toros_fem.products.tiles.problem import TileProblem
from toros_fem.products.tiles.stiffness_profile import ProfileObjective, ProfileSolver, tile_solver


@dataclass(frozen=True, eq=False)
class Stage:
    """Functions of what this rank owns, at one point, with a direction that all ranks share.

    Attributes:
        comm: Over which the point is spread.
        values: The functions: numbers that are the same on all ranks, from a point.
        point: Where they are differentiated.
        step: One step along the direction.
        gradients: What `backward` says at the point, one for each function.
        gather: The entries of all ranks, in an order that no partition changes.
        tolerance: Of the slopes, over the gradient's length times the step's.
    """

    comm: MPI.Comm
    values: Callable[[Floats], Floats]
    point: Floats
    step: Floats
    gradients: Sequence[Floats]
    gather: Callable[[Floats], Floats]
    tolerance: float = 1e-11


@cache
def tube() -> Pattern:
    """A short capped tube."""
    return cylinder(MPI.COMM_SELF, 0.06, 0.02, 4.5e-3)


@cache
def half_tube() -> Pattern:
    return cylinder(MPI.COMM_SELF, 0.06, 0.02, 4.5e-3, planes=(1,))


@cache
def small_tile() -> Tile:
    return tile(MPI.COMM_SELF, (SIDE, SIDE), SIDE / EDGES, "crossed")


def cells(skin: Skin, seed: int, low: float, high: float, *width: int) -> Floats:
    """Numbers drawn by the triangle's place in the pattern, of this rank's triangles."""
    drawn = np.random.default_rng(seed).uniform(low, high, (len(skin.pattern.panel), *width))
    return np.asarray(drawn[skin.owned_cells])


def vertices(skin: Nodes, seed: int, size: float) -> Floats:
    """Vectors drawn by the vertex's place in the pattern, of this rank's vertices."""
    drawn = np.random.default_rng(seed).standard_normal(skin.pattern.points.shape)
    return np.asarray(size * drawn[skin.owned_vertices])


# ------------------------------------------------------------------------------ densities


def filtered(skin: Skin, made: Filter) -> Stage:
    """Values and slopes of a filter, each weighed by its own numbers."""
    weight, slopes = cells(skin, 3, -1, 1), np.ascontiguousarray(cells(skin, 4, -1e-3, 1e-3, 2).T)

    def values(x: Floats) -> Floats:
        slope = dot(skin.comm, slopes.ravel(), made.slope.forward(x).ravel())
        return np.array([dot(skin.comm, weight, made.forward(x)), slope])

    point, step = cells(skin, 1, -0.5, 1.5), cells(skin, 15, -1, 1)
    values(point)
    back = [made.backward(weight), made.slope.backward(slopes)]
    return Stage(skin.comm, values, point, step, back, skin.gather_cells)


def on_tube(name: str, comm: MPI.Comm) -> Stage:
    skin = sew(comm, tube())
    return filtered(skin, make_filter(name, skin, 9e-3))


def on_half(name: str, comm: MPI.Comm) -> Stage:
    """A part whose mirror image is filtered too."""
    skin = sew(comm, half_tube())
    return filtered(skin, make_filter(name, skin, 9e-3, mirrored(half_tube(), (1,))))


def on_tile(name: str, symmetry: str, comm: MPI.Comm) -> Stage:
    skin, found = sew(comm, small_tile().pattern), small_tile()
    inner = make_filter(name, skin, TILE_RADIUS, found.lattice if name == "cone" else None)
    return filtered(skin, inner.after(group_mean(skin, found.symmetry_maps(symmetry))))


def projected(beta: float, eta: float, comm: MPI.Comm) -> Stage:
    """Also where ρ̃ leaves [0, 1], and nothing changes any more."""
    skin, step = sew(comm, square(n=8)), Projection(beta, eta)
    point = cells(skin, 1, 0.01, 0.99)
    point[skin.owned_cells % 7 == 0] += 1.0
    point[skin.owned_cells % 7 == 3] -= 1.0
    weight = cells(skin, 3, -1, 1)

    def values(x: Floats) -> Floats:
        return np.array([dot(comm, weight, step.forward(x))])

    gradients = [step.backward(point, weight)]
    return Stage(comm, values, point, cells(skin, 15, -1e-4, 1e-4), gradients, skin.gather_cells)


def widths(name: str, eta: float, number: int, comm: MPI.Comm) -> Stage:
    """Both constraints, by ρ through its slope alone, by ρ̃ or by ρ̄."""
    skin = sew(comm, tube())
    designed = (skin.pattern.panel[skin.owned_cells] == 1) & (skin.owned_cells % 5 != 0)
    made, asked = make_filter(name, skin, 9e-3), LengthScale(line_width=7e-3, gap_width=8e-3)
    limits = LengthScaleConstraints(skin, made, asked, designed, Projection(6.0, eta))
    whole = [cells(skin, 1, 0, 1), cells(skin, 5, -0.2, 1.2), cells(skin, 6, -0.2, 1.2)]

    def values(x: Floats) -> Floats:
        return limits.forward(*[x if k == number else given for k, given in enumerate(whole)])

    gradients = [np.asarray(parts[number]) for parts in limits.backward(*whole)]
    step = cells(skin, 15, -1e-4, 1e-4)
    return Stage(comm, values, whole[number], step, gradients, skin.gather_cells)


def border(
    sharpness: float, comm: MPI.Comm, *, weighted: bool = True, periodic: bool = False
) -> Stage:
    pattern = small_tile().pattern if periodic else half_tube()
    skin = sew(comm, pattern)
    term = Perimeter(
        skin,
        TILE_RADIUS if periodic else 9e-3,
        sharpness,
        area_weighted=weighted,
        beyond=small_tile().lattice if periodic else mirrored(pattern, (1,)),
    )
    point = cells(skin, 1, -0.2, 1.2)
    return Stage(
        comm, lambda x: np.array([term.forward(x)]), point, cells(skin, 15, -1e-4, 1e-4),
        [term.backward(point)], skin.gather_cells,
    )  # fmt: skip


# ----------------------------------------------------------------------------- line families


def material(families: Families, comm: MPI.Comm) -> Stage:
    skin = sew(comm, square(n=6))
    weight = cells(skin, 3, -1, 1, 1 + 3 * families.count)
    point = cells(skin, 1, 0.05, 1.1, families.fields)

    def values(x: Floats) -> Floats:
        return np.array([total(comm, float((weight * families.forward(x)).sum()))])

    gradients = [families.backward(point, weight)]
    step = cells(skin, 15, -1e-3, 1e-3, families.fields)
    return Stage(comm, values, point, step, gradients, skin.gather_cells)


def smoothed(families: Families, turn: float, comm: MPI.Comm) -> Stage:
    """Across a seam where the chart turns, with triangles that have no lines."""
    skin = sew(comm, two_sheets(turn))
    count, own = families.fields, skin.owned_cells
    designed = np.arange(len(skin.pattern.panel)) % 7 != 0
    smooth = smoothing(skin, 0.02, families, designed)
    weight, point = (cells(skin, seed, -1, 2, count).ravel() for seed in (3, 1))

    def values(x: Floats) -> Floats:
        return np.array([dot(comm, weight, smooth.forward(x))])

    def gather(owned: Floats) -> Floats:
        return skin.gather_cells(owned.reshape(len(own), count))

    step = cells(skin, 15, -1, 1, count).ravel()
    return Stage(comm, values, point, step, [smooth.backward(weight)], gather)


# -------------------------------------------------------------------------------- objectives


def of_shape(
    pattern: Callable[[], Pattern],
    make: Callable[[Skin], Objective],
    comm: MPI.Comm,
    *,
    disturbed: float = 0.03,
    step: float = 1e-4,
) -> Stage:
    """An objective at a disturbed shape; lengths are over the skin's size."""
    skin = sew(comm, pattern())
    made, size = make(skin), skin.pattern.size
    x = skin.pattern.points[skin.owned_vertices] + vertices(skin, 1, disturbed * size)
    return Stage(
        comm, lambda y: np.array([made.forward(y)]), x, vertices(skin, 15, step * size),
        [made.backward(x)], skin.gather_vertices, 1e-9,
    )  # fmt: skip


def drawn_weights(nodes: Nodes, *width: int) -> Floats:
    count = len(nodes.pattern.points)
    return np.asarray(np.random.default_rng(7).uniform(0, 1, (count, *width)))


def shape(nodes: Nodes) -> Objective:
    """Weights that differ by component, and a part whose orientation counts."""
    target, tip = TARGET(nodes.pattern.points), nodes.pattern.points[:, 2] > 0.05
    return ShapeObjective(nodes, target, drawn_weights(nodes, 3), tip * drawn_weights(nodes))


def sections(skin: Skin) -> Objective:
    return CrossSectionObjective(skin, TARGET(skin.pattern.points), tube_sections(skin))


def gap(body: str, nodes: Nodes) -> Objective:
    return GapObjective(nodes, Body(body, 0.03, (0.004, 0.002, 0.03)), drawn_weights(nodes), 2.0)


def aligned(skin: Skin) -> Objective:
    both = SumObjective(sections(skin), shape(skin))
    return AlignedObjective(skin, TARGET(skin.pattern.points), both, drawn_weights(skin))


def of_whole(skin: Skin) -> Objective:
    """All of a skin of which half is there; weights are those of the whole."""

    def both(nodes: Nodes) -> Objective:
        return SumObjective(shape(nodes), gap("sphere", nodes))

    return MirroredObjective(skin, mirrored(skin.pattern, (1,)), both)


def held(skin: Skin) -> Objective:
    """The force with which a sheet holds a ball, less than what is asked for."""
    middle, size, thickness = skin.pattern.points.mean(axis=0), skin.pattern.size, 5e-4
    high = [0, 0, 0.3 * size + thickness / 2 + 0.02 * size]
    contact = Contact(
        bodies=[rigid_sphere("ball", 0.3 * size, middle + high)],
        self_contact=False, thickness=thickness, distance=0.1 * size,
    )  # fmt: skip
    fixed = np.zeros(skin.pattern.points.shape, dtype=bool)
    sizes = contact.sizes(Composite())
    return HoldingObjective(skin, contact, sizes, fixed, [0.3, 0.0, 1.0], 1000.0, 2.0)


# ---------------------------------------------------------------------------------- designs


def solver_on(skin: Skin, **more: Any) -> EquilibriumSolver:
    return solver_on_base(skin, options=EXACT, **more)


def bent(skin: Skin) -> Objective:
    """Not quadratic, so that the spread of a print has a slope by the print's own shape."""
    return SumObjective(shape(skin), gap("sphere", skin))


def density_problem(comm: MPI.Comm) -> ShapeProblem:
    """Everything that a density design has, with print and fabric that are prescribed."""
    skin = sew(comm, tube())
    plain = full(skin, solver_on(skin))
    given = np.where(skin.owned_cells % 11 == 0, 0.25, plain.fields.passive)
    problem = passive_in(plain, given).changed(
        terms=[border_term(skin, 1e-3)], objective=bent(skin), pressure_weight=0.02
    )
    return problem.changed(length_scale=widths_of(problem))


def chambered(comm: MPI.Comm) -> ShapeProblem:
    """Two chambers, of which the second has a pressure that is designed."""
    skin = sew(comm, tube())
    upper = skin.pattern.points[skin.pattern.triangles].mean(axis=1)[:, 2] > 0.03
    solver = solver_on(skin, chambers=Chambers(("lower", "upper"), upper.astype(int)))
    physics = InflatedSkin(solver, (2e3, 5e3), (None, (1e3, 2e4)))
    return make_problem(skin, solver).changed(physics=physics, pressure_weight=0.02)


def relaxed(families: Families, comm: MPI.Comm) -> ShapeProblem:
    """Lines that cost something, on a skin with print and fabric that are prescribed."""
    return relaxed_problem(density_problem(comm), families, 0.015, share_weight=0.05, crossing=0.3)


def tile_problem(
    objective: ProfileObjective,
    symmetry: str,
    comm: MPI.Comm,
    *,
    batched: bool,
    strain: float = 0.1,
) -> TileProblem:
    """Ranks share the tile, or each has a whole one and they share the directions."""
    found = small_tile()
    skin = sew(MPI.COMM_SELF if batched else comm, found.pattern)
    solver = ProfileSolver(
        tile_solver(skin, Composite(), Periodic(found, UNIAXIAL, True)), DIRECTIONS, strain,
        comm if batched else None,
    )  # fmt: skip
    inner = cone_filter(skin, TILE_RADIUS, found.lattice)
    place = np.abs(skin.pattern.centroids[skin.owned_cells] / SIDE - 0.5)
    symmetric = inner.after(group_mean(skin, found.symmetry_maps(symmetry)))
    passive = np.where(place.max(axis=1) < 0.12, 1.0, np.nan)
    perimeter = Perimeter(skin, TILE_RADIUS, 5.0, beyond=found.lattice)
    problem = TileProblem(
        DensityFields(skin, symmetric, Projection(4.0), passive),
        solver,
        objective,
        [ObjectiveTerm("perimeter", perimeter, 1.0 / found.pattern.size)],
    )
    asked = LengthScale(solid_threshold=0.7, void_threshold=0.3, epsilon=1e-3)
    limits = LengthScaleConstraints(skin, symmetric, asked, problem.designed)
    return problem.changed(length_scale=limits)


def numbers(there: Functions) -> Floats:
    squares = float(np.dot(there.residuals, there.residuals))
    return np.array([there.value + squares, there.value, *there.values, *there.residuals])


def designed(
    make: Callable[[MPI.Comm], DesignProblem[Any]], comm: MPI.Comm, *, low: float = 0.3
) -> Stage:
    """All that MMA sees of a problem: T, its rest, constraints and residuals, by its variables."""
    problem = make(comm)
    skin, variables = problem.skin, Variables(problem, DesignOptions())
    fields = len(problem.fields.bounds[0]) // len(skin.owned_cells)
    start = cells(skin, 1, low, low + 0.4, fields).ravel()
    point = variables.vector(start, [1.3 * p for p in problem.physics.pressures])
    base, slopes = problem.evaluate(start, pressure=variables.design(point)[1] or None)
    stage = DesignStage(1, constrained=problem.length_scale is not None)
    steps = Steps(problem, variables, stage, DesignOptions(), base, slopes)
    rows = steps.around(base, slopes)
    whole = steps.scale * variables.gradient(base, 1.0, slopes.gradient, slopes.pressure_gradient)
    every = [whole, rows.gradient, *rows.jacobian, *rows.residual_jacobian]
    size = len(variables.gather(point))
    drawn = 1e-3 * np.random.default_rng(15).uniform(-1, 1, size)

    def values(x: Floats) -> Floats:
        density, moved = variables.design(x)
        there = problem.simulate(density, base.equilibrium.state, moved or None)
        return numbers(steps.at(there))

    return Stage(
        skin.comm, values, point, variables.scatter(drawn), every,
        variables.gather, 1e-9,
    )  # fmt: skip


def positions(
    make: Callable[[MPI.Comm], tuple[Any, ...]],
    columns: slice,
    comm: MPI.Comm,
    *,
    size: float = 1e-3,
) -> Stage:
    """Positions under the last load by some columns of a design; `size` is that of a step."""
    solver, rows, *loads = make(comm)
    after = solver.solve(rows, loads[0]) if len(loads) > 1 else None
    skin, rows = solver.skin, rows.reshape(len(rows), -1)

    def solved(x: Floats, start: Floats | None) -> Equilibrium:
        moved = rows.copy()
        moved[:, columns] = x
        design = moved if moved.shape[1] > 1 else moved[:, 0]
        return solver.solve(design, loads[-1], start, after=after)

    point = rows[:, columns].copy()
    weight, base = vertices(skin, 3, 1.0), solved(point, None)
    right = np.zeros_like(base.state)
    solver.model.positions(right)[:] = weight
    adjoint = solver.solve_tangent(right, base, adjoint=True)
    gradient = -solver.model.density_sensitivity(base.state, adjoint)

    def values(x: Floats) -> Floats:
        found = solved(x, base.state)
        return np.array([total(comm, float((weight * found.positions).sum()))])

    step = cells(skin, 15, -size, size, point.shape[1])
    gradient = gradient.reshape(len(rows), -1)[:, columns]
    return Stage(comm, values, point, step, [gradient], skin.gather_cells, 1e-8)


def two_families(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, float]:
    skin = sew(comm, tube())
    return solver_on(skin, design=partial(LineDesign, families=2)), line_design(skin, 2, 5), 5e3


def wrinkled(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, float]:
    """A pillow with taut and wrinkled triangles."""
    solver = pillow(comm)
    return solver, cells(solver.skin, 3, 0.1, 0.9), 300.0


def at_its_bound(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, float]:
    """A print that hardly stretches on a fabric that does."""
    skin = sew(comm, tube())
    soft = dataclasses.replace(Composite().reinforcement, young=2e6, c1=1.05)
    solver = solver_on_base(skin, Composite(reinforcement=soft), options=EXACT)
    return solver, cells(skin, 3, 0.2, 0.8), 5e3


def under_a_ball(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, Load]:
    """A plate presses a free ball into a stretched sheet."""
    solver, load = sheet_with_ball(comm, options=EXACT)
    # Deeper in the ball rolls from facet to facet, where it has several equilibria.
    load = dataclasses.replace(load, poses=0.4 * load.poses)
    return solver, cells(solver.skin, 3, 0.01, 0.03), load


def touching(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, float]:
    solver = tube_on_floor_and_ball(sew(comm, tube()), options=EXACT)
    return solver, cells(solver.skin, 3, 0.01, 0.03), 5e3


def with_friction(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, Load, Load]:
    solver, put_down, drag = dragged(comm)
    return solver, cells(solver.skin, 1, 0.25, 0.35), put_down, drag


def padded(comm: MPI.Comm) -> tuple[EquilibriumSolver, Floats, float]:
    solver = on_pads(sew(comm, tube()))
    return solver, cells(solver.skin, 1, 0.01, 0.03), 4e3


TILE = partial(tile_problem, PROFILE, "tetragonal")
CHIRAL = partial(tile_problem, CONTRAST, "chiral")
FAMILIES: dict[str, Families] = {
    "fixed": FixedDirections(4, 0.4),
    "free": FreeDirections((0.2, 0.3)),
}

Make = Callable[[MPI.Comm], Stage]
ROWS: dict[str, Make] = {
    **{f"{name} filter": partial(on_tube, name) for name in ("cone", "helmholtz")},
    "cone filter of a part": partial(on_half, "cone"),
    "cone filter of a tile": partial(on_tile, "cone", "chiral"),
    "helmholtz filter of a tile": partial(on_tile, "helmholtz", "chiral"),
    **{f"projection at {eta}": partial(projected, 8.0, eta) for eta in (0.3, 0.5, 0.7)},
    **{
        f"widths by {by}, {name}": partial(widths, name, 0.45, number)
        for name in ("cone", "helmholtz")
        for number, by in enumerate(("slope", "filtered", "projected"))
    },
    **{f"perimeter of a part, w = {w}": partial(border, w) for w in (0.5, 8.0, -8.0)},
    "perimeter, the paper's": partial(border, 0.5, weighted=False),
    "perimeter of a tile": partial(border, -20.0, periodic=True),
    **{f"{name} directions": partial(material, families) for name, families in FAMILIES.items()},
    "smoothing, free": partial(smoothed, FAMILIES["free"], 0.7),
    "smoothing, fixed": partial(smoothed, FAMILIES["fixed"], 0.4),
    "shape": partial(of_shape, tube, shape),
    "sections": partial(of_shape, tube, sections),
    "gap from a ball": partial(of_shape, tube, partial(gap, "sphere")),
    "gap from a box": partial(of_shape, tube, partial(gap, "box"), step=1e-6),
    "aligned": partial(of_shape, tube, aligned),
    "objective of a whole": partial(of_shape, half_tube, of_whole),
    "holding force": partial(of_shape, partial(square, n=5), held, disturbed=1e-3, step=1e-6),
    "design of a density": partial(designed, density_problem),
    "design of fixed lines": partial(designed, partial(relaxed, FAMILIES["fixed"])),
    "design of free lines": partial(designed, partial(relaxed, FAMILIES["free"]), low=0.55),
    "design of a tile": partial(designed, partial(TILE, batched=False)),
    "design of a tile by directions": partial(designed, partial(TILE, batched=True)),
    "contrast of a tile": partial(designed, partial(CHIRAL, batched=False)),
    "contrast of a pressed tile": partial(designed, partial(CHIRAL, batched=False, strain=-0.05)),
    "wrinkled": partial(positions, wrinkled, slice(0, 1)),
    "sheet under a free ball": partial(positions, under_a_ball, slice(0, 1), size=1e-5),
    "tube on floor and ball": partial(positions, touching, slice(0, 1), size=2e-4),
    "print at its bound": partial(positions, at_its_bound, slice(0, 1), size=2e-4),
    "families' density": partial(positions, two_families, slice(0, 1)),
    "families' shares": partial(positions, two_families, slice(1, 3)),
    "families' directions": partial(positions, two_families, slice(3, 7)),
}  # fmt: skip
# What takes long on several ranks, and has nothing of its own there.
ON_ONE_RANK: dict[str, Make] = {
    "design of two chambers": partial(designed, chambered),
    "sheet with friction": partial(positions, with_friction, slice(0, 1), size=6e-5),
    "tube on pads": partial(positions, padded, slice(0, 1), size=1e-5),
}
