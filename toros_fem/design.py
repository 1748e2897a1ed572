"""The chain from density to objective and back: one evaluation of a design, eqs. (11-19)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from toros_fem._mpi import raise_together, total
from toros_fem.density import check_density
from toros_fem.equilibrium import EquilibriumResult, EquilibriumSolver
from toros_fem.errors import DensityError
from toros_fem.filters import ConeFilter
from toros_fem.objective import ShapeObjective
from toros_fem.projection import Projection

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One pass through the chain ρ → ρ̃ → ρ̄ → x → T and back.

    Attributes:
        objective: T.
        gradient: dT/dρ at owned triangles, zero where the density is not designed; None if it
            was not asked for.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: The simulated shape.
        seconds: Wall time by phase, on this rank.
    """

    objective: float
    gradient: Floats | None
    filtered: Floats
    projected: Floats
    equilibrium: EquilibriumResult
    seconds: dict[str, float]


@dataclass(eq=False)
class DesignProblem:
    """A scene and what is wanted of it.

    Attributes:
        solver: Equilibrium solver of the scene.
        objective: Distance from the target.
        filter: Filter on the flat panels.
        pressure: Pressure in Pa.
        projection: Smoothed step; replaced by the loop when β is raised.
        passive: Projected density that is given, at owned triangles; NaN where it is designed.
            None designs every triangle.
    """

    solver: EquilibriumSolver
    objective: ShapeObjective
    filter: ConeFilter
    pressure: float
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None

    def __post_init__(self) -> None:
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
    def designed(self) -> npt.NDArray[np.bool_]:
        """Which owned triangles are designed."""
        if self.passive is None:
            return np.ones(len(self.solver.skin.owned_cells), dtype=bool)
        return np.isnan(self.passive)

    def fields(self, density: Floats) -> tuple[Floats, Floats]:
        """ρ̃ and ρ̄ of a density (collective)."""
        filtered = self.filter.forward(density)
        projected = self.projection.forward(filtered)
        if self.passive is not None:
            projected = np.where(self.designed, projected, self.passive)
        return filtered, projected

    def simulate(self, density: Floats, start: Floats | None = None) -> Evaluation:
        """T without its gradient, by one equilibrium, eq. (17) (collective).

        Args:
            density: ρ at owned triangles, in [0, 1].
            start: Positions to start the equilibrium from, of a neighbouring design say.

        Raises:
            DensityError: The density does not fit or leaves [0, 1].
            EquilibriumError: There is no equilibrium for this design.
        """
        check_density(self.solver.skin, density)
        begin = time.perf_counter()
        filtered, projected = self.fields(density)
        middle = time.perf_counter()
        equilibrium = self.solver.solve(projected, self.pressure, start=start)
        objective = self.objective.forward(equilibrium.state)
        seconds = {"filter": middle - begin, "equilibrium": time.perf_counter() - middle}
        return Evaluation(objective, None, filtered, projected, equilibrium, seconds)

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """Add dT/dρ to the last simulation, by one adjoint solve, eqs. (18, 19) (collective).

        Raises:
            ParameterError: The solver has been used for another design since.
        """
        begin = time.perf_counter()
        state = evaluation.equilibrium.state
        adjoint = self.solver.solve_tangent(self.objective.backward(state), evaluation.equilibrium)
        by_projected = -self.solver.model.density_sensitivity(state, adjoint) * self.designed
        by_filtered = self.projection.backward(evaluation.filtered, by_projected)
        gradient = self.filter.backward(by_filtered) * self.designed
        seconds = {**evaluation.seconds, "adjoint": time.perf_counter() - begin}
        return replace(evaluation, gradient=gradient, seconds=seconds)

    def evaluate(self, density: Floats, start: Floats | None = None) -> Evaluation:
        """T and dT/dρ: `simulate`, then `differentiate` (collective)."""
        return self.differentiate(self.simulate(density, start))
