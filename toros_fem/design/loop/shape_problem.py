"""Design of a skin under pressure towards a target shape, eqs. (17-19)."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import DensityError, ParameterError
from toros_fem.base.mpi import dot, largest
from toros_fem.base.validation import real_numbers, require_between, require_positive, shown
from toros_fem.design.density.field import random_density
from toros_fem.design.density.length_scale import LengthScaleConstraints
from toros_fem.design.density.linear import Filter
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.problem import Bounds, DesignProblem, Evaluation, Pressure
from toros_fem.design.loop.robust import Variants
from toros_fem.measures.metrics import Metric, check_metrics
from toros_fem.measures.motion import motion_along
from toros_fem.measures.shape import Objective
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.designs import check_density
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

# Largest displacement in differences of metrics, over the size of the skin.
METRIC_STEP = 1e-5


@dataclass(eq=False)
class ShapeProblem(DesignProblem[Equilibrium]):
    """A skin, its loads and the target of its shape, put together from their parts.

    `ShapeDesign` builds these parts from a pattern and numbers. For the attributes that are not
    listed here see `DesignProblem`.

    Attributes:
        solver: Equilibrium solver of the skin.
        objective: Distance from the target as a function of the positions.
        pressure: Pressure in Pa, of all chambers or of each; the first guess where it is designed.
        pressure_bounds: Least and largest pressure in Pa of all chambers, or such a pair for each;
            None prescribes the pressure, or that chamber's.
        force: Dead forces in N on all assembled vertices, (n, 3).
        target: Target positions of all assembled vertices, (n, 3), in m, for pictures; None if
            the objective has none.
        metrics: Numbers that the design is judged by, the most important first.
        start: Density of all triangles to start from, (t,), within [0.1, 0.9]: noise of 0.1 is
            added. None starts from 0.5.
        robust: Eroded and dilated patterns, whose spread T counts too; None leaves them out.
    """

    solver: EquilibriumSolver
    objective: Objective
    filter: Filter
    pressure: Pressure
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    pressure_bounds: Bounds | Sequence[Bounds | None] | None = None
    perimeter: Perimeter | None = None
    perimeter_weight: float | None = None
    length_scale: LengthScaleConstraints | None = None
    force: Floats | None = None
    whole: Mirrored | None = None
    target: Floats | None = None
    metrics: tuple[Metric, ...] = ()
    start: Floats | None = None
    robust: Variants | None = None

    def __post_init__(self) -> None:
        for pressure, bounds in zip(self.pressures, self.pressure_ranges, strict=True):
            require_between(0.0, np.inf, pressure=pressure)
            if bounds is not None:
                if not isinstance(bounds, list | tuple | np.ndarray) or len(bounds) != 2:
                    raise ParameterError(
                        f"pressure_bounds = {shown(bounds)} must be two numbers in Pa, the least "
                        "and the largest pressure."
                    )
                low, high = bounds
                require_positive(least_pressure=low, largest_pressure=high)
                if not low < high:
                    raise ParameterError(
                        f"the pressure's bounds {low:g} and {high:g} Pa leave it no room; the "
                        "second must be larger. To prescribe the pressure, give no bounds."
                    )
                require_between(low, high, pressure=pressure)
        check_metrics(self.metrics)
        self._check_start()
        self.check()

    def _check_start(self) -> None:
        if self.start is None:
            return
        count = len(self.skin.pattern.triangles)
        what = "one density for each triangle of the pattern"
        self.start = real_numbers("start", self.start, what, DensityError)
        if self.start.shape != (count,):
            raise DensityError(
                f"start has shape {self.start.shape}; it must be ({count},), one density for "
                "each triangle of the pattern."
            )
        least, largest = float(np.min(self.start)), float(np.max(self.start))
        if not 0.1 <= least <= largest <= 0.9:
            raise DensityError(
                f"start holds densities from {least:g} to {largest:g}; they must lie in "
                "[0.1, 0.9], since noise of 0.1 is added."
            )

    @property
    def skin(self) -> Skin:
        """The skin of the solver."""
        return self.solver.skin

    def with_projection(self, projection: Projection) -> Self:
        """Return the same problem with another projection."""
        other = copy.copy(self)
        other.projection = projection
        return other

    def without_variants(self) -> Self:
        """Return the same problem with the nominal pattern alone."""
        other = copy.copy(self)
        other.robust = None
        return other

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber in Pa, the first guess where it is designed."""
        return self._for_each(self.pressure, "pressure", np.isscalar(self.pressure))

    @property
    def pressure_ranges(self) -> tuple[Bounds | None, ...]:
        """Least and largest pressure of each chamber in Pa; None where it is prescribed."""
        bounds = self.pressure_bounds
        listed = isinstance(bounds, list | tuple | np.ndarray) and len(bounds) > 0
        if bounds is not None and not listed:
            raise ParameterError(
                f"pressure_bounds = {shown(bounds)} must be the least and the largest pressure in "
                "Pa, such a pair for each chamber, or None."
            )
        alike = bounds is None or np.isscalar(bounds[0])
        return self._for_each(bounds, "pressure_bounds", alike)

    def _for_each(self, given: Any, name: str, alike: bool) -> tuple[Any, ...]:
        count = len(self.solver.model.load.pressures)
        if not alike and not isinstance(given, list | tuple | np.ndarray):
            raise ParameterError(
                f"{name} = {shown(given)} must be one number in Pa, or one for each chamber."
            )
        values = (given,) * count if alike else tuple(given)
        if len(values) != count:
            raise ParameterError(
                f"{name} has {len(values)} entries; it must have one for each of the {count} "
                "chambers, or be given once for all."
            )
        return values

    def metrics_of(self, response: Equilibrium) -> dict[str, float]:
        """Return the values of all metrics by key, equal on all ranks (collective)."""
        return self.metrics_at(response.positions)

    def with_printed_spread(self, printed: Floats, evaluation: Evaluation[Equilibrium]) -> Self:
        """Return the same problem, which knows how far prints of a design are apart.

        Args:
            printed: As of `Variants.corrected`.
            evaluation: The design of these prints.
        """
        other = copy.copy(self)
        assert self.robust is not None
        other.robust = self.robust.corrected(printed, evaluation.variants)
        return other

    def robust_figures(self, evaluation: Evaluation[Equilibrium]) -> dict[str, Any]:
        """Return spread, thresholds and metrics of the eroded and dilated pattern (collective).

        Args:
            evaluation: Evaluation of a robust problem.
        """
        robust, metrics = self.robust, [self.metrics_of(v) for v in evaluation.variants]
        if robust is None or not metrics:
            return {}
        names = ("eroded", "dilated")
        return {
            "width_tolerance_m": robust.tolerance.width,
            "border_offset_m": robust.tolerance.offset,
            "spread": evaluation.spread,
            "spread_weight": robust.tolerance.weight,
            **{f"eta_{n}": eta for n, eta in zip(names, robust.thresholds, strict=True)},
            **{n: found for n, found in zip(names, metrics, strict=True)},
        }

    def metrics_at(self, owned: Floats) -> dict[str, float]:
        """Return the values of all metrics for positions of the owned nodes (collective)."""
        if not self.metrics:
            return {}
        positions, pattern = self.skin.gather_vertices(owned), self.skin.pattern
        return {m.key: m.value(pattern, positions) for m in self.metrics}

    def metric_derivatives(
        self, evaluation: Evaluation[Equilibrium], changes: Sequence[Floats]
    ) -> dict[str, Floats]:
        """Return the derivatives of all metrics along changes of ρ̄, by key (collective).

        K y = −(∂f/∂ρ̄) δρ̄ with the last tangent gives the motion y along each change; metrics, which
        are functions of the positions alone, are differenced along it.

        Args:
            evaluation: A simulation of this problem.
            changes: δρ̄ at owned triangles, one array for each derivative.
        """
        equilibrium, model = evaluation.equilibrium, self.solver.model
        state = equilibrium.state
        self.solver.tangent_at(equilibrium)
        force = model.residual(state)
        found: dict[str, list[float]] = {metric.key: [] for metric in self.metrics}
        for change in changes:
            if model.composite.mixes_linearly:
                # The energy is linear in ρ̄, so that this difference is exact.
                model.set_density(evaluation.projected + change)
                push = force - model.residual(state)
            else:
                push = -model.density_variation(state, change)
            motion = self.solver.solve_tangent(push, equilibrium)
            for key, slope in self.metrics_along(equilibrium, motion).items():
                found[key].append(slope)
        model.set_density(evaluation.projected)
        return {key: np.array(values) for key, values in found.items()}

    def metrics_along(self, at: Equilibrium, motion: Floats) -> dict[str, float]:
        """Return the derivatives of all metrics along a motion of the state (collective)."""
        moved = self.solver.model.positions(motion)
        way = largest(self.skin.comm, float(np.abs(moved).max(initial=0.0)))
        step = METRIC_STEP * self.skin.pattern.size / way if way > 0 else 1.0
        less, more = (self.metrics_at(at.positions + sign * step * moved) for sign in (-1, 1))
        return {key: (more[key] - less[key]) / (2 * step) for key in more}

    def shape_of(self, response: Equilibrium) -> Floats:
        """Return the positions of all assembled vertices, (n, 3), in m (collective)."""
        return self.skin.gather_vertices(response.positions)

    def state_at(self, positions: Floats) -> Floats | None:
        """Return positions of the owned nodes, from those of all vertices.

        Where they leave the stretch bounds they are relaxed; None if that does not help, or if
        surfaces overlap or cross that may touch (collective).
        """
        return self.solver.start_at(positions)

    def start_density(self, seed: int) -> Floats:
        """Return `start` with noise added, or noise around 0.5, at owned triangles.

        Raises:
            DensityError: `start` leaves [0.1, 0.9].
            ParameterError: The seed is negative.
        """
        drawn = random_density(self.skin, seed)
        if self.start is None:
            return drawn
        drawn = self.start[self.skin.owned_cells] + drawn - 0.5
        check_density(self.skin, drawn)
        return drawn

    def load(self, pressure: Pressure) -> Load:
        """Return what acts at a pressure."""
        return Load(pressure, self.force)

    def respond(
        self,
        projected: Floats,
        start: Any,
        pressure: Pressure | None,
        *,
        trial: bool,
    ) -> tuple[Equilibrium, float]:
        """Solve for the equilibrium; return it and its distance from the target (collective)."""
        equilibrium = self.solver.solve(
            projected,
            self.load(self.pressure if pressure is None else pressure),
            start,
            trial=trial,
        )
        return equilibrium, self.objective.forward(equilibrium.positions)

    def simulate(
        self,
        density: Floats,
        start: Any = None,
        pressure: Pressure | None = None,
        *,
        trial: bool = False,
    ) -> Evaluation[Equilibrium]:
        """Evaluate T as `DesignProblem.simulate` does, with the spread of a robust design."""
        found = super().simulate(density, start, pressure, trial=trial)
        if self.robust is None:
            return found
        begin, nominal = time.perf_counter(), found.equilibrium
        densities = self._variant_densities(found.filtered)
        # They differ little from the nominal pattern, far less than that from the last one.
        variants = tuple(
            solver.solve(projected, self.load(nominal.pressures), nominal.state, trial=trial)
            for solver, projected in zip(self.robust.solvers, densities, strict=True)
        )
        return self._with_variants(found, variants, begin)

    def _variant_densities(self, filtered: Floats) -> list[Floats]:
        """Return ρ̄ of the eroded and of the dilated pattern."""
        assert self.robust is not None
        steps = self.robust.projections(self.projection)
        return [self.with_passive(step.forward(filtered)) for step in steps]

    def _with_variants(
        self,
        evaluation: Evaluation[Equilibrium],
        variants: tuple[Equilibrium, ...],
        begin: float,
    ) -> Evaluation[Equilibrium]:
        """Return an evaluation with other variants, which took the time since `begin`."""
        assert self.robust is not None
        e, weight = evaluation, self.robust.tolerance.weight
        spread = self.robust.spread(self.objective, e.equilibrium, variants)
        more = e.seconds["equilibrium"] + time.perf_counter() - begin
        return replace(
            e,
            objective=e.objective + weight * (spread - (e.spread or 0.0)),
            variants=variants,
            spread=spread,
            seconds={**e.seconds, "equilibrium": more},
        )

    def save_response(self, response: Equilibrium) -> tuple[Floats, dict[str, Any]]:
        """Return the unknowns by original index, and the numbers of the equilibrium."""
        return self.solver.save(response)

    def restore_response(
        self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]
    ) -> Equilibrium:
        """Return the equilibrium, with its tangent factorised (collective)."""
        return self.solver.restore(projected, unknowns, numbers, self.load(0.0))

    def save_variants(self, variants: Sequence[Equilibrium]) -> list[tuple[Floats, dict[str, Any]]]:
        """Return unknowns by original index and numbers of both variants, if there are any."""
        solvers = () if self.robust is None or not variants else self.robust.solvers
        return [s.save(variant) for s, variant in zip(solvers, variants, strict=True)]

    def restore_variants(
        self, filtered: Floats, saved: Sequence[tuple[Floats, Mapping[str, Any]]]
    ) -> tuple[Equilibrium, ...]:
        """Return the equilibria of both variants, with their tangents factorised (collective)."""
        if self.robust is None or not saved:
            return ()
        densities = self._variant_densities(filtered)
        return tuple(
            solver.restore(projected, *parts, self.load(0.0))
            for solver, projected, parts in zip(self.robust.solvers, densities, saved, strict=True)
        )

    def finish(self, evaluation: Evaluation[Equilibrium]) -> Evaluation[Equilibrium]:
        """Complete a trial: solve to the solver's tolerance and prove stability (collective)."""
        begin = time.perf_counter()
        equilibrium = self.solver.finish(evaluation.equilibrium)
        if equilibrium is evaluation.equilibrium:
            return evaluation
        shape = self.objective.forward(equilibrium.positions)
        found = replace(
            evaluation,
            objective=evaluation.objective + shape - evaluation.shape,
            shape=shape,
            equilibrium=equilibrium,
            seconds={"equilibrium": time.perf_counter() - begin},
        )
        if self.robust is None:
            return found
        begin, both = time.perf_counter(), zip(self.robust.solvers, found.variants, strict=True)
        return self._with_variants(found, tuple(s.finish(v) for s, v in both), begin)

    def differentiate(self, evaluation: Evaluation[Equilibrium]) -> Evaluation[Equilibrium]:
        """Add the gradients as `DesignProblem.differentiate` does, with those of the variants."""
        found, robust = super().differentiate(evaluation), self.robust
        if robust is None or not evaluation.variants:  # a print has none
            return found
        begin, e = time.perf_counter(), found
        assert e.gradient is not None
        slopes = robust.spread_slopes(self.objective, e.equilibrium, e.variants)[1:]
        by_filtered, by_pressure = np.zeros_like(e.filtered), e.pressure_gradient
        steps = robust.projections(self.projection)
        for solver, variant, step, slope in zip(
            robust.solvers, e.variants, steps, slopes, strict=True
        ):
            by_projected, more = self._adjoint(solver, variant, robust.tolerance.weight * slope)
            by_filtered += step.backward(e.filtered, by_projected * self.designed)
            if by_pressure is not None and more is not None:
                by_pressure = by_pressure + more
        seconds = e.seconds["adjoint"] + time.perf_counter() - begin
        return replace(
            e,
            gradient=e.gradient + self.filter.backward(by_filtered) * self.designed,
            pressure_gradient=by_pressure,
            seconds={**e.seconds, "adjoint": seconds},
        )

    def respond_backward(self, evaluation: Evaluation[Equilibrium]) -> tuple[Floats, Floats | None]:
        """Return the gradients by one adjoint solve with the last tangent, eq. (19) (collective).

        K λ = ∂T/∂x gives dT/dρ̄ = −λ · ∂f/∂ρ̄ and dT/dP = λ · ∂V/∂x. UFL derives K and ∂f/∂ρ̄; ∂T/∂x
        is written by hand.
        """
        e = evaluation
        by_position = self.objective.backward(e.equilibrium.positions)
        if self.robust is not None and e.variants:
            slope, _, _ = self.robust.spread_slopes(self.objective, e.equilibrium, e.variants)
            by_position = by_position + self.robust.tolerance.weight * slope
        return self._adjoint(self.solver, e.equilibrium, by_position)

    def _adjoint(
        self, solver: EquilibriumSolver, equilibrium: Equilibrium, by_position: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the gradients by ρ̄ and by the pressures from that by positions (collective)."""
        model = solver.model
        rhs = np.zeros_like(equilibrium.state)
        model.positions(rhs)[:] = by_position
        adjoint = solver.solve_tangent(rhs, equilibrium, adjoint=True)
        by_projected = -model.density_sensitivity(equilibrium.state, adjoint)
        designed = [k for k, bounds in enumerate(self.pressure_ranges) if bounds is not None]
        if not designed:
            return by_projected, None
        by_pressure = np.zeros(len(self.pressures))
        for k in designed:
            volume_gradient = model.volume_gradient(equilibrium.state, k)
            by_pressure[k] = dot(self.skin.comm, adjoint, volume_gradient)
        return by_projected, by_pressure

    def residuals_around(
        self, evaluation: Evaluation[Equilibrium]
    ) -> tuple[Callable[[Equilibrium], Floats], Floats, Floats]:
        """Return the motion along the pressures' responses as residuals (collective)."""
        designed = [k for k, bounds in enumerate(self.pressure_ranges) if bounds is not None]
        near, model = evaluation.equilibrium, self.solver.model
        by_pressure = [model.volume_gradient(near.state, k) for k in designed]
        responses = [self.solver.solve_tangent(v, near) for v in by_pressure]
        moves = [model.positions(y) for y in responses]
        motion = motion_along(self.skin, self.objective, near.positions, moves)
        rows = np.zeros((len(designed), *evaluation.projected.shape))
        row_pressures = np.zeros((len(designed), len(self.pressures)))
        for j, direction in enumerate(motion.directions):
            rhs = np.zeros_like(near.state)
            model.positions(rhs)[:] = direction
            adjoint = self.solver.solve_tangent(rhs, near, adjoint=True)
            rows[j] = -model.density_sensitivity(near.state, adjoint)
            for k, v in zip(designed, by_pressure, strict=True):
                row_pressures[j, k] = dot(self.skin.comm, adjoint, v)
        return lambda response: motion.along(response.positions), rows, row_pressures
