"""Design problems."""

import dataclasses
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.validation import Floats
from toros_fem.design.density.filters import cone_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import DensityFields, densities_of
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import ObjectiveTerm
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign, ShapeProblem
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Pattern, Skin, bend
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.tubes import BendScene

RADIUS = 7e-3
# Short designs leave the curve over the pressure out, which would take as long as they do, and the
# refined mesh: tests/products/actuators looks at them.
DESIGN_ALONE: dict[str, Any] = {"curve_pressure": None, "estimate_error": False}
# A short tube with all parts of a design: two meshes, polish, a correction.
TWO_LEVELS = BendScene.of(
    length=0.03,
    angle=30.0,
    edge_length=1.7e-3,
    filter_radius=4e-3,
    levels=2,
    iterations=1,
    constrained_iterations=1,
    level_iterations=1,
    polish_iterations=1,
    corrections=1,
    island_area=0.0,
    **DESIGN_ALONE,
)


def case_of(comm: MPI.Comm, scene: ActuatorScene) -> Case:
    """The case of a scene on its finest mesh."""
    return scene.case(comm, scene.finest_level)


def problem_of(comm: MPI.Comm, scene: ActuatorScene) -> ShapeDesign:
    """The problem of a scene on its finest mesh."""
    return scene.problem(comm, case_of(comm, scene), scene.finest_level)


def shape_design(comm: MPI.Comm, pattern: Pattern, **given: Any) -> ShapeDesign:
    """A design from the fields of its case and those of its regularisation."""
    names = {field.name for field in dataclasses.fields(Regularisation)}
    chain = Regularisation(**{name: given.pop(name) for name in names & set(given)})
    return ShapeDesign(comm, Case(pattern, **given), chain)


def make_problem(skin: Skin, solver: EquilibriumSolver, beta: float = 6.0) -> ShapeProblem:
    pattern = skin.pattern
    target = bend(np.radians(60), 0.06, neutral=0.01)(pattern.points)
    wall = pattern.panel[skin.owned_cells] == pattern.panel_index("wall")
    return ShapeProblem(
        DensityFields(
            skin, cone_filter(skin, RADIUS), Projection(beta), np.where(wall, np.nan, 1.0)
        ),
        InflatedSkin(solver, 5e3),
        ShapeObjective(skin, target),
    )


def passive_in(problem: ShapeProblem, passive: Floats | None) -> ShapeProblem:
    """The same problem with other prescribed densities."""
    fields = dataclasses.replace(densities_of(problem.fields), passive=passive)
    return problem.changed(fields=fields)


def bounded(problem: ShapeProblem, low: float, high: float) -> ShapeProblem:
    """The same problem with designed pressures."""
    physics = dataclasses.replace(problem.physics, pressure_bounds=(low, high))
    return problem.changed(physics=physics)


def border_term(skin: Skin, weight: float) -> ObjectiveTerm:
    return ObjectiveTerm("perimeter", Perimeter(skin, RADIUS), weight / skin.pattern.size)


def full(skin: Skin, solver: EquilibriumSolver, beta: float = 6.0) -> ShapeProblem:
    """All that a problem has: pressure designed, perimeter penalised, widths constrained."""
    plain = bounded(make_problem(skin, solver, beta), 1e3, 2e4)
    return plain.changed(terms=[border_term(skin, 1e-4)], length_scale=widths_of(plain))


def widths_of(problem: ShapeProblem, widths: LengthScale | None = None) -> LengthScaleConstraints:
    filter = densities_of(problem.fields).filter
    return LengthScaleConstraints(problem.skin, filter, widths or LengthScale(), problem.designed)
