"""The design problem of a tile: a density towards a profile of stiffness."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.design.density.length_scale import LengthScaleConstraints
from toros_fem.design.density.linear import Filter
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.problem import DesignProblem, Evaluation, Pressure
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin
from toros_fem.products.tile_design.starts import random_waves
from toros_fem.products.tiles.objectives import ProfileObjective, ProfileTarget
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileSolver


@dataclass(eq=False)
class TileProblem(DesignProblem[Profile]):
    """A tile whose print is designed so that its profile minimises an objective.

    The gradient of stress and contraction in each direction is the discrete adjoint's, by hand
    (`TileSolver.stress_gradient`, `strain_gradient`); tests tie it to differences.

    Attributes:
        solver: Solver of the tile in the directions of the objective.
        objective: Objective of the profile.
        filter: Filter of the densities on the torus; `after` a `group_mean` for symmetric designs.
        projection, passive, perimeter, perimeter_weight, length_scale: As for `DesignProblem`.
        whole: None: a tile is never a part of a larger skin.
        target: Target profile for the metric "worst_percent", the largest relative deviation;
            None leaves the metric out.

    Raises:
        ParameterError: `whole` is given, or the perimeter and its weight do not fit.
        DensityError: As for `DesignProblem.check`.
    """

    solver: ProfileSolver
    objective: ProfileObjective
    filter: Filter
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    perimeter: Perimeter | None = None
    perimeter_weight: float | None = None
    length_scale: LengthScaleConstraints | None = None
    whole: Mirrored | None = None
    target: ProfileTarget | None = None

    def __post_init__(self) -> None:
        if self.whole is not None:
            raise ParameterError(
                "whole must be None for a tile: give its symmetry to the filter, by "
                "filter.after(group_mean(…))."
            )
        self.check()

    @property
    def skin(self) -> Skin:
        """The tile's sewn skin."""
        return self.solver.tile.skin

    @property
    def comm(self) -> MPI.Comm:
        """Communicator that the directions are spread over, or else the tile's."""
        batch = self.solver.batch
        return batch if batch.size > 1 else self.skin.comm

    def with_projection(self, projection: Projection) -> TileProblem:
        """Return the same problem with another projection; all other parts are shared."""
        return replace(self, projection=projection)

    def start_density(self, seed: int) -> Floats:
        """Return random long waves at owned triangles, as of `random_waves`."""
        waves = random_waves(self.solver.tile.periodic.tile, seed)
        return np.asarray(waves[self.skin.owned_cells])

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> tuple[Profile, float]:
        """Solve for the profile and its gradients; return it with its objective (collective)."""
        if isinstance(start, Profile):
            start = start.state
        profile = self.solver.solve(projected, start, allow_continuation=not trial)
        return profile, self.objective.forward(profile)

    def respond_backward(self, evaluation: Evaluation[Profile]) -> tuple[Floats, None]:
        """Return the objective's gradient by ρ̄; no pressure is designed (collective)."""
        profile = evaluation.equilibrium
        by_stress, by_contraction = self.objective.backward(profile)
        return self.solver.backward(profile, by_stress, by_contraction), None

    def residuals_around(
        self, evaluation: Evaluation[Profile]
    ) -> tuple[Callable[[Profile], Floats], Floats, Floats]:
        """Return the objective's residuals and their gradients by ρ̄ (collective)."""
        profile = evaluation.equilibrium
        rows = self.solver.backward(profile, *self.objective.residuals_backward(profile))
        return self.objective.residuals, rows, np.zeros((len(rows), 0))

    def save_response(self, response: Profile) -> tuple[Floats, dict[str, Any]]:
        """Return the unknowns of each direction and their counts (collective)."""
        return self.solver.save(response)

    def restore_response(
        self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]
    ) -> Profile:
        """Return the profile, with its gradients (collective)."""
        return self.solver.restore(projected, unknowns, numbers)

    def metrics_of(self, response: Profile) -> dict[str, float]:
        """Return the largest deviation from the target in %; nothing without a target."""
        if self.target is None:
            return {}
        return {"worst_percent": 100 * self.target.largest_deviation(response)}
