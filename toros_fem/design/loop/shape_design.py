"""A shape design from a case and its regularisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    NAMES,
    checked_axes,
    checked_floats,
    checked_list,
    require_callable,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import ObjectiveTerm
from toros_fem.design.loop.regularisation import Regularisation
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import check_metrics
from toros_fem.measures.shape import checked_target, require_near
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import sew


class ShapeDesign(ShapeProblem):
    """A pattern whose print is designed so that the inflated skin takes a target shape.

    Only what is given is built: no pressure unknowns without bounds, no perimeter without a weight.

    Args:
        comm: Communicator.
        case: The skin, what acts on it, and its target.
        regularisation: Filter, projection, widths and perimeter.
        options: Options of the equilibrium solver.
        log: Called with each Newton step, on every rank.

    Attributes:
        case, regularisation: As given, or as they were changed by the methods of this class. What
            else `changed` gives holds on this mesh alone, but for metrics. Where nothing is
            designed, as in a print, width constraints and perimeter are left out.
        fields: DensityFields, filter and projection.

    Raises:
        TorosError: An argument does not fit the pattern or is out of its bounds; the message names
            the value, the bound and the remedy.
    """

    fields: DensityFields

    def __init__(
        self,
        comm: MPI.Comm,
        case: Case,
        regularisation: Regularisation,
        *,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep | str], None] | None = None,
    ) -> None:
        require_kind("case", case, Case, "a Case")
        require_kind("regularisation", regularisation, Regularisation, "a Regularisation")
        _check_kinds(case, regularisation, log)
        passive = _given_density(case)
        if passive is not None and not np.isnan(passive).any():
            regularisation = regularisation.plain
        self.case, self.regularisation, self._log = case, regularisation, log
        skin = sew(comm, case.pattern)
        goal = checked_target(skin, case.goal)
        require_near(case.pattern, goal)
        force, whole, r = case.force, case.whole, regularisation
        if force is not None:
            places = case.pattern.points.shape
            force = checked_floats("force", force, f"finite and of shape {places}, in N", places)
        solver = EquilibriumSolver(
            skin,
            Composite() if case.composite is None else case.composite,
            case.supports,
            options,
            log,
            chambers=case.chambers,
            weight=case.weight,
            contact=case.contact,
            quadratic=case.quadratic,
        )
        physics = InflatedSkin(solver, case.pressure, case.pressure_bounds, force)
        beyond = whole if whole.parts > 1 else None
        density_filter = make_filter(r.filter, skin, r.filter_radius, beyond)
        passive = None if passive is None else passive[skin.owned_cells]
        super().__init__(
            DensityFields(skin, density_filter, r.projection, passive, case.start),
            physics,
            case.objective(skin),
            metrics=case.judged,
            whole=whole,
            target=goal,
            pressure_weight=case.pressure_weight,
        )
        self._of_case = self.objective, self.metrics
        if r.perimeter_weight is not None:
            require_positive(perimeter_weight=r.perimeter_weight)
            window = r.filter_radius if r.perimeter_window is None else r.perimeter_window
            perimeter = Perimeter(skin, window, r.perimeter_sharpness, beyond=beyond)
            weight = r.perimeter_weight * self.parts / whole.pattern.size
            self.terms = [ObjectiveTerm("perimeter", perimeter, weight)]
        if r.length_scale is not None:
            self.length_scale = LengthScaleConstraints(
                skin,
                density_filter,
                r.length_scale,
                self.designed,
                r.projection,
                parts=self.parts,
            )

    def towards(self, case: Case) -> Self:
        """Return the same design with the target and the parts of another case (collective).

        All other parts are shared; the metrics and the target in pictures stay.

        Args:
            case: A case on the same pattern.
        """
        given = replace(
            self.case, target=case.target, parts=case.parts, parts_of_whole=case.parts_of_whole
        )
        made = case.objective(self.skin)
        return self.changed(objective=made, case=given, _of_case=(made, self._of_case[1]))

    def on(self, pattern: Pattern) -> ShapeDesign:
        """Return the same design on the same triangles, whose vertices have moved (collective).

        Args:
            pattern: The pattern after the move, by `meshes.moving.with_flat_points` for instance.

        Raises:
            TorosError: A part of the objective does not fit the moved skin.
        """
        return self._with(self.case.on(pattern), self.regularisation)

    def for_print(self, regions: Sequence[BaseGeometry]) -> ShapeDesign:
        """Return the design on a mesh whose edges are the borders of a print (collective).

        Args:
            regions: Print on each panel of the pattern, polygons in m.
        """
        return self._with(self.case.following(self.comm, regions), self.regularisation)

    def refined(self) -> ShapeDesign:
        """Return the same design on the refined pattern, with half of all lengths (collective).

        See `Case.refined` and `Regularisation.scaled`.

        Raises:
            ParameterError: The sheet is moulded in its assembled shape.
            TorosError: A part of the objective does not fit the refined skin.
        """
        return self._with(self.case.refined(), self.regularisation.scaled(0.5))

    def _with(self, case: Case, regularisation: Regularisation) -> ShapeDesign:
        objective, metrics = self._of_case
        if self.objective is not objective:
            raise ParameterError(
                "the objective was changed, and is known on its own mesh only: give a case that "
                "makes it, towards(case)."
            )
        if self.metrics is not metrics:
            case = replace(case, metrics=self.metrics)
        now = replace(regularisation, projection=self.fields.projection)
        return ShapeDesign(self.comm, case, now, options=self.solver.options, log=self._log)


def _check_kinds(
    case: Case, regularisation: Regularisation, log: Callable[[NewtonStep | str], None] | None
) -> None:
    """Check what comes before a part is made of it."""
    checked_axes("symmetry", case.symmetry)
    if case.metrics is not None:
        check_metrics(case.metrics)
    if not isinstance(case.parts, list | tuple) or not case.parts:
        raise ParameterError(
            f"parts = {shown(case.parts)} must be a list, with ShapePart() for instance."
        )
    for part in case.parts:
        require_callable("parts", part, "functions of the nodes and their target")
    if log is not None:
        require_callable("log", log, "a function, or None")
    require_kind("projection", regularisation.projection, Projection, "a Projection")
    what = "a LengthScale, or None"
    require_kind("length_scale", regularisation.length_scale, (LengthScale, type(None)), what)


def _given_density(case: Case) -> Floats | None:
    """Return the prescribed density of all triangles, (t,); None if there is none."""
    checked_list("printed_panels", case.printed_panels, str, NAMES)
    count, passive = len(case.pattern.triangles), case.passive
    if passive is not None:
        what = "one density for each triangle, NaN where it is designed"
        checked_floats("passive", passive, f"({count},), {what}", (count,), finite=False)
    return case.prescribed
