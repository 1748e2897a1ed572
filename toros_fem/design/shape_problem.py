"""Designing a skin under pressure towards a shape, eqs. (17-19)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from toros_fem._mpi import dot
from toros_fem._types import Floats
from toros_fem._validate import require_between, require_positive
from toros_fem.density.filters import Filter
from toros_fem.density.length_scale import LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.density.projection import Projection
from toros_fem.design.problem import Bounds, DesignProblem, Evaluation, Pressure
from toros_fem.equilibrium.solver import EquilibriumResult, EquilibriumSolver
from toros_fem.errors import ParameterError
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin
from toros_fem.objectives.shape import Objective


@dataclass(eq=False)
class ShapeProblem(DesignProblem[EquilibriumResult]):
    """A scene and the shape that is wanted of it; see `DesignProblem` for what is not said here.

    Attributes:
        solver: Equilibrium solver of the scene.
        objective: Distance from the target, of the positions.
        pressure: Pressure in Pa, of all chambers or of each; the first guess where designed.
        pressure_bounds: Least and largest pressure in Pa of all chambers, or such a pair for each;
            None keeps the pressure, or that chamber's, as given.
        force: Dead forces in N on all assembled vertices, (n, 3), whatever the design.
    """

    solver: EquilibriumSolver
    objective: Objective
    filter: Filter
    pressure: Pressure
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    pressure_bounds: Bounds | Sequence[Bounds | None] | None = None
    perimeter: Perimeter | None = None
    weight: float = 0.0
    length_scale: LengthScaleConstraints | None = None
    force: Floats | None = None
    whole: Mirrored | None = None

    def __post_init__(self) -> None:
        for pressure, bounds in zip(self.pressures, self.pressure_ranges, strict=True):
            if bounds is not None:
                low, high = bounds
                require_positive(least_pressure=low, largest_pressure=high)
                if not low < high:
                    raise ParameterError(
                        f"the pressure's bounds {low:g} and {high:g} Pa leave it no room; the "
                        "second must be larger. To keep the pressure as it is, give no bounds."
                    )
                require_between(low, high, pressure=pressure)
        self.check()

    @property
    def skin(self) -> Skin:
        """The solver's."""
        return self.solver.skin

    def with_projection(self, projection: Projection) -> ShapeProblem:
        """The same with another projection."""
        return replace(self, projection=projection)

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa, the first guess where it is designed."""
        return self._for_each(self.pressure, "pressure", np.isscalar(self.pressure))

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Least and largest pressure of each chamber in Pa; None where it is not designed."""
        bounds = self.pressure_bounds
        alike = bounds is None or np.isscalar(bounds[0])
        return self._for_each(bounds, "pressure_bounds", alike)

    def _for_each(self, given: Any, name: str, alike: bool) -> tuple[Any, ...]:
        count = len(self.solver.model.pressures)
        values = (given,) * count if alike else tuple(given)
        if len(values) != count:
            raise ParameterError(
                f"{name} has {len(values)} entries; it must have one for each of the {count} "
                "chambers, or be given once for all."
            )
        return values

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, allow_continuation: bool
    ) -> tuple[EquilibriumResult, float]:
        """The equilibrium, and the distance of its shape from the target (collective)."""
        wanted = self.pressure if pressure is None else pressure
        equilibrium = self.solver.solve(
            projected, wanted, force=self.force, start=start, allow_continuation=allow_continuation
        )
        return equilibrium, self.objective.forward(equilibrium.positions)

    def respond_backward(
        self, evaluation: Evaluation[EquilibriumResult]
    ) -> tuple[Floats, Floats | None]:
        """By one adjoint solve with the tangent at the equilibrium (collective)."""
        equilibrium, model = evaluation.equilibrium, self.solver.model
        rhs = np.zeros_like(equilibrium.state)
        model.positions(rhs)[:] = self.objective.backward(equilibrium.positions)
        adjoint = self.solver.solve_tangent(rhs, equilibrium)
        by_projected = -model.density_sensitivity(equilibrium.state, adjoint)
        designed = [k for k, bounds in enumerate(self.pressure_ranges) if bounds is not None]
        if not designed:
            return by_projected, None
        by_pressure = np.zeros(len(self.pressures))
        for k in designed:
            by_pressure[k] = dot(self.skin.comm, adjoint, model.load(equilibrium.state, k))
        return by_projected, by_pressure
