"""The chain from design to objective and back: one evaluation of a design, eqs. (11-19)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from toros_fem._mpi import dot, raise_together, total
from toros_fem.density import check_density
from toros_fem.equilibrium import EquilibriumResult, EquilibriumSolver
from toros_fem.errors import DensityError, ParameterError
from toros_fem.filters import Filter
from toros_fem.length_scale import LengthScaleConstraints
from toros_fem.meshes.mirror import Mirrored
from toros_fem.objective import Objective
from toros_fem.parameters import require_between, require_positive
from toros_fem.perimeter import Perimeter
from toros_fem.projection import Projection

Floats = npt.NDArray[np.float64]
Bounds = tuple[float, float]
Pressure = float | Sequence[float]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One pass through the chain ρ → ρ̃ → ρ̄ → x → T and back.

    Attributes:
        objective: T, shape and penalty together.
        shape: Its part that measures the distance from the target.
        perimeter: Length in m of the border of the print; None where no term asks for it.
        length_scale: (g_r, g_t) of eqs. (13, 14); None where they are not asked for.
        gradient: dT/dρ at owned triangles, zero where the density is not designed; None if it
            was not asked for.
        pressure_gradient: dT/dP in 1/Pa by the pressure of each chamber, (k,), zero where it is
            not designed; None if it was not asked for, or none is.
        length_scale_gradients: dg_r/dρ and dg_t/dρ, as `gradient`; None if not asked for.
        density: ρ at owned triangles.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: The simulated shape.
        seconds: Wall time by phase, on this rank.
    """

    objective: float
    shape: float
    perimeter: float | None
    length_scale: Floats | None
    gradient: Floats | None
    pressure_gradient: Floats | None
    length_scale_gradients: list[Floats] | None
    density: Floats
    filtered: Floats
    projected: Floats
    equilibrium: EquilibriumResult
    seconds: dict[str, float]


@dataclass(eq=False)
class DesignProblem:
    """A scene and what is wanted of it. What is None is neither built nor computed.

    Attributes:
        solver: Equilibrium solver of the scene.
        objective: Distance from the target, of the positions.
        filter: Filter of the densities.
        pressure: Pressure in Pa, of all chambers or of each; the first guess where designed.
        projection: Smoothed step; replaced by the loop when β is raised.
        passive: Projected density that is given, at owned triangles; NaN where it is designed.
            None designs every triangle.
        pressure_bounds: Least and largest pressure in Pa of all chambers, or such a pair for each;
            None keeps the pressure, or that chamber's, as given.
        perimeter: Penalty on the length of the print's border, and its weight: T grows by
            weight · perimeter/L, L the size of the skin. A weight of 0 leaves it out.
        weight: That weight, a pure number.
        length_scale: Constraints on the widths of lines and gaps.
        force: Dead forces in N on all assembled vertices, (n, 3), whatever the design.
        whole: What the skin is a part of, `meshes.mirrored`; None if it is whole. What is printed
            is drawn and measured on the whole.
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
        require_between(0.0, np.inf, weight=self.weight)
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
        if self.passive is None:
            return
        skin = self.solver.skin
        given = self.passive[~np.isnan(self.passive)]
        error = None
        if self.passive.shape != skin.owned_cells.shape:
            error = DensityError(
                f"passive has shape {self.passive.shape}; this rank owns "
                f"{len(skin.owned_cells)} triangles."
            )
        elif len(given) and not (given.min() >= 0 and given.max() <= 1):
            error = DensityError(
                f"passive holds densities from {given.min()} to {given.max()}; they must lie in "
                "[0, 1], or be NaN where the triangle is designed."
            )
        raise_together(skin.comm, error)
        if total(skin.comm, self.designed.sum()) == 0:
            raise DensityError("passive gives the density of every triangle: none is designed.")

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

    @property
    def designed(self) -> npt.NDArray[np.bool_]:
        """Which owned triangles are designed."""
        if self.passive is None:
            return np.ones(len(self.solver.skin.owned_cells), dtype=bool)
        return np.isnan(self.passive)

    def completed(self, density: Floats) -> Floats:
        """A density with what is given put in, so that filters see it."""
        if self.passive is None:
            return density
        return np.where(self.designed, density, self.passive)

    def fields(self, density: Floats) -> tuple[Floats, Floats]:
        """ρ̃ and ρ̄ of a density (collective)."""
        filtered = self.filter.forward(density)
        return filtered, self.completed(self.projection.forward(filtered))

    def simulate(
        self,
        density: Floats,
        start: Floats | None = None,
        pressure: Pressure | None = None,
        *,
        patient: bool = True,
    ) -> Evaluation:
        """T without its gradient, by one equilibrium, eq. (17) (collective).

        Args:
            density: ρ at owned triangles, in [0, 1].
            start: `EquilibriumResult.state` to start the equilibrium from, of a neighbouring
                design say.
            pressure: In Pa, of all chambers or of each; None takes `self.pressure`.
            patient: As for `EquilibriumSolver.solve`.

        Raises:
            DensityError: The density does not fit or leaves [0, 1].
            EquilibriumError: There is no equilibrium for this design.
        """
        check_density(self.solver.skin, density)
        begin = time.perf_counter()
        density = self.completed(density)
        filtered, projected = self.fields(density)
        found = self._evaluate(density, filtered, projected, start, pressure, patient=patient)
        found.seconds["filter"] = time.perf_counter() - begin - found.seconds["equilibrium"]
        return found

    def simulate_binary(self, printed: npt.NDArray[np.bool_], like: Evaluation) -> Evaluation:
        """The shape of a thresholded pattern, at the pressure of a design (collective).

        Args:
            printed: Which owned triangles are printed; what is given stays as given.
            like: The design that it came from: pressure, and shape to start from.

        Raises:
            EquilibriumError: There is no equilibrium for this pattern.
        """
        projected = self.completed(printed.astype(np.float64))
        equilibrium = like.equilibrium
        return self._evaluate(
            like.density, like.filtered, projected, equilibrium.state, equilibrium.pressures
        )

    def _evaluate(
        self,
        density: Floats,
        filtered: Floats,
        projected: Floats,
        start: Floats | None,
        pressure: Pressure | None,
        *,
        patient: bool = True,
    ) -> Evaluation:
        perimeter = None
        if self.perimeter is not None and self.weight > 0:
            perimeter = self.perimeter.forward(projected)
        widths = None
        if self.length_scale is not None:
            widths = self.length_scale.forward(density, filtered, projected)
        begin = time.perf_counter()
        wanted = self.pressure if pressure is None else pressure
        equilibrium = self.solver.solve(
            projected, wanted, force=self.force, start=start, patient=patient
        )
        seconds = {"equilibrium": time.perf_counter() - begin}
        shape = self.objective.forward(equilibrium.positions)
        return Evaluation(
            objective=shape + self._price * (perimeter or 0.0),
            shape=shape,
            perimeter=perimeter,
            length_scale=widths,
            gradient=None,
            pressure_gradient=None,
            length_scale_gradients=None,
            density=density,
            filtered=filtered,
            projected=projected,
            equilibrium=equilibrium,
            seconds=seconds,
        )

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """Add the gradients to the last simulation, by one adjoint solve, eqs. 18, 19 (collective).

        Raises:
            ParameterError: The solver has been used for another design since.
        """
        begin = time.perf_counter()
        e, state = evaluation, evaluation.equilibrium.state
        rhs = np.zeros_like(state)
        self.solver.model.positions(rhs)[:] = self.objective.backward(e.equilibrium.positions)
        adjoint = self.solver.solve_tangent(rhs, e.equilibrium)
        by_projected = -self.solver.model.density_sensitivity(state, adjoint)
        if self.perimeter is not None and self.weight > 0:
            by_projected += self._price * self.perimeter.backward(e.projected)
        pressure_gradient = None
        designed = [k for k, bounds in enumerate(self.pressure_ranges) if bounds is not None]
        if designed:
            pressure_gradient = np.zeros(len(self.pressures))
            for k in designed:
                load = self.solver.model.load(state, k)
                pressure_gradient[k] = dot(self.solver.skin.comm, adjoint, load)
        gradient = self._pull_back(e, None, by_projected)
        widths = None
        if self.length_scale is not None:
            parts = self.length_scale.backward(e.density, e.filtered, e.projected)
            widths = [
                self._pull_back(e, by_filtered, by_projected) + by_density * self.designed
                for by_density, by_filtered, by_projected in parts
            ]
        return replace(
            e,
            gradient=gradient,
            pressure_gradient=pressure_gradient,
            length_scale_gradients=widths,
            seconds={**e.seconds, "adjoint": time.perf_counter() - begin},
        )

    def evaluate(
        self, density: Floats, start: Floats | None = None, pressure: Pressure | None = None
    ) -> Evaluation:
        """T and its gradients: `simulate`, then `differentiate` (collective)."""
        return self.differentiate(self.simulate(density, start, pressure))

    @property
    def _price(self) -> float:
        """What T grows by for a metre of border."""
        return self.weight / self.solver.skin.pattern.size

    def _pull_back(
        self, evaluation: Evaluation, by_filtered: Floats | None, by_projected: Floats
    ) -> Floats:
        """Gradient by ρ from those by ρ̃ and ρ̄, through projection and filter (collective)."""
        designed = self.designed
        whole = self.projection.backward(evaluation.filtered, by_projected * designed)
        if by_filtered is not None:
            whole = whole + by_filtered
        return np.asarray(self.filter.backward(whole) * designed)
