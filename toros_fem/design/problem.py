"""The chain from design to objective and back: one evaluation of a design, eqs. (11-19)."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._mpi import raise_together, total
from toros_fem._types import Floats
from toros_fem._validate import require_between
from toros_fem.density.field import check_density
from toros_fem.density.filters import Filter
from toros_fem.density.length_scale import LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.density.projection import Projection
from toros_fem.errors import DensityError
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

Bounds = tuple[float, float]
Pressure = float | Sequence[float]


class Response(Protocol):
    """What a pattern does, as the design loop sees it."""

    @property
    def state(self) -> Any:
        """What a neighbouring design's simulation is started from."""

    @property
    def pressure(self) -> float:
        """The largest pressure in Pa; 0 without any."""

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressures in Pa, none where there is none."""

    @property
    def steps(self) -> int:
        """Newton steps taken."""

    @property
    def factorisations(self) -> int:
        """Factorisations made."""


R = TypeVar("R", bound=Response)


@dataclass(frozen=True, eq=False)
class Evaluation(Generic[R]):
    """One pass through the chain ρ → ρ̃ → ρ̄ → x → T and back.

    Attributes:
        objective: T, shape and penalty together.
        shape: Its part that measures the distance from what is wanted.
        perimeter: Length in m of the border of the print; None where no term asks for it.
        length_scale: (g_r, g_t) of eqs. (13, 14); None where they are not asked for.
        gradient: dT/dρ at owned triangles, zero where the density is not designed; None if it
            was not asked for.
        pressure_gradient: dT/dP in 1/Pa by the pressure of each chamber, (k,), zero where it is
            not designed; None if it was not asked for, or none is.
        length_scale_gradients: dg_r/dρ and dg_t/dρ, as `gradient`; None if not asked for.
        residuals: Numbers of whose squares `shape` is the sum, (j,); none if it is no such sum.
        residual_gradients: Theirs by ρ, as `gradient`; None if not asked for.
        density: ρ at owned triangles.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: What the pattern does: the simulated shape, or the response of a tile.
        seconds: Wall time by phase, on this rank.
    """

    objective: float
    shape: float
    perimeter: float | None
    length_scale: Floats | None
    gradient: Floats | None
    pressure_gradient: Floats | None
    length_scale_gradients: list[Floats] | None
    residuals: Floats
    residual_gradients: list[Floats] | None
    density: Floats
    filtered: Floats
    projected: Floats
    equilibrium: R
    seconds: dict[str, float]


class DesignProblem(ABC, Generic[R]):
    """Filter, projection, penalty and constraints around a simulation, and their way back.

    What is None is neither built nor computed. A kind of problem says what a projected density
    does, `respond`, and how its objective changes with it, `respond_backward`.

    Attributes:
        filter: Filter of the densities.
        projection: Smoothed step; replaced by the loop when β is raised.
        passive: Projected density that is given, at owned triangles; NaN where it is designed.
            None designs every triangle.
        perimeter: Penalty on the length of the print's border, and its weight: T grows by
            weight · perimeter/L, L the size of the skin. A weight of 0 leaves it out.
        weight: That weight, a pure number.
        length_scale: Constraints on the widths of lines and gaps.
        whole: What the skin is a part of, `meshes.mirrored`; None if it is whole. What is printed
            is drawn and measured on the whole.
    """

    filter: Filter
    projection: Projection
    passive: Floats | None
    perimeter: Perimeter | None
    weight: float
    length_scale: LengthScaleConstraints | None
    whole: Mirrored | None

    @property
    @abstractmethod
    def skin(self) -> Skin:
        """The skin whose densities are designed."""

    @property
    def comm(self) -> MPI.Comm:
        """All ranks that take part."""
        return self.skin.comm

    @abstractmethod
    def with_projection(self, projection: Projection) -> Self:
        """The same with another projection; solver, filter and all else are shared."""

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressures in Pa, the first guess where designed."""
        return ()

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Least and largest of each in Pa; None where it is not designed."""
        return ()

    @abstractmethod
    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, allow_continuation: bool
    ) -> tuple[R, float]:
        """What a projected density does, and how far that is from what is wanted (collective).

        Raises:
            NoEquilibriumError: There is no equilibrium, on all ranks.
        """

    @abstractmethod
    def respond_backward(self, evaluation: Evaluation[R]) -> tuple[Floats, Floats | None]:
        """Gradients of that distance by ρ̄ and by the pressures, if any is designed (collective)."""

    def residuals(self, response: R) -> Floats:
        """Numbers of whose squares that distance is the sum, (j,), for MMA to know them apart.

        None by default: worth having where they are few and no pressure is designed.
        """
        return np.zeros(0)

    def residuals_backward(self, evaluation: Evaluation[R]) -> Floats:
        """Their gradients by ρ̄, (j, cells) (collective)."""
        return np.zeros((0, len(evaluation.projected)))

    def check(self) -> None:
        """Check what all kinds of problems have in common (collective).

        Raises:
            ParameterError: The weight is negative.
            DensityError: The given density does not fit, leaves [0, 1] or leaves nothing free.
        """
        require_between(0.0, np.inf, weight=self.weight)
        if self.passive is None:
            return
        skin = self.skin
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
            return np.ones(len(self.skin.owned_cells), dtype=bool)
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
        start: Any = None,
        pressure: Pressure | None = None,
        *,
        allow_continuation: bool = True,
    ) -> Evaluation[R]:
        """T without its gradient, by one simulation, eq. (17) (collective).

        Args:
            density: ρ at owned triangles, in [0, 1].
            start: State to start from, of a neighbouring design say.
            pressure: In Pa, of all chambers or of each; None takes the problem's own.
            patient: Whether to go all ways to an equilibrium, or only the nearest one.

        Raises:
            DensityError: The density does not fit or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium for this design.
        """
        check_density(self.skin, density)
        begin = time.perf_counter()
        density = self.completed(density)
        filtered, projected = self.fields(density)
        found = self._evaluate(
            density, filtered, projected, start, pressure, allow_continuation=allow_continuation
        )
        found.seconds["filter"] = time.perf_counter() - begin - found.seconds["equilibrium"]
        return found

    def simulate_binary(self, printed: npt.NDArray[np.bool_], like: Evaluation[R]) -> Evaluation[R]:
        """What a thresholded pattern does, at the pressure of a design (collective).

        Args:
            printed: Which owned triangles are printed; what is given stays as given.
            like: The design that it came from: pressure, and state to start from.

        Raises:
            NoEquilibriumError: There is no equilibrium for this pattern.
        """
        projected = self.completed(printed.astype(np.float64))
        near = like.equilibrium
        return self._evaluate(
            like.density, like.filtered, projected, near.state, near.pressures or None
        )

    def _evaluate(
        self,
        density: Floats,
        filtered: Floats,
        projected: Floats,
        start: Any,
        pressure: Pressure | None,
        *,
        allow_continuation: bool = True,
    ) -> Evaluation[R]:
        perimeter = None
        if self.perimeter is not None and self.weight > 0:
            perimeter = self.perimeter.forward(projected)
        widths = None
        if self.length_scale is not None:
            widths = self.length_scale.forward(density, filtered, projected)
        begin = time.perf_counter()
        response, distance = self.respond(
            projected, start, pressure, allow_continuation=allow_continuation
        )
        return Evaluation(
            objective=distance + self._price * (perimeter or 0.0),
            shape=distance,
            perimeter=perimeter,
            length_scale=widths,
            gradient=None,
            pressure_gradient=None,
            length_scale_gradients=None,
            residuals=self.residuals(response),
            residual_gradients=None,
            density=density,
            filtered=filtered,
            projected=projected,
            equilibrium=response,
            seconds={"equilibrium": time.perf_counter() - begin},
        )

    def differentiate(self, evaluation: Evaluation[R]) -> Evaluation[R]:
        """Add the gradients to the last simulation, by adjoint solves, eqs. 18, 19 (collective).

        Raises:
            ParameterError: The solver has been used for another design since.
        """
        begin = time.perf_counter()
        e = evaluation
        by_projected, pressure_gradient = self.respond_backward(e)
        if self.perimeter is not None and self.weight > 0:
            by_projected = by_projected + self._price * self.perimeter.backward(e.projected)
        gradient = self._pull_back(e, None, by_projected)
        widths = None
        if self.length_scale is not None:
            parts = self.length_scale.backward(e.density, e.filtered, e.projected)
            widths = [
                self._pull_back(e, by_filtered, by_projected) + by_density * self.designed
                for by_density, by_filtered, by_projected in parts
            ]
        rows = self.residuals_backward(e) if len(e.residuals) else ()
        return replace(
            e,
            gradient=gradient,
            pressure_gradient=pressure_gradient,
            length_scale_gradients=widths,
            residual_gradients=[self._pull_back(e, None, row) for row in rows],
            seconds={**e.seconds, "adjoint": time.perf_counter() - begin},
        )

    def evaluate(
        self, density: Floats, start: Any = None, pressure: Pressure | None = None
    ) -> Evaluation[R]:
        """T and its gradients: `simulate`, then `differentiate` (collective)."""
        return self.differentiate(self.simulate(density, start, pressure))

    @property
    def _price(self) -> float:
        """What T grows by for a metre of border."""
        return self.weight / self.skin.pattern.size

    def _pull_back(
        self, evaluation: Evaluation[R], by_filtered: Floats | None, by_projected: Floats
    ) -> Floats:
        """Gradient by ρ from those by ρ̃ and ρ̄, through projection and filter (collective)."""
        designed = self.designed
        whole = self.projection.backward(evaluation.filtered, by_projected * designed)
        if by_filtered is not None:
            whole = whole + by_filtered
        return np.asarray(self.filter.backward(whole) * designed)
