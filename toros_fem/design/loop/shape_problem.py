"""The design problem of an inflated skin, and the derivatives of its metrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver

# Largest displacement in differences of metrics, over the size of the skin.
METRIC_STEP = 1e-5


@dataclass(eq=False)
class ShapeProblem(DesignProblem[Equilibrium]):
    """A skin under pressure, designed towards the shape that it shall take, eqs. (17-19)."""

    physics: InflatedSkin

    @property
    def solver(self) -> EquilibriumSolver:
        """Equilibrium solver of the skin."""
        return self.physics.solver

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
        at, solver, model = evaluation.equilibrium, self.solver, self.solver.model
        solver.tangent_at(at)
        force = model.residual(at.state)
        found: dict[str, list[float]] = {metric.key: [] for metric in self.metrics}
        for change in changes:
            if model.composite.mixes_linearly:
                # The energy is linear in ρ̄, so that this difference is exact.
                model.set_density(evaluation.projected + change)
                push = force - model.residual(at.state)
            else:
                push = -model.density_variation(at.state, change)
            for key, slope in self.metrics_along(at, solver.solve_tangent(push, at)).items():
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
