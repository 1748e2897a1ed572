"""Gradients of every stage from density to objective: Taylor rates, transposes, differences.

What a gradient g leaves of a function, |f(x + h d) - f(x) - h g·d|, goes with h² if g is right, and
with h if it is wrong. Nothing here converges with the mesh: it must hold on each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from accuracy_case import Case, Measured, timed
from accuracy_scenes import COMM, Floats, membrane
from mpi4py import MPI

from toros_fem.design.density.field import random_density
from toros_fem.design.density.filters import Filter, make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.materials.sheet import CURVATURES, Bending, Composite
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Skin, bend, cylinder, sew

RADIUS, LENGTH = 0.01, 0.06  # m, of the tube
FILTER = 8e-3  # m
PAPERS_W = 0.5  # of eq. (15)
PRESSURE = 5e3  # Pa
CELLS = 20
# Smooth enough for differences of second order to be seen.
STEP = Projection(beta=6.0)
COMPOSITES = {
    "membrane": membrane(0.1e6, 0.3, 0.5e-3, 1.9, 2.6, contrast=260.0),
    **{name: Composite(bending=Bending(name)) for name in CURVATURES},
}


@dataclass(frozen=True, eq=False)
class GradientCase:
    """A capped tube to be bent by a design of its wall; the caps are reinforced.

    Attributes:
        skin: The sewn skin.
        problem: The design problem, with every term that is differentiated.
        density: Where gradients are taken, ρ at owned triangles.
        direction: A change of it, zero on the caps.
    """

    skin: Skin
    problem: ShapeProblem
    density: Floats
    direction: Floats


@cache
def tube(sides: int) -> Skin:
    """A short capped tube."""
    return sew(COMM, cylinder(COMM, LENGTH, 2 * RADIUS, 2 * np.pi * RADIUS / sides))


@cache
def tight_case(formulation: str, sides: int) -> GradientCase:
    """The tube with tight equilibria."""
    skin = tube(sides)
    pattern = skin.pattern
    supports = clamp(pattern, ["base"])
    tight = NewtonOptions(tolerance=1e-12)
    wall = pattern.panel[skin.owned_cells] == pattern.panel_index("wall")
    cone = make_filter("cone", skin, FILTER)
    problem = ShapeProblem(
        solver=EquilibriumSolver(skin, COMPOSITES[formulation], supports, tight),
        objective=ShapeObjective(
            skin, bend(np.radians(60), LENGTH, neutral=RADIUS)(pattern.points)
        ),
        filter=cone,
        pressure=PRESSURE,
        projection=STEP,
        passive=np.where(wall, np.nan, 1.0),
        pressure_bounds=(1e3, 2e4),
        perimeter=Perimeter(skin, FILTER, PAPERS_W),
        perimeter_weight=1e-4,
        length_scale=LengthScaleConstraints(skin, cone, widths(), wall),
    )
    return GradientCase(skin, problem, random_density(skin, 2, spread=0.3), wall * drawn(skin, 9))


def widths() -> LengthScale:
    """Widths that the coarsest mesh resolves."""
    return LengthScale(line_width=6e-3, gap_width=6e-3)


def drawn(skin: Skin, seed: int) -> Floats:
    """Numbers in (-1, 1) at owned triangles, the same on any number of ranks."""
    return np.random.default_rng(seed).uniform(-1, 1, len(skin.pattern.panel))[skin.owned_cells]


def inner(a: Floats, b: Floats) -> float:
    """Product of two owned fields."""
    return float(COMM.allreduce(float(np.vdot(a, b))))


def rate(value: Callable[[float], float], slope: float, first: float) -> float:
    """Of the last three of five halvings of a step the observed order that is farthest from 2."""
    base = value(0.0)
    steps = first * 0.5 ** np.arange(6)
    gaps = np.array([abs(value(h) - base - h * slope) for h in steps])
    orders = np.log2(gaps[:-1] / gaps[1:])[-3:]
    return float(orders[np.argmax(np.abs(orders - 2))])


def farthest(values: list[float], reference: float) -> float:
    """The value that is farthest from the reference."""
    return max(values, key=lambda value: abs(value - reference))


def transposes(name: str, sides: int) -> Measured:
    """<a, Fᵀ b> over <F a, b>, of ρ̃ and of its slope; products that do not cancel."""
    skin = tube(sides)
    flat = make_filter(name, skin, FILTER)
    a, b, weight = (1 + drawn(skin, seed) for seed in range(3))
    back, seconds = timed(lambda: flat.backward(b))
    slope = flat.slope(a)
    ratios = [
        inner(a, back) / inner(flat.forward(a), b),
        inner(a, flat.slope_backward(weight * slope)) / inner(slope, weight * slope),
    ]
    return Measured(farthest(ratios, 1.0), len(skin.pattern.panel), seconds)


def projection(sides: int) -> Measured:
    """Of a weighted sum of ρ̄."""
    skin = tube(sides)
    filtered, direction, weight = (
        random_density(skin, 1, spread=0.4),
        drawn(skin, 2),
        drawn(skin, 3),
    )
    gradient, seconds = timed(lambda: STEP.backward(filtered, weight))
    order = rate(
        lambda h: inner(weight, STEP.forward(filtered + h * direction)),
        inner(gradient, direction),
        1e-2,
    )
    return Measured(order, len(skin.pattern.panel), seconds)


def perimeter(sides: int) -> Measured:
    """Of the perimeter by ρ̄; along its gradient, since random signs would cancel."""
    skin = tube(sides)
    term = Perimeter(skin, FILTER, PAPERS_W)
    projected = random_density(skin, 6, spread=0.4)
    gradient, seconds = timed(lambda: term.backward(projected))
    direction = gradient / COMM.allreduce(float(np.abs(gradient).max()), op=MPI.MAX)
    order = rate(
        lambda h: term.forward(projected + h * direction), inner(gradient, direction), 1e-1
    )
    return Measured(order, len(skin.pattern.panel), seconds)


def length_scale(name: str, sides: int) -> Measured:
    """Of both constraints by ρ, through filter, slope and projection."""
    skin = tube(sides)
    flat = make_filter(name, skin, FILTER)
    wall = skin.pattern.panel[skin.owned_cells] == skin.pattern.panel_index("wall")
    limits = LengthScaleConstraints(skin, flat, widths(), wall)
    density, direction = random_density(skin, 3, spread=0.5), drawn(skin, 1)
    slopes, seconds = timed(lambda: _slopes(limits, flat, density, direction))

    def value(h: float, k: int) -> float:
        moved = density + h * direction
        filtered = flat.forward(moved)
        return float(limits.forward(moved, filtered, STEP.forward(filtered))[k])

    orders = [rate(partial(value, k=k), slope, 1e-2) for k, slope in enumerate(slopes)]
    return Measured(farthest(orders, 2.0), len(skin.pattern.panel), seconds)


def _slopes(
    limits: LengthScaleConstraints, flat: Filter, density: Floats, direction: Floats
) -> list[float]:
    """Slopes of g_r and g_t along a direction of ρ."""
    filtered = flat.forward(density)
    parts = limits.backward(density, filtered, STEP.forward(filtered))
    whole = [
        by_density + flat.backward(by_filtered + STEP.backward(filtered, by_projected))
        for by_density, by_filtered, by_projected in parts
    ]
    return [inner(gradient, direction) for gradient in whole]


def adjoint(formulation: str, sides: int, *, pressure: bool) -> Measured:
    """Of the objective by ρ̄ or by the pressure, through the equilibrium."""
    at = tight_case(formulation, sides)
    solver, objective = at.problem.solver, at.problem.objective
    base = solver.solve(at.density, PRESSURE)

    def slope() -> float:
        rhs = np.zeros_like(base.state)
        solver.model.positions(rhs)[:] = objective.backward(base.positions)
        adjoint = solver.solve_tangent(rhs, base)
        if pressure:
            return inner(adjoint, solver.model.volume_gradient(base.state))
        return -inner(solver.model.density_sensitivity(base.state, adjoint), at.direction)

    def value(h: float) -> float:
        density = at.density if pressure else at.density + h * at.direction
        there = solver.solve(density, PRESSURE + h * pressure, start=base.state)
        return objective.forward(there.positions)

    slope()  # compiles
    found, seconds = timed(slope)
    order = rate(value, found, 200.0 if pressure else 2e-2)
    return Measured(order, len(at.skin.pattern.panel), seconds)


def whole_chain(formulation: str, sides: int) -> Measured:
    """Of T and both constraints by ρ and P at once, from filter to objective and back."""
    at = tight_case(formulation, sides)
    base, seconds = evaluated(at)
    assert base.gradient is not None
    assert base.pressure_gradient is not None
    assert base.length_scale_gradients is not None
    slopes = [inner(by, at.direction) for by in (base.gradient, *base.length_scale_gradients)]
    slopes[0] += base.pressure_gradient[0] * PRESSURE

    @cache
    def values(h: float) -> list[float]:
        there = at.problem.simulate(
            at.density + h * at.direction, base.equilibrium.state, PRESSURE * (1 + h)
        )
        assert there.length_scale is not None
        return [there.objective, *there.length_scale]

    def value(h: float, k: int) -> float:
        return values(h)[k]

    orders = [rate(partial(value, k=k), slope, 1e-2) for k, slope in enumerate(slopes)]
    return Measured(farthest(orders, 2.0), len(at.skin.pattern.panel), seconds)


def evaluated(at: GradientCase) -> tuple[Evaluation, float]:
    """The case's gradients, and the time they take once compiled and started near."""
    start = at.problem.evaluate(at.density).equilibrium.state
    return timed(lambda: at.problem.evaluate(at.density, start))


def differences(formulation: str, sides: int) -> Measured:
    """Largest deviation of dT/dρ from central differences, over its largest entry."""
    at = tight_case(formulation, sides)
    skin = at.skin
    base, seconds = evaluated(at)
    assert base.gradient is not None
    gradient = skin.gather_cells(base.gradient)
    wall = skin.pattern.cells_of("wall")
    worst = 0.0
    for cell in np.random.default_rng(1).choice(wall, CELLS, replace=False):
        ends = [
            at.problem.simulate(
                at.density + h * (skin.owned_cells == cell), base.equilibrium.state
            ).objective
            for h in (1e-3, -1e-3)
        ]
        worst = max(worst, abs((ends[0] - ends[1]) / 2e-3 - gradient[cell]))
    return Measured(worst / np.abs(gradient).max(), len(skin.pattern.panel), seconds)


def of_size(run: Callable[[int], Measured]) -> Callable[[str, int], Measured]:
    """Return a run, by formulation and size, of a quantity without mechanics."""
    return lambda _, size: run(size)


def gradient_case(
    name: str,
    about: str,
    quantity: str,
    reference: float,
    run: Callable[[str, int], Measured],
    formulations: tuple[str, ...] = ("membrane",),
) -> Case:
    """A case of this group; `run(formulation, size)`."""
    return Case(
        name=f"gradient-{name}",
        group="gradients",
        about=about,
        quantity=quantity,
        reference=reference,
        source="calculus",
        formulations=formulations,
        meshes=("unstructured",),
        sizes=(12, 16, 24, 32),
        run=lambda formulation, _, size: run(formulation, size),
        note="This must be true on every mesh: nothing converges, and the order has no meaning. "
        "The size of a mesh is the number of sides of the tube; seconds are those of the "
        "gradient.",
    )


RATE = "Taylor rate farthest from 2"
EVERY = tuple(COMPOSITES)
FILTERS = ("cone", "helmholtz")
GRADIENTS: tuple[Case, ...] = (
    *(
        gradient_case(
            f"filter-{name}",
            f"The {name} filter and its slope are linear: their backward passes are transposes.",
            "<a, Fᵀ b>/<F a, b> farthest from 1",
            1.0,
            of_size(partial(transposes, name)),
        )
        for name in FILTERS
    ),
    gradient_case(
        "projection",
        "A weighted sum of ρ̄ by ρ̃, β = 6.",
        RATE,
        2.0,
        of_size(projection),
    ),
    *(
        gradient_case(
            f"length-scale-{name}",
            f"g_r and g_t by ρ, through the {name} filter, its slope and the projection.",
            RATE,
            2.0,
            of_size(partial(length_scale, name)),
        )
        for name in FILTERS
    ),
    gradient_case(
        "perimeter",
        "The perimeter by ρ̄, w = 0.5.",
        RATE,
        2.0,
        of_size(perimeter),
    ),
    gradient_case(
        "density",
        "The objective by ρ̄ through the equilibrium at 5 kPa, by the adjoint.",
        RATE,
        2.0,
        partial(adjoint, pressure=False),
        EVERY,
    ),
    gradient_case(
        "pressure",
        "The objective by the pressure, by the same adjoint.",
        RATE,
        2.0,
        partial(adjoint, pressure=True),
        EVERY,
    ),
    gradient_case(
        "chain",
        "The objective with its perimeter term and both constraints, along a joint step of ρ and "
        "P: filter, projection, equilibrium, objective and back.",
        RATE,
        2.0,
        whole_chain,
        EVERY,
    ),
    gradient_case(
        "differences",
        f"dT/dρ of {CELLS} triangles drawn at random against central differences.",
        "largest deviation over the largest entry",
        0.0,
        differences,
        EVERY,
    ),
)
