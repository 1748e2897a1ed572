"""What answers to a design: a response, its adjoint, and its copies on disk; an inflated skin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot
from toros_fem.base.validation import Floats, is_number, require_between, require_positive, shown
from toros_fem.measures.shape import Objective, motion_along
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load

Bounds = tuple[float, float]
Pressure = float | Sequence[float]


class Response(Protocol):
    """The response to a projected density, as the design loop sees it."""

    @property
    def state(self) -> Any:
        """State from which the simulation of a neighbouring design starts."""

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
Saved = tuple[Floats, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Residuals:
    """Numbers r whose squares are a part of T, around one response.

    MMA approximates each r by itself, and so knows that their changes add up before they are
    squared. That pays where many variables change the same few numbers.

    Attributes:
        values: Returns r, (j,), of this response or of one near to it (collective).
        gradients: dr/dρ̄ at owned triangles, j arrays.
        pressure_gradients: dr/dP in 1/Pa by the pressure of each chamber, (j, k).
    """

    values: Callable[[Any], Floats]
    gradients: Sequence[Floats] | Floats
    pressure_gradients: Floats


class Physics(Protocol[R]):
    """Map from ρ̄ and pressures to a response; `respond` and `pull_back` are a pair."""

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of all ranks that take part."""

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa, where it starts if it is designed."""

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Bounds on the pressure of each chamber in Pa; None where it is prescribed."""

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> R:
        """Return the response to ρ̄ (collective).

        Args:
            projected: ρ̄ at owned triangles.
            start: State to start from, of a neighbouring design for instance.
            pressure: In Pa, of all chambers or of each; None takes `pressures`.
            trial: Whether the result may be rejected, so that few steps and a large tolerance are
                enough; `finish` completes it.

        Raises:
            NoEquilibriumError: There is no equilibrium, on all ranks.
        """

    def finish(self, response: R) -> R:
        """Return a trial's response solved to the solver's tolerance, stable (collective)."""

    def observed(self, response: R) -> Any:
        """Return what the objective is a function of."""

    def pull_back(self, response: R, by_observed: Any) -> tuple[Floats, Floats | None]:
        """Return gradients by ρ̄ and by pressures from that by `observed` (collective).

        The second is None if no pressure is designed.
        """

    def residuals(self, response: R, objective: Any) -> Residuals:
        """Return the residuals of the objective around a response (collective)."""

    def save(self, response: R) -> Saved:
        """Return what `restore` needs, by original index, and as JSON (collective)."""

    def restore(self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]) -> R:
        """Return a saved response, as if it had just been simulated (collective)."""

    def shape_of(self, response: R) -> Floats | None:
        """Return the positions of all vertices, (n, 3), in m; None where it has none (collective).

        Metrics are functions of them, pictures show them, and a finer mesh starts from them.
        """

    def state_at(self, positions: Floats) -> Any:
        """Return a state to start from, from the positions of all vertices (collective)."""


@dataclass(frozen=True, eq=False)
class InflatedSkin:
    """Equilibrium of a skin under pressure, eqs. (9, 19).

    Attributes:
        solver: Equilibrium solver of the skin.
        pressure: Pressure in Pa, of all chambers or of each; where a designed one starts.
        pressure_bounds: Least and largest pressure in Pa of all chambers, or such a pair for each;
            None prescribes the pressure, or that chamber's.
        force: Dead forces in N on all assembled vertices, (n, 3).

    Raises:
        ParameterError: A pressure or a bound is not valid.
    """

    solver: EquilibriumSolver
    pressure: Pressure
    pressure_bounds: Bounds | Sequence[Bounds | None] | None = None
    force: Floats | None = None

    def __post_init__(self) -> None:
        for pressure, bounds in zip(self.pressures, self.pressure_ranges, strict=True):
            require_between(0.0, np.inf, pressure=pressure)
            if bounds is not None:
                pair = isinstance(bounds, list | tuple | np.ndarray) and len(bounds) == 2
                if not pair or not all(map(is_number, bounds)) or not bounds[0] < bounds[1]:
                    raise ParameterError(
                        f"pressure_bounds = {shown(bounds)} must be two numbers in Pa, the least "
                        "and the largest pressure. To prescribe the pressure, give no bounds."
                    )
                require_positive(least_pressure=bounds[0], largest_pressure=bounds[1])
                require_between(*bounds, pressure=pressure)

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the skin."""
        return self.solver.skin.comm

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa, where it starts if it is designed."""
        return self._for_each(self.pressure, "pressure", np.isscalar(self.pressure))

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Least and largest pressure of each chamber in Pa; None where it is prescribed."""
        bounds = self.pressure_bounds
        listed = isinstance(bounds, list | tuple | np.ndarray) and len(bounds) > 0
        alike = bounds is None or (listed and np.isscalar(bounds[0]))
        return self._for_each(bounds, "pressure_bounds", alike)

    def _for_each(self, given: Any, name: str, alike: bool) -> tuple[Any, ...]:
        count = len(self.solver.model.load.pressures)
        listed = isinstance(given, list | tuple | np.ndarray)
        values = (given,) * count if alike else tuple(given) if listed else ()
        if len(values) != count:
            raise ParameterError(
                f"{name} = {shown(given)} must be given once for all, or once for each of the "
                f"{count} chambers, in Pa."
            )
        return values

    @property
    def _designed(self) -> list[int]:
        """Chambers whose pressures are designed."""
        return [k for k, bounds in enumerate(self.pressure_ranges) if bounds is not None]

    def load(self, pressure: Pressure | None = None) -> Load:
        """Return what acts at a pressure; None takes the pressure of the problem."""
        return Load(self.pressure if pressure is None else pressure, self.force)

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> Equilibrium:
        """Return the equilibrium of ρ̄ (collective)."""
        return self.solver.solve(projected, self.load(pressure), start, trial=trial)

    def finish(self, response: Equilibrium) -> Equilibrium:
        """Return a trial's equilibrium solved to the solver's tolerance, stable (collective)."""
        return self.solver.finish(response)

    def observed(self, response: Equilibrium) -> Floats:
        """Return the positions of the owned nodes, (n, 3), in m."""
        return response.positions

    def shape_of(self, response: Equilibrium) -> Floats:
        """Return the positions of all vertices, (n, 3), in m (collective)."""
        return self.solver.skin.gather_vertices(response.positions)

    def state_at(self, positions: Floats) -> Floats | None:
        """Return positions of the owned nodes, from those of all vertices.

        Where they leave the stretch bounds they are relaxed; None if that does not help, or if
        surfaces overlap or cross that may touch (collective).
        """
        return self.solver.start_at(positions)

    def pull_back(self, response: Equilibrium, by_observed: Floats) -> tuple[Floats, Floats | None]:
        """Return the gradients by one adjoint solve with the last tangent, eq. (19) (collective).

        K λ = ∂T/∂x gives dT/dρ̄ = −λ · ∂f/∂ρ̄ and dT/dP = λ · ∂V/∂x.
        """
        model, rhs = self.solver.model, np.zeros_like(response.state)
        model.positions(rhs)[:] = by_observed
        adjoint = self.solver.solve_tangent(rhs, response, adjoint=True)
        by_projected = -model.density_sensitivity(response.state, adjoint)
        if not self._designed:
            return by_projected, None
        by_pressure = np.zeros(len(self.pressures))
        for k in self._designed:
            by_pressure[k] = dot(self.comm, adjoint, model.volume_gradient(response.state, k))
        return by_projected, by_pressure

    def residuals(self, response: Equilibrium, objective: Objective) -> Residuals:
        """Return the motion along the pressures' responses as residuals (collective)."""
        model = self.solver.model
        pushes = [model.volume_gradient(response.state, k) for k in self._designed]
        moves = [model.positions(self.solver.solve_tangent(push, response)) for push in pushes]
        motion = motion_along(self.solver.skin, objective, response.positions, moves)
        slopes = [self.pull_back(response, direction) for direction in motion.directions]
        by_pressure = np.array([one for _, one in slopes]).reshape(len(slopes), len(self.pressures))
        rows = [row for row, _ in slopes]
        return Residuals(lambda near: motion.along(near.positions), rows, by_pressure)

    def save(self, response: Equilibrium) -> Saved:
        """Return the unknowns by original index, and the numbers of the equilibrium."""
        return self.solver.save(response)

    def restore(
        self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]
    ) -> Equilibrium:
        """Return the equilibrium, with its tangent factorised (collective)."""
        return self.solver.restore(projected, unknowns, numbers, self.load(0.0))
