"""A tile as a design problem: a density towards a profile of stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.physics import Pressure, Residuals, Saved
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.meshes.makers.tile import Tile
from toros_fem.products.tile_design.starts import random_waves
from toros_fem.products.tiles.objectives import ProfileObjective, ProfileTarget
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileSolver


@dataclass(frozen=True, eq=False)
class TileFields(DensityFields):
    """Densities of a tile, which start from long waves; its filter is that of the torus.

    Attributes:
        tile: The tile.
    """

    tile: Tile = field(kw_only=True)

    def start(self, seed: int) -> Floats:
        """Return random long waves at owned triangles, as of `random_waves`."""
        return np.asarray(random_waves(self.tile, seed)[self.skin.owned_cells])


@dataclass(frozen=True, eq=False)
class TilePhysics:
    """Profile of a tile in the directions of its objective; nothing is inflated.

    Attributes:
        solver: Solver of the tile in these directions.
    """

    solver: ProfileSolver
    pressures = ()
    pressure_ranges = ()

    @property
    def comm(self) -> MPI.Comm:
        """Communicator that the directions are spread over, or else the tile's."""
        batch = self.solver.batch
        return batch if batch.size > 1 else self.solver.tile.skin.comm

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> Profile:
        """Return the profile and its gradients (collective)."""
        if isinstance(start, Profile):
            start = start.state
        return self.solver.solve(projected, start, allow_continuation=not trial)

    def finish(self, response: Profile) -> Profile:
        """Return the profile as it is: trials are solved to the same tolerance."""
        return response

    def observed(self, response: Profile) -> Profile:
        """Return the profile."""
        return response

    def pull_back(
        self, response: Profile, by_observed: tuple[Floats, Floats]
    ) -> tuple[Floats, None]:
        """Return the gradient by ρ̄ from those by stress and contraction (collective)."""
        return self.solver.backward(response, *by_observed), None

    def residuals(self, response: Profile, objective: ProfileObjective) -> Residuals:
        """Return the objective's residuals and their gradients (collective)."""
        rows = self.solver.backward(response, *objective.residuals_backward(response))
        return Residuals(objective.residuals, rows, np.zeros((len(rows), 0)))

    def save(self, response: Profile) -> Saved:
        """Return the unknowns of each direction and their counts (collective)."""
        return self.solver.save(response)

    def restore(self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]) -> Profile:
        """Return the profile, with its gradients (collective)."""
        return self.solver.restore(projected, unknowns, numbers)

    def shape_of(self, response: Profile) -> None:
        """Return None: a finer mesh starts from the flat tile."""

    def state_at(self, positions: Floats) -> None:
        """Return None, for the flat tile."""


@dataclass(eq=False)
class TileProblem(DesignProblem[Profile]):
    """A tile whose print is designed so that its profile minimises an objective.

    Attributes:
        goal: Target profile for the metric "worst_percent", the largest relative deviation; None
            leaves the metric out. The objective may ask for another one.
    """

    fields: TileFields
    physics: TilePhysics
    goal: ProfileTarget | None = None

    def metrics_of(self, response: Profile) -> dict[str, float]:
        """Return the largest deviation from the target in %; nothing without a target."""
        if self.goal is None:
            return {}
        return {"worst_percent": 100 * self.goal.largest_deviation(response)}
