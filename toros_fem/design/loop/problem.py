"""The design problem: one evaluation of a design and its gradient, eqs. (11-19)."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import DensityError, ParameterError
from toros_fem.base.mpi import dot, together, total
from toros_fem.base.validation import require_positive
from toros_fem.design.density.field import random_density
from toros_fem.design.density.length_scale import LengthScaleConstraints
from toros_fem.design.density.linear import Filter
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.warm_start import InitialDensity
from toros_fem.mechanics.skin.designs import check_density
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

Bounds = tuple[float, float]
Pressure = float | Sequence[float]


class Response(Protocol):
    """The simulated response to a projected density, as the design loop sees it."""

    @property
    def state(self) -> Any:
        """State from which the simulation of a neighbouring design starts."""

    @property
    def pressure(self) -> float:
        """The largest pressure in Pa; 0 without any."""

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa; empty without any."""

    @property
    def steps(self) -> int:
        """Number of Newton steps."""

    @property
    def factorisations(self) -> int:
        """Number of factorisations."""


R = TypeVar("R", bound=Response)


@dataclass(frozen=True, eq=False)
class Residuals(Generic[R]):
    """Numbers r whose squares are a part of T, around one design.

    MMA approximates each r by itself, and so knows that their changes add up before they are
    squared. That pays where many variables change the same few numbers.

    Attributes:
        values: Returns r, (j,), of the response of this design or of one near to it (collective).
        gradients: dr/dρ at owned triangles, j arrays.
        pressure_gradients: dr/dP in 1/Pa by the pressure of each chamber, (j, k).
    """

    values: Callable[[R], Floats]
    gradients: list[Floats]
    pressure_gradients: Floats


@dataclass(frozen=True, eq=False)
class Evaluation(Generic[R]):
    """One pass ρ → ρ̃ → ρ̄ → x → T, and its gradients.

    Attributes:
        problem: The problem that the design was evaluated in.
        objective: T, the shape term and the penalty together.
        shape: The part of T that measures the distance from the target.
        perimeter: Length in m of the border of the print; None without a perimeter term.
        length_scale: (g_r, g_t) of eqs. (13, 14); None without width constraints.
        gradient: dT/dρ at owned triangles, zero where the density is prescribed; None before
            `DesignProblem.differentiate`.
        pressure_gradient: dT/dP in 1/Pa by the pressure of each chamber, (k,), zero where the
            pressure is prescribed; None before `differentiate`, or without designed pressures.
        length_scale_gradients: dg_r/dρ and dg_t/dρ, as `gradient`.
        residuals: Residuals around this design; None before `differentiate`.
        density: ρ at owned triangles.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: The response: the simulated shape, or the profile of a tile.
        seconds: Wall time by phase, on this rank.
        variants: Responses of the eroded and of the dilated pattern of a robust design.
        spread: How far these are apart, in units of T; None without variants.
    """

    problem: DesignProblem[R]
    objective: float
    shape: float
    perimeter: float | None
    length_scale: Floats | None
    gradient: Floats | None
    pressure_gradient: Floats | None
    length_scale_gradients: list[Floats] | None
    residuals: Residuals[R] | None
    density: Floats
    filtered: Floats
    projected: Floats
    equilibrium: R
    seconds: Mapping[str, float]
    variants: tuple[R, ...] = ()
    spread: float | None = None

    @property
    def steps(self) -> int:
        """Number of Newton steps of all responses."""
        return self.equilibrium.steps + sum(v.steps for v in self.variants)

    @property
    def factorisations(self) -> int:
        """Number of factorisations of all responses."""
        return self.equilibrium.factorisations + sum(v.factorisations for v in self.variants)


class DesignProblem(ABC, Generic[R]):
    """Filter, projection, penalty and constraints around a simulation, with their gradients.

    A part that is None is neither built nor computed. A derived class defines the simulation of
    a projected density, `respond`, and the gradient of its objective, `respond_backward`.

    The gradient is the discrete adjoint's. Every stage is a pair of a forward and a backward pass,
    written by hand and tied by tests to differences of the whole chain.

    Attributes:
        filter: Filter of the densities.
        projection: Smoothed step; the loop replaces it where it raises β.
        passive: Prescribed projected density at owned triangles, NaN where it is designed. None
            designs every triangle.
        perimeter: Length of the print's border; None leaves the penalty out.
        perimeter_weight: Factor on perimeter/L in T, L the size of the skin; None without one.
        length_scale: Constraints on the widths of lines and gaps; None leaves them out.
        whole: The whole skin that the skin is a part of, by `meshes.mirrored`; None if the skin is
            whole. Prints are drawn and measured on the whole.
    """

    filter: Filter
    projection: Projection
    passive: Floats | None
    perimeter: Perimeter | None
    perimeter_weight: float | None
    length_scale: LengthScaleConstraints | None
    whole: Mirrored | None

    @property
    @abstractmethod
    def skin(self) -> Skin:
        """The skin whose densities are designed."""

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of all ranks that take part."""
        return self.skin.comm

    @abstractmethod
    def with_projection(self, projection: Projection) -> Self:
        """Return the same problem with another projection; all other parts are shared."""

    def without_variants(self) -> Self:
        """Return the same problem with the nominal pattern alone; all other parts are shared."""
        return self

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa, the first guess where it is designed."""
        return ()

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Bounds on the pressure of each chamber in Pa; None where it is prescribed."""
        return ()

    @abstractmethod
    def respond(
        self,
        projected: Floats,
        start: Any,
        pressure: Pressure | None,
        *,
        trial: bool,
    ) -> tuple[R, float]:
        """Simulate a projected density; return the response and its objective (collective).

        Raises:
            NoEquilibriumError: There is no equilibrium, on all ranks.
        """

    @abstractmethod
    def respond_backward(self, evaluation: Evaluation[R]) -> tuple[Floats, Floats | None]:
        """Return the objective's gradients by ρ̄ and by the pressures (collective).

        The second is None if no pressure is designed.
        """

    @abstractmethod
    def save_response(self, response: R) -> tuple[Floats, dict[str, Any]]:
        """Return what `restore_response` needs, by original index, and as JSON (collective).

        Args:
            response: The last simulation.
        """

    @abstractmethod
    def restore_response(
        self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]
    ) -> R:
        """Return a saved response, as if it had just been simulated (collective).

        Args:
            projected: ρ̄ at owned triangles.
            unknowns, numbers: As of `save_response`.
        """

    def save_variants(self, variants: Sequence[R]) -> list[tuple[Floats, dict[str, Any]]]:
        """Return what `restore_variants` needs of each variant: none by default (collective)."""
        return []

    def restore_variants(
        self, filtered: Floats, saved: Sequence[tuple[Floats, Mapping[str, Any]]]
    ) -> tuple[R, ...]:
        """Return saved variants, as if they had just been simulated (collective).

        Args:
            filtered: ρ̃ at owned triangles.
            saved: As of `save_variants`.
        """
        return ()

    def residuals_around(
        self, evaluation: Evaluation[R]
    ) -> tuple[Callable[[R], Floats], Floats, Floats]:
        """Return the residuals around the last simulation, and their gradients (collective).

        Returns:
            The function of the response, its gradients by ρ̄, (j, cells), and by the pressures,
            (j, k), as of `Residuals`.
        """
        none = np.zeros((0, len(evaluation.projected)))
        return lambda _: np.zeros(0), none, np.zeros((0, len(self.pressures)))

    def cost(self, projected: Floats) -> float:
        """Return what T counts besides distance and perimeter: 0 by default (collective)."""
        return 0.0

    def cost_backward(self, projected: Floats) -> Floats:
        """Return the gradient of `cost` by ρ̄ at owned triangles (collective)."""
        return np.zeros_like(projected)

    def metrics_of(self, response: R) -> dict[str, float]:
        """Return the values of all metrics by key, equal on all ranks (collective)."""
        return {}

    def shape_of(self, response: R) -> Floats | None:
        """Return the positions of all vertices, which a finer mesh starts from (collective).

        None by default: a finer mesh then starts from the assembled shape.
        """
        return None

    def shown_density(self, evaluation: Evaluation[R]) -> Floats:
        """Return the density of owned triangles that pictures of a design show: ρ̄ by default."""
        return evaluation.projected

    def state_at(self, positions: Floats) -> Any:
        """Return a state to start from, from the positions of all vertices (collective).

        None by default, for the assembled shape.
        """
        return None

    def start_density(self, seed: int) -> Floats:
        """Return the density to start from, at owned triangles: random by default.

        Raises:
            ParameterError: The seed is negative.
        """
        return random_density(self.skin, seed)

    def initial_density(self, density: Floats) -> InitialDensity | None:
        """Return a density to begin with on the whole skin, on every rank (collective).

        Where the variables are no densities there is none.

        Args:
            density: ρ at owned triangles.
        """
        cells = self.skin.gather_cells(self.with_passive(density))
        if self.whole is None:
            return InitialDensity(self.skin.pattern, cells)
        return InitialDensity(self.whole.pattern, self.whole.at_cells(cells))

    def check(self) -> None:
        """Check what all kinds of problems have in common (collective).

        Raises:
            ParameterError: The weight is not positive, or comes without a perimeter, or a
                perimeter without a weight.
            DensityError: The prescribed density does not fit, leaves [0, 1] or covers everything.
        """
        if (self.perimeter is None) != (self.perimeter_weight is None):
            raise ParameterError(
                "perimeter and perimeter_weight belong together: give both, or neither."
            )
        if self.perimeter_weight is not None:
            require_positive(perimeter_weight=self.perimeter_weight)
        if self.passive is None:
            return
        skin = self.skin
        given = self.passive[~np.isnan(self.passive)]
        with together(skin.comm):
            if self.passive.shape != skin.owned_cells.shape:
                raise DensityError(
                    f"passive has shape {self.passive.shape}; this rank owns "
                    f"{len(skin.owned_cells)} triangles."
                )
            if len(given) and not (given.min() >= 0 and given.max() <= 1):
                raise DensityError(
                    f"passive holds densities from {given.min()} to {given.max()}; they must lie "
                    "in [0, 1], or be NaN where the triangle is designed."
                )
        if total(skin.comm, self.designed.sum()) == 0:
            raise DensityError(
                "passive prescribes the density of every triangle: none is designed. Set NaN where "
                "the density is to be designed."
            )

    @property
    def designed(self) -> Bools:
        """Whether each owned triangle is designed."""
        if self.passive is None:
            return np.ones(len(self.skin.owned_cells), dtype=bool)
        return np.isnan(self.passive)

    @property
    def variable_bounds(self) -> tuple[Floats, Floats]:
        """Least and largest value of each variable of this rank; equal where it is prescribed."""
        passive = np.zeros(len(self.designed)) if self.passive is None else self.passive
        low = np.where(self.designed, 0.0, passive)
        return low, np.where(self.designed, 1.0, low)

    def check_variables(self, density: Floats) -> Floats:
        """Return the variables of this rank as an array, checked (collective).

        Raises:
            DensityError: The shape is wrong, or a value is outside [0, 1].
        """
        return check_density(self.skin, density)

    def reinforcement(self, evaluation: Evaluation[R]) -> tuple[float, float]:
        """Return volume fraction and grey level of a design, as of `Iteration` (collective)."""
        comm, projected = self.comm, evaluation.projected
        areas = self.skin.pattern.areas[self.skin.owned_cells] * self.designed
        whole, grey = total(comm, areas.sum()), 4 * projected * (1 - projected)
        return dot(comm, areas, projected) / whole, dot(comm, areas, grey) / whole

    def with_passive(self, density: Floats) -> Floats:
        """Return a density with the prescribed values put in, so that filters see them."""
        if self.passive is None:
            return density
        return np.where(self.designed, density, self.passive)

    def fields(self, density: Floats) -> tuple[Floats, Floats]:
        """Return ρ̃ and ρ̄ of a density (collective)."""
        filtered = self.filter.forward(density)
        return filtered, self.with_passive(self.projection.forward(filtered))

    def simulate(
        self,
        density: Floats,
        start: Any = None,
        pressure: Pressure | None = None,
        *,
        trial: bool = False,
    ) -> Evaluation[R]:
        """Evaluate T by one simulation, without its gradient, eq. (17) (collective).

        Args:
            density: ρ at owned triangles, in [0, 1].
            start: State to start from, of a neighbouring design for instance.
            pressure: In Pa, of all chambers or of each; None takes the problem's own.
            trial: Whether the result may be rejected, so that few steps and a large tolerance are
                enough; `finish` completes it.

        Raises:
            DensityError: The density does not fit or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium for this design.
        """
        density = self.check_variables(density)
        start_time = time.perf_counter()
        density = self.with_passive(density)
        filtered, projected = self.fields(density)
        return self._evaluate(
            density,
            filtered,
            projected,
            start,
            pressure,
            start_time=start_time,
            trial=trial,
        )

    def simulate_binary(
        self,
        printed: Bools,
        like: Evaluation[R] | None = None,
        *,
        start: Any = None,
        pressure: Pressure | None = None,
    ) -> Evaluation[R]:
        """Evaluate a binary pattern (collective).

        Args:
            printed: Whether each owned triangle is printed; prescribed densities are kept.
            like: The design that it came from: its densities, its pressure, and its state to start
                from. None for a pattern that was drawn: it is its own density.
            start: State to start from; None takes that of `like`.
            pressure: In Pa, of all chambers or of each; None takes that of `like`, or else the
                problem's own.

        Raises:
            NoEquilibriumError: There is no equilibrium for this pattern.
        """
        projected = self.with_passive(printed.astype(np.float64))
        density = filtered = projected
        if like is not None:
            density, filtered, near = like.density, like.filtered, like.equilibrium
            start = near if start is None else start
            pressure = near.pressures or None if pressure is None else pressure
        return self._evaluate(
            density,
            filtered,
            projected,
            start,
            pressure,
            start_time=time.perf_counter(),
            trial=False,
        )

    def _evaluate(
        self,
        density: Floats,
        filtered: Floats,
        projected: Floats,
        start: Any,
        pressure: Pressure | None,
        *,
        start_time: float,
        trial: bool,
    ) -> Evaluation[R]:
        perimeter = None if self.perimeter is None else self.perimeter.forward(projected)
        widths = None
        if self.length_scale is not None:
            widths = self.length_scale.forward(density, filtered, projected)
        middle = time.perf_counter()
        response, distance = self.respond(projected, start, pressure, trial=trial)
        end = time.perf_counter()
        return Evaluation(
            problem=self,
            objective=distance + self._perimeter_price * (perimeter or 0.0) + self.cost(projected),
            shape=distance,
            perimeter=perimeter,
            length_scale=widths,
            gradient=None,
            pressure_gradient=None,
            length_scale_gradients=None,
            residuals=None,
            density=density,
            filtered=filtered,
            projected=projected,
            equilibrium=response,
            seconds={"filter": middle - start_time, "equilibrium": end - middle},
        )

    def finish(self, evaluation: Evaluation[R]) -> Evaluation[R]:
        """Complete a trial, so that it can be differentiated (collective).

        Raises:
            ParameterError: The solver has been used for other designs since.
            NoEquilibriumError: There is no stable equilibrium near.
        """
        return evaluation

    def differentiate(self, evaluation: Evaluation[R]) -> Evaluation[R]:
        """Add the gradients to the last simulation, by adjoint solves, eqs. 18, 19 (collective).

        Raises:
            ParameterError: The solver has been used for another design since.
        """
        begin = time.perf_counter()
        e = evaluation
        by_projected, pressure_gradient = self.respond_backward(e)
        if self.perimeter is not None:
            by_border = self.perimeter.backward(e.projected)
            by_projected = by_projected + self._perimeter_price * by_border
        by_projected = by_projected + self.cost_backward(e.projected)
        gradient = self._pull_back(e, None, by_projected)
        widths = None
        if self.length_scale is not None:
            parts = self.length_scale.backward(e.density, e.filtered, e.projected)
            widths = [
                self._pull_back(e, by_filtered, by_projected) + by_density * self.designed
                for by_density, by_filtered, by_projected in parts
            ]
        values, rows, row_pressures = self.residuals_around(e)
        residuals = Residuals(
            values, [self._pull_back(e, None, row) for row in rows], row_pressures
        )
        return replace(
            e,
            gradient=gradient,
            pressure_gradient=pressure_gradient,
            length_scale_gradients=widths,
            residuals=residuals,
            seconds={**e.seconds, "adjoint": time.perf_counter() - begin},
        )

    def evaluate(
        self, density: Floats, start: Any = None, pressure: Pressure | None = None
    ) -> Evaluation[R]:
        """Evaluate T and its gradients: `simulate`, then `differentiate` (collective)."""
        return self.differentiate(self.simulate(density, start, pressure))

    @property
    def parts(self) -> int:
        """Number of equal parts of the skin, of which one is designed."""
        return 1 if self.whole is None else self.whole.parts

    @property
    def _perimeter_price(self) -> float:
        """Increase of T per metre of border."""
        pattern = self.skin.pattern if self.whole is None else self.whole.pattern
        return (self.perimeter_weight or 0.0) * self.parts / pattern.size

    def _pull_back(
        self, evaluation: Evaluation[R], by_filtered: Floats | None, by_projected: Floats
    ) -> Floats:
        """Return the gradient by ρ from those by ρ̃ and ρ̄ (collective)."""
        designed = self.designed
        both = self.projection.backward(evaluation.filtered, by_projected * designed)
        if by_filtered is not None:
            both = both + by_filtered
        return np.asarray(self.filter.backward(both) * designed)
