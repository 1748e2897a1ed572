"""Designing a tile towards a directional response."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem.density.filters import Filter
from toros_fem.density.length_scale import LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.density.projection import Projection
from toros_fem.design.problem import DesignProblem, Evaluation, Pressure
from toros_fem.errors import ParameterError
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin
from toros_fem.tiles.objectives import ProfileObjective
from toros_fem.tiles.stiffness_profile import Profile, ProfileSolver


@dataclass(eq=False)
class TileProblem(DesignProblem[Profile]):
    """A tile and the profile that is wanted of it; see `DesignProblem` for what is not said here.

    Attributes:
        solver: Pulls the tile in the directions that count.
        objective: What is wanted of the profile.
        filter: Filter of the densities on the torus; a `SymmetricFilter` for symmetric designs.
    """

    solver: ProfileSolver
    objective: ProfileObjective
    filter: Filter
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    perimeter: Perimeter | None = None
    weight: float = 0.0
    length_scale: LengthScaleConstraints | None = None
    whole: Mirrored | None = None

    def __post_init__(self) -> None:
        if self.whole is not None:
            raise ParameterError("a tile is whole: its symmetry belongs to the filter.")
        self.check()

    @property
    def skin(self) -> Skin:
        """The tile's."""
        return self.solver.tile.skin

    @property
    def comm(self) -> MPI.Comm:
        """The batch's ranks, if directions are spread, or else the tile's."""
        batch = self.solver.batch
        return batch if batch.size > 1 else self.skin.comm

    def with_projection(self, projection: Projection) -> TileProblem:
        """The same with another projection."""
        return replace(self, projection=projection)

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, allow_continuation: bool
    ) -> tuple[Profile, float]:
        """The profile, with its gradients, and what it is worth (collective)."""
        profile = self.solver.solve(projected, start, allow_continuation=allow_continuation)
        return profile, self.objective.forward(profile)

    def respond_backward(self, evaluation: Evaluation[Profile]) -> tuple[Floats, None]:
        """From what `respond` has kept of each direction (collective)."""
        profile = evaluation.equilibrium
        by_stress, by_contraction = self.objective.backward(profile)
        return self.solver.backward(profile, by_stress, by_contraction), None

    def residuals(self, response: Profile) -> Floats:
        """Those of the objective."""
        return self.objective.residuals(response)

    def residuals_backward(self, evaluation: Evaluation[Profile]) -> Floats:
        """From what `respond` has kept of each direction (collective)."""
        profile = evaluation.equilibrium
        return self.solver.backward(profile, *self.objective.residuals_backward(profile))
